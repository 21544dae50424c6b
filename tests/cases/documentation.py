"""docs/ as a product: Sphinx builds it without a warning, it works from a folder without the network, its search finds
things, and what its pages tell a user to type works.

A tutorial is run as a user runs it, all its blocks in one folder and in their order: a `toml` or `py` block that begins with
`# NAME.ext` is that file, a `sh` block is typed (a `bash` block is only shown), and of a `text` block after it each line was printed: `…` is
anything, a time anything too; whole numbers are these, and others (or beside a ±) agree to 10 %: processors differ in the last digits,
which sampling makes larger.
"""
import functools
import os
import pathlib
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import unittest

from dashboard import run_part
from support import KNOTHE, REPOSITORY, Case, exit_status, python_with

DOCS = REPOSITORY / "docs"
CHROMIUM = os.environ.get("KNOTHE_CHROMIUM", "/usr/bin/chromium")
BUILD = pathlib.Path(os.environ["KNOTHE_BUILD"])


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def blocks_of(page):
    return re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def commands_of(page):
    """What a page calls knothe with, in blocks and between backticks: continued lines joined, without what the shell adds."""
    for language, text in [*blocks_of(page), *(("", text) for text in re.findall(r"`(knothe [a-z][^`\n]*)`", page.read_text()))]:
        if language in ("", "sh", "bash"):
            for line in text.replace("\\\n", " ").splitlines():
                found = re.match(r"\s*(knothe [a-z].*)", line)
                if found:
                    yield re.sub(r"\s+#.*|\s*[>&].*|\s\|.*", "", found[1])


NUMBER = r"[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def was_printed(line, output):
    """Whether a line of `output` begins as `line` does."""
    said = []
    pattern = ""
    pieces = [piece for piece in re.split(rf"(…|{NUMBER} (?:µs|ms|s)\b|{NUMBER}|\s+)", line.strip()) if piece]
    for i, piece in enumerate(pieces):
        if re.fullmatch(NUMBER, piece):
            counts = re.fullmatch(r"[-−+]?\d+", piece) and "±" not in pieces[max(0, i - 2):i + 3]
            said.append((float(piece.replace("−", "-")), 0 if counts else 0.1))
            pattern += rf"(?<!\d)({NUMBER})(?!\d)"
        elif piece.isspace():
            pattern += r"\s+"
        else:
            pattern += ".*?" if piece == "…" else rf"{NUMBER} (?:µs|ms|s)\b" if re.fullmatch(rf"{NUMBER} \w+", piece) else re.escape(piece)
    pattern = pattern.replace(r"\s+.*?\s+", ".*?").replace(r"\s+.*?", ".*?")
    for found in re.finditer(rf"(?m)^[ \t]*{pattern}", output):
        printed = [float(number.replace("−", "-")) for number in found.groups()]
        if all(abs(a - b) <= margin * abs(a) for (a, margin), b in zip(said, printed, strict=True)):
            return True
    return False


class Test(Case):
    def python_of_sphinx(self):
        python = python_with("sphinx", "myst_parser", "furo")
        if python is None:
            self.skipTest("no python3 with Sphinx, MyST and furo here: `scripts/install-dependencies.sh docs` installs them")
        return python

    def build_pages(self):
        python = self.python_of_sphinx()
        if not pathlib.Path("/usr/share/javascript/mathjax/MathJax.js").exists():
            self.skipTest("no libjs-mathjax here: `scripts/install-dependencies.sh docs` installs it")
        done = subprocess.run([python, "-m", "sphinx", "-b", "html", "-W", "--keep-going", "-q", "-d", self.folder / "cache", DOCS,
                               self.folder / "html"], capture_output=True, text=True, timeout=280)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return self.folder / "html"

    def shown(self, address):
        """The page as headless Chromium has it after its scripts, and the addresses beyond file:// that it asked for; no network."""
        log = self.folder / "net.json"
        done = subprocess.run([CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={self.folder / 'profile'}",
                               "--disable-background-networking", "--disable-component-update", "--no-first-run",
                               "--host-resolver-rules=MAP * ~NOTFOUND", f"--log-net-log={log}", "--virtual-time-budget=20000", "--dump-dom",
                               address], capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr[-2000:])
        # What the browser asks for on its own account has no initiator.
        return done.stdout, re.findall(r'"initiator":"(?!not an origin)[^"]*".{0,400}?"url":"(https?://[^"]*)"', log.read_text())

    def check_reference_of_interfaces(self, pages):
        """All that is public is on the pages of Python and, where Doxygen was there, of C++."""
        package = (REPOSITORY / "python/knothe/__init__.py").read_text()
        names = set(re.findall(r'"(\w+)"', package.split("__all__ = [")[1])) - {"__version__"}
        names |= {f"plot.{name}" for name in re.findall(r"^def ([a-z]\w*)", (REPOSITORY / "python/knothe/plot.py").read_text(), re.MULTILINE)}
        page = (pages / "python.html").read_text()
        self.assertEqual([name for name in sorted(names) if f'id="knothe.{name}"' not in page], [])
        page = (pages / "cpp.html").read_text()
        if "left out here" in page:
            return
        for header in re.findall(r'#include "(knothe/(?:library/|base/error).*)"', (REPOSITORY / "knothe/knothe.hpp").read_text()):
            declared = re.findall(r"^(?:class|struct|enum class) (?:KNOTHE_EXPORT )?(\w+)", (REPOSITORY / header).read_text(), re.MULTILINE)
            declared += re.findall(r"KNOTHE_EXPORT \w+ (\w+)\(", (REPOSITORY / header).read_text())
            self.assertEqual([name for name in declared if f'id="_CPPv4N6knothe{len(name)}{name}E' not in page], [], header)

    def test_without_doxygen_the_page_of_cpp_says_what_is_left_out(self):
        python = self.python_of_sphinx()
        done = subprocess.run([python, "-m", "sphinx", "-b", "text", "-q", "-d", self.folder / "cache", "-D", "exclude_patterns=_static,"
                               "benchmarks,explanation,how-to,tutorials,reference/[!ci]*", DOCS, self.folder / "text",
                               DOCS / "reference/cpp.md"], capture_output=True, text=True, timeout=280, env={**os.environ, "PATH": ""})
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        page = (self.folder / "text/reference/cpp.txt").read_text()
        self.assertRegex(page, r"knothe::TransportMap: left out here; Debian's doxygen and\s+python3-breathe were not installed")

    def test_the_pages_build_without_a_warning_and_work_without_a_network(self):
        html = self.build_pages()
        version = self.expect(0, "--version").out.split()[1]
        self.assertIn(f"knothe {version}", (html / "index.html").read_text())
        # No page loads a script, a style sheet, a font or a picture from elsewhere.
        for page in [*html.rglob("*.html"), *html.rglob("*.css")]:
            loads = re.findall(r"<(?:script|img|iframe)\b[^>]*\bsrc=\"(?:https?:)?//[^\"]*|<link\b[^>]*\bhref=\"(?:https?:)?//[^\"]*|"
                               r"(?:url\(|@import)\s*['\"]?(?:https?:)?//[^)]*", page.read_text())
            self.assertEqual(loads, [], page)
        self.check_reference_of_interfaces(html / "reference")
        if not os.path.exists(CHROMIUM):
            self.skipTest(f"{CHROMIUM} is not installed: search and equations were not looked at")
        # The theme's own style sheet and script come from the folder too.
        self.assertNotIn("url(/", (html / "_static/styles/furo.css").read_text())
        found, _ = self.shown(f"file://{html}/how-to/python.html")
        self.assertRegex(found, r'<body data-theme="(light|dark)"')
        self.assertIn('<button class="copy" type="button">copy</button>', found)
        self.assertIn("_static/favicon.svg", found)
        found, asked = self.shown(f"file://{html}/search.html?q=effective+sample+size")
        self.assertTrue(re.search(r"href=\"explanation/assimilation\.html", found), "the search does not find the page")
        for name in ("Twin", "TransportMap"):
            found, asked_for_it = self.shown(f"file://{html}/search.html?q={name}")
            self.assertTrue(re.search(rf"href=\"reference/python\.html#knothe\.{name}\"", found), f"the search does not find {name}")
            self.assertEqual(asked_for_it, [])
        equations, asked_too = self.shown(f"file://{html}/explanation/method.html")
        self.assertTrue(re.search(r"<svg [^>]*role=\"img\"", equations), "equations are not drawn")
        self.assertFalse(re.search(r"Math Processing Error|class=\"merror", equations), "an equation is wrong")
        self.assertEqual(asked + asked_too, [])
        run_part(self, "manual", KNOTHE_MANUAL=str(html))

    def test_changelog_and_citation_have_the_version_of_the_program(self):
        version = self.expect(0, "--version").out.split()[1]
        newest = re.search(r"^## (\d+\.\d+\.\d+)", (REPOSITORY / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
        self.assertEqual(newest, version)
        self.assertIn(f"\nversion: {version}\n", (REPOSITORY / "CITATION.cff").read_text())

    def test_the_page_of_commands_has_all_commands(self):
        page = (DOCS / "reference/commands.md").read_text()
        listed = self.expect(0, "--help").out.split("Subcommands:")[1]
        for command in re.findall(r"^  ([a-z]+) ", listed, re.MULTILINE):
            self.assertRegex(page, f"`knothe {command}[ `]")
        for command in re.findall(r"^  ([a-z-]+) ", self.expect(0, "model", "--help").out.split("Subcommands:")[1], re.MULTILINE):
            self.assertIn(f"`knothe model {command} ", page)

    def run_page(self, page):
        """All blocks of a page in one shell, at ports that are free; what it printed has to be what the page says."""
        ports = {port: str(free_port()) for port in ("8080", "4242")}
        script = ["set -euo pipefail"]
        expected = []
        for number, (language, text) in enumerate(blocks_of(page)):
            text = re.sub("8080|4242", lambda port: ports[port[0]], text)
            named = re.match(r"# ([\w.]+\.(?:toml|py))\b.*\n", text)
            if language in ("toml", "py") and named:
                (self.folder / f"block-{number}").write_text(text)
                script.append(f"cp block-{number} {named[1]}")
            elif language == "sh":
                script += [f"echo '<block {number}>'", text]
                expected.append((number, ""))
            elif language == "text":
                expected[-1] = expected[-1][0], text
        path = os.pathsep.join([os.path.dirname(KNOTHE), os.path.dirname(python_with("h5py", "numpy") or sys.executable), os.environ["PATH"]])
        run = subprocess.Popen(["bash", "-c", "\n".join(script)], cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                               start_new_session=True, env={**os.environ, "PATH": path})
        try:
            out, _ = run.communicate(timeout=280)
        finally:  # what the page has started in the background
            try:
                os.killpg(run.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        self.assertEqual(run.returncode, 0, out[-4000:])
        for number, lines in expected:
            printed = out.split(f"<block {number}>\n", 1)[1].split("<block ", 1)[0]
            for line in lines.splitlines():
                self.assertTrue(was_printed(line, printed), f"{page.name}: not printed by block {number}: {line}\n{printed}")

    def need_offline(self):
        if not pathlib.Path(KNOTHE).with_name("knothe-offline").exists():
            self.skipTest("knothe-offline was not built")

    def test_the_tutorial_of_beam(self):
        self.need_offline()
        self.run_page(DOCS / "tutorials/beam.md")
        self.assertTrue((self.folder / "report.html").exists())

    def test_the_tutorial_of_pictures(self):
        if python_with("numpy") is None:
            self.skipTest("no python3 with numpy here")
        self.run_page(DOCS / "tutorials/own-pictures.md")

    def test_the_tutorial_of_solver(self):
        self.need_offline()
        self.run_page(DOCS / "tutorials/own-solver.md")
        self.assertTrue((self.folder / "report.html").exists())

    def test_the_tutorial_of_a_black_box(self):
        self.run_page(DOCS / "tutorials/own-black-box.md")

    def test_the_tutorial_of_service(self):
        self.need_offline()
        if python_with("h5py", "numpy") is None:
            self.skipTest("no python3 with h5py here")
        self.run_page(DOCS / "tutorials/live.md")

    # What the C++ blocks of a page of the explanation take for granted: headers, and the arguments that each block stands among.
    CPP = {"transport": ("posterior/map/solve/map_solver.hpp posterior/map/solve/kl_objective.hpp posterior/map/samples/map_distribution.hpp "
                         "numerics/optimise/trust_region.hpp", "posterior",
                         ("LogDensity& target",
                          "const Eigen::VectorXd& a, const Eigen::MatrixXd& x, const Eigen::MatrixXd& z",
                          "LogDensity& target, const AffineMap& pre_map, Eigen::VectorXd& a",
                          "MapResult& result, int seed, const Eigen::MatrixXd& z, const Eigen::VectorXd& given"))}

    def test_the_cpp_of_the_explanation_compiles(self):
        compiler = shutil.which("c++")
        if compiler is None:
            self.skipTest("no C++ compiler here")
        for page, (headers, room, arguments) in self.CPP.items():
            blocks = [text for language, text in blocks_of(DOCS / f"explanation/{page}.md") if language == "cpp"]
            self.assertEqual(len(blocks), len(arguments), page)
            text = "#include <iostream>\n" + "".join(f'#include "knothe/{header}"\n' for header in headers.split())
            text += f"using namespace knothe;\nusing namespace knothe::{room};\n"
            text += "".join(f"void block_{k}({given}) {{\n{block}}}\n" for k, (block, given) in enumerate(zip(blocks, arguments)))
            (self.folder / f"{page}.cpp").write_text(text)
            done = subprocess.run([compiler, "-std=c++20", "-fsyntax-only", "-I", REPOSITORY, "-isystem", "/usr/include/eigen3",
                                   self.folder / f"{page}.cpp"], capture_output=True, text=True, timeout=200)
            self.assertEqual(done.returncode, 0, done.stderr[:3000])

    def test_all_cpp_of_the_explanation_is_compiled(self):
        pages = {page.stem for page in (DOCS / "explanation").glob("*.md") if any(language == "cpp" for language, _ in blocks_of(page))}
        self.assertEqual(pages, set(self.CPP))

    @functools.lru_cache(maxsize=None)
    def help_of(self, *command):
        return self.expect(0, *command, "--help").out

    def test_every_command_on_a_page_has_the_options_that_it_is_given(self):
        checked = 0
        for page in [REPOSITORY / "README.md", *DOCS.rglob("*.md")]:
            for line in commands_of(page):
                words = shlex.split(re.sub(r"[\[\]…]", " ", line))[1:]
                command = words[:2] if words[0] == "model" else words[:1]
                self.assertNotIn("SUBCOMMAND", self.help_of(*command).splitlines()[1], f"{page.name}: {line}")
                for option in re.findall(r"(?<= )(--?[a-z][\w-]*)", " ".join(words)):
                    self.assertRegex(self.help_of(*command), rf"(?m)^\s*(-\w,)?{option}\b|,{option}\b|-o,", f"{page.name}: {line}")
                checked += 1
        self.assertGreater(checked, 40)

    def test_the_projects_on_pages_are_valid(self):
        """`knothe check` of every `toml` block: as it stands, or as part of a project that has what it leaves out."""
        if not (pathlib.Path(KNOTHE).parent / "knothe-offline").exists():
            self.skipTest("knothe-offline is not built")
        priors = "[parameters]\n" + "".join(f'{name} = {{ prior = "normal", mean = 1.0, std = 0.2 }}\n' for name in ("Y0", "Ad"))
        grid = "\n[offline.parameters]\n" + "".join(f"{name} = {{ reference = {value}, lower = 0.5, upper = 1.5, nodes = 5 }}\n"
                                                    for name, value in (("Y0", 216), ("Ad", 2e-3)))
        own = "[offline.parameters]\np = { reference = 1, lower = 0.5, upper = 1.5, nodes = 5 }\n"
        files = 'model = "m.h5"\ndata = "d.h5"\n'
        around = (("", ""), (files + priors, ""), (priors, ""), ("", grid), (own, ""), (files, ""))
        project, checked = self.folder / "project.toml", 0
        for page in [REPOSITORY / "README.md", *DOCS.rglob("*.md")]:
            for text in (text for language, text in blocks_of(page) if language == "toml"):
                faults = []
                for before, behind in around:
                    project.write_text(before + text + behind)
                    outcome = self.run_knothe("check", project)
                    if outcome.status == 0 or "there is no file" in outcome.err:  # of the solver on that page
                        break
                    faults.append(outcome.err)
                else:
                    self.fail(f"{page.name}: no project:\n{text}\n{chr(10).join(faults)}")
                checked += 1
        self.assertGreater(checked, 15)


if __name__ == "__main__":
    program = unittest.main(exit=False)
    sys.exit(exit_status(program.result))

"""What the cases share: running the programs as a user does, in a folder of their own, and looking at what they leave.

The environment says where things are (tests/cases/CMakeLists.txt sets it):
KNOTHE, KNOTHE_OFFLINE (empty where it was not built), KNOTHE_CASES_FIXTURES, KNOTHE_DATA_TO_CSV.
"""
import contextlib
import csv
import fcntl
import functools
import json
import math
import os
import pathlib
import pty
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import termios
import unittest

KNOTHE = os.environ["KNOTHE"]
FIXTURES = pathlib.Path(os.environ["KNOTHE_CASES_FIXTURES"])
SOURCE = pathlib.Path(__file__).resolve().parent
REPOSITORY = SOURCE.parent.parent
# Recorded data are not in the repository: a case without them is skipped and says so.
DATA = pathlib.Path(os.environ.get("KNOTHE_DATA") or REPOSITORY.parent / "shared" / "data")


def by_form(in_short, in_long):
    """A long test has two forms of one body: the short one in `make test`, and `….slow`, which sets KNOTHE_SLOW (CMakeLists.txt)."""
    return in_long if "KNOTHE_SLOW" in os.environ else in_short


@functools.lru_cache(maxsize=None)
def python_with(*modules):
    """An interpreter that has these modules (Debian's packages are for /usr/bin/python3), None where there is none."""
    for program in (sys.executable, "/usr/bin/python3"):
        if subprocess.run([program, "-c", "import " + ", ".join(modules)], capture_output=True).returncode == 0:
            return program
    return None


class Outcome:
    """Exit status, stdout and stderr of a program that has ended."""

    def __init__(self, completed):
        self.status, self.out, self.err = completed.returncode, completed.stdout, completed.stderr

    def __str__(self):
        return f"exit status {self.status}\n--- stdout\n{self.out[-2000:]}\n--- stderr\n{self.err[-4000:]}"

    def lines(self):
        """stdout as JSON lines and nothing else; numbers finite."""
        return [parse_line(line) for line in self.out.splitlines()]


def parse_line(line):
    def refuse(word):
        raise ValueError(f"{word} in {line[:200]}")

    value = json.loads(line, parse_constant=refuse)
    assert isinstance(value, dict), line
    require_finite(value)
    return value


def require_finite(value):
    if isinstance(value, dict):
        for entry in value.values():
            require_finite(entry)
    elif isinstance(value, list):
        for entry in value:
            require_finite(entry)
    else:
        assert value is not None, "null"
        assert not isinstance(value, float) or math.isfinite(value), value


class Case(unittest.TestCase):
    """A test with an empty folder; `project` names the case's project file, `fixture` the folder whose files it needs."""

    project_name = None
    fixture = None
    maxDiff = 4000

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="knothe-case-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        if self.project_name:
            shutil.copy(SOURCE / self.project_name, self.folder / self.project_name)
        if self.fixture:
            for file in (FIXTURES / self.fixture).iterdir():
                if file.suffix in (".h5", ".csv"):
                    (self.folder / file.name).symlink_to(file)

    @property
    def project(self):
        return self.folder / self.project_name

    def edit(self, old, new, count=1):
        """Replaces `old`, which must be there, in this test's copy of the project file."""
        text = self.project.read_text()
        self.assertIn(old, text)
        self.project.write_text(text.replace(old, new, count))

    def position_of(self, text, after=""):
        """ "line:column" of `text` in the project file, as an error message gives it; the first one behind `after`."""
        content = self.project.read_text()
        before = content[:content.index(text, content.index(after))]
        return f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"

    def own_copy(self, name):
        """Makes a linked fixture file this test's own, to spoil it."""
        path = self.folder / name
        content = path.read_bytes()
        path.unlink()
        path.write_bytes(content)
        return path

    def run_knothe(self, *arguments, program=KNOTHE, **options):
        options.setdefault("cwd", self.folder)
        options.setdefault("timeout", 280)
        completed = subprocess.run([program, *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True,
                                   text=True, encoding="utf-8", **options)
        return Outcome(completed)

    def expect(self, status, *arguments, stderr=(), **options):
        """Runs knothe; the exit status must be `status`, and each text of `stderr` be in the message."""
        outcome = self.run_knothe(*arguments, **options)
        self.assertEqual(outcome.status, status, str(outcome))
        for text in [stderr] if isinstance(stderr, str) else stderr:
            self.assertIn(text, outcome.err, str(outcome))
        if status not in (0, 8, 130):
            self.assertTrue(outcome.err.endswith("\n") and outcome.err.strip(), "an error says something")
            self.assertNotIn("internal error", outcome.err)
            self.assertEqual(outcome.out, "")
        return outcome

    def on_terminal(self, status, *arguments, **environment):
        """What knothe writes on a terminal of 80 columns: stdout and stderr as they come; the exit status must be `status`."""
        master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        known = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "TERM")}
        process = subprocess.Popen([KNOTHE, *map(str, arguments)], cwd=self.folder, stdin=subprocess.DEVNULL, stdout=slave, stderr=slave,
                                   env={**known, "TERM": "xterm", **environment})
        os.close(slave)
        written = b""
        with contextlib.suppress(OSError):  # the end of a terminal
            while piece := os.read(master, 65536):
                written += piece
        os.close(master)
        self.assertEqual(process.wait(), status)
        return written.decode().replace("\r\n", "\n")

    @contextlib.contextmanager
    def running(self, *arguments, program=KNOTHE):
        """A running knothe and its stdout: a pipe of one page, so that it cannot get further ahead of who reads than that,
        however fast it is. Who has read a line reads the rest from there too: `communicate` would miss what was read ahead."""
        reader, writer = os.pipe()
        fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)  # before anything is in it
        with open(reader, encoding="utf-8") as out:
            process = subprocess.Popen([program, *map(str, arguments)], cwd=self.folder, stdin=subprocess.DEVNULL, stdout=writer,
                                       stderr=subprocess.PIPE, text=True)
            os.close(writer)
            with process:
                try:
                    yield process, out
                finally:
                    process.kill()

    def interrupt_after_first_line(self, *arguments):
        """Ctrl-C when the first line is there; all lines, and what was said."""
        with self.running(*arguments) as (process, out):
            text = out.readline()
            process.send_signal(signal.SIGINT)
            text += out.read()
            _, message = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 130, message)
        return [parse_line(line) for line in text.splitlines()], message

    def assimilate(self, *arguments, status=0, **options):
        """The step lines of `knothe assimilate --json`, the last line checked and taken off; 8: its verdict is reject."""
        lines = self.expect(status, "assimilate", self.project_name, "--json", *arguments, **options).lines()
        last = lines.pop()
        self.assertEqual(list(last), ["done", "steps", "verdict", "untrusted", "elapsed_s"])
        self.assertIs(last["done"], True)
        self.assertEqual(last["steps"], len(lines))
        self.assertEqual(last["untrusted"], [line["step"] for line in lines if not line["trusted"]])
        return lines

    def expect_agreement(self, lines, judge, mean=0.02, std=0.02, evidence=0.02, quantile=0.1):
        """Issue 2, accuracy: mean and outer quantiles in the judge's std, std relative, log-evidence absolute."""
        self.assertEqual([line["step"] for line in lines], [line["step"] for line in judge])
        faults = []
        for line, exact in zip(lines, judge):
            for k, exact_mean in enumerate(exact["mean"]):
                sigma = math.sqrt(exact["covariance"][k][k])
                where = f"step {line['step']} parameter {k} (order {line['map_order']}, ess {line['ess']:.4f})"
                shift = abs(line["mean"][k] - exact_mean) / sigma
                wrong = abs(math.sqrt(line["covariance"][k][k]) / sigma - 1)
                if shift > mean:
                    faults.append(f"{where}: mean off by {shift:.4f} std")
                if std is not None and wrong > std:
                    faults.append(f"{where}: std wrong by {100 * wrong:.2f} %")
                for level in (0, 4) if quantile is not None else ():
                    off = abs(line["quantiles"]["values"][k][level] - exact["quantiles"]["values"][k][level]) / sigma
                    if off > quantile:
                        faults.append(f"{where}: quantile {line['quantiles']['levels'][level]} off by {off:.3f} std")
            if std is not None and abs(correlation(line) - correlation(exact)) > 0.02:
                faults.append(f"step {line['step']}: correlation {correlation(line)} instead of {correlation(exact)}")
            if evidence is not None and abs(line["log_evidence"] - exact["log_evidence"]) > evidence:
                faults.append(f"step {line['step']}: log_evidence {line['log_evidence']} instead of {exact['log_evidence']}")
        self.assertFalse(faults, "\n".join(faults))

    def expect_same_as_the_last_step(self):
        """`infer` takes all data at once, `assimilate` one after the other: by quadrature both are exact."""
        one = self.expect(0, "infer", self.project_name, "--json", "--method", "grid").lines()[-1]
        other = self.assimilate("--method", "grid")[-1]
        for k in range(len(one["mean"])):
            std = other["covariance"][k][k] ** 0.5
            self.assertLess(abs(one["mean"][k] - other["mean"][k]), 1e-6 * std)
            self.assertLess(abs(one["covariance"][k][k] ** 0.5 - std), 1e-6 * std)
        self.assertAlmostEqual(one["log_evidence"], other["log_evidence"], delta=1e-6)

    def expect_nothing_but(self, folder, names):
        """No partial file, hidden or not, is left in `folder`."""
        self.assertEqual(sorted(p.name for p in pathlib.Path(folder).iterdir()), sorted(names))


class CaseInItsFolder(Case):
    """A case of the package for Python: the test's folder is the working folder."""

    def setUp(self):
        super().setUp()
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)

    def refused(self, kind, *texts, call):
        with self.assertRaises(kind) as caught:
            call()
        for text in texts:
            self.assertIn(text, str(caught.exception))


def correlation(line):
    """Of the first two parameters."""
    c = line["covariance"]
    return c[0][1] / math.sqrt(c[0][0] * c[1][1]) if len(c) > 1 else 0.0


def without_times(value):
    """The line without when it was computed and how long that took."""
    if isinstance(value, dict):
        return {key: without_times(entry) for key, entry in value.items() if not key.startswith("elapsed") and key != "wall_clock"}
    if isinstance(value, list):
        return [without_times(entry) for entry in value]
    return value


def exit_status(result):
    """77 tells CTest that a test was skipped; why, is printed."""
    for _, reason in result.skipped:
        print(f"skipped: {reason}")
    return 77 if result.skipped and result.wasSuccessful() else 0 if result.wasSuccessful() else 1


def read_csv(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def write_csv(path, rows):
    pathlib.Path(path).unlink(missing_ok=True)  # it may be a link to what other tests read
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, ["time", "sensor", "x", "y", "z", "component", "value", "std"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def replace_number(path, old, new):
    """Replaces the double `old` by `new` in a binary file: data sets are stored as they are in memory."""
    content = path.read_bytes()
    pattern = struct.pack("<d", old)
    assert content.count(pattern) == 1, f"{old} is {content.count(pattern)} times in {path}"
    path.write_bytes(content.replace(pattern, struct.pack("<d", new)))

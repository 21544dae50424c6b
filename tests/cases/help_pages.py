"""Manual pages and completion, as the packages have them, are made from --help: all commands, all options, and nothing that groff minds."""
import re
import shutil
import subprocess
import sys
import unittest

from support import KNOTHE, REPOSITORY, Case


class Test(Case):
    def setUp(self):
        super().setUp()
        subprocess.run([sys.executable, REPOSITORY / "scripts/help_pages.py", self.folder, KNOTHE], check=True)

    def commands(self, *words):
        """(words, options) of the program and of all its commands, read from --help in another way than the script's."""
        text = self.expect(0, *words, "--help").out
        yield words, set(re.findall(r"(?:^ +|,)(--[a-z][\w-]*)", text, re.MULTILINE))
        for name in re.findall(r"^  ([a-z][\w-]*) ", text.partition("Subcommands:\n")[2], re.MULTILINE):
            yield from self.commands(*words, name)

    def completed(self, *words):
        script = f'. "{self.folder}/completions/knothe"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _knothe; echo "${{COMPREPLY[*]}}"'
        done = subprocess.run(["bash", "-uc", script, "bash", "knothe", *words], check=True, capture_output=True, text=True)
        return set(done.stdout.split())

    def test_commands_and_options_are_completed(self):
        seen = 0
        for words, options in self.commands():
            self.assertEqual(self.completed(*words, "--"), options, words)
            seen += 1
        self.assertGreater(seen, 20)
        self.assertEqual(self.completed("assi"), {"assimilate"})
        self.assertEqual(self.completed("model", "ev"), {"evaluate"})
        self.assertEqual(self.completed("infer", "--method", ""), {"auto", "transport", "mcmc", "smc", "grid"})
        self.assertEqual(self.completed("assimilate", "--json", ""), set())  # a file: the shell completes that

    def completed_by_zsh(self, *words):
        """What zsh would offer: _describe and _files, zsh's own, are told apart by what they print."""
        script = f"""
          _describe() {{ print -rl -- "${{(@P)2}}" }}
          _files() {{ print -r -- FILES }}
          compdef() {{ }}
          words=("$@"); CURRENT=$#
          . "{self.folder}/completions/_knothe" """
        done = subprocess.run(["zsh", "-fc", script, "zsh", "knothe", *words], check=True, capture_output=True, text=True)
        self.assertEqual(done.stderr, "")
        return dict(line.partition(":")[::2] for line in done.stdout.splitlines())

    @unittest.skipUnless(shutil.which("zsh"), "no zsh")
    def test_zsh_has_the_same_with_what_they_mean(self):
        for words, options in self.commands():
            self.assertEqual(set(self.completed_by_zsh(*words, "--")), options, words)
        commands = self.completed_by_zsh("")
        self.assertEqual(set(commands), self.completed("") - {"--help", "--version"})
        self.assertIn("assimilation", commands["assimilate"])
        self.assertEqual(set(self.completed_by_zsh("infer", "--method", "")), self.completed("infer", "--method", ""))
        self.assertEqual(set(self.completed_by_zsh("assimilate", "--json", "")), {"FILES"})

    def test_the_page_has_all_of_it_and_groff_is_content(self):
        page = (self.folder / "knothe.1").read_text()
        plain = page.replace("\\-", "-")
        for words, options in self.commands():
            for option in options - {"--help"}:
                self.assertIn(option, plain, words)
            if words and words != ("model",):
                self.assertIn(f".SS knothe {' '.join(words)}", plain)
        for status in (0, 8, 130):
            self.assertIn(f"\\fB{status}\\fR", page.partition(".SH EXIT STATUS")[2])
        if shutil.which("groff"):
            done = subprocess.run(["groff", "-man", "-Tutf8", "-Kutf8", "-ww", "-z", self.folder / "knothe.1"], capture_output=True, text=True)
            self.assertEqual(done.returncode, 0)
            self.assertEqual(done.stderr, "")


if __name__ == "__main__":
    unittest.main()

"""knothe reproduce: what it says before it works, what an interruption leaves, the parts of the study on a coarse beam, and (at night) the
whole of --quick. The study is studies/reproduction, in Python."""
import json
import os
import pathlib
import signal
import subprocess
import time
import unittest

from support import KNOTHE, REPOSITORY, Case, python_with

MODULES = ("numpy", "h5py")
STUDY = REPOSITORY / "studies" / "reproduction"
# The package's folder of the build tree, as the study is given it.
PACKAGE = pathlib.Path(KNOTHE).resolve().parent.parent / "python"


def python_of_the_study():
    """An interpreter that can run it, or None."""
    python = python_with(*MODULES)
    if python is None:
        return None
    found = subprocess.run([python, "-c", "import knothe"], capture_output=True, env=dict(os.environ, PYTHONPATH=str(PACKAGE)))
    return python if found.returncode == 0 else None


class Test(Case):
    def need_python(self):
        python = python_of_the_study()
        if python is None:
            self.skipTest(f"no python3 with {', '.join(MODULES)} and the package knothe (Debian: python3-h5py)")
        return python

    def test_help_has_an_example_and_names_the_folder(self):
        text = self.expect(0, "reproduce", "--help").out
        for word in ("Example:", "knothe reproduce --quick", "reproduction/", "--json", "h5py"):
            self.assertIn(word, text)

    def test_what_cannot_be_is_refused_before_any_work(self):
        self.expect(2, "reproduce", "--fast")
        (self.folder / "taken").write_text("a file")
        self.expect(5, "reproduce", "--quick", "-o", "taken", stderr="taken")
        self.expect_nothing_but(self.folder, ["taken"])

    def test_without_python_it_says_how_to_run_the_study(self):
        (self.folder / "python3").write_text("#!/bin/sh\nexit 1\n")
        (self.folder / "python3").chmod(0o755)
        for python in ("python3", "nowhere"):  # without the modules; none at all
            self.expect(1, "reproduce", "--quick", "-o", "study", env=dict(os.environ, KNOTHE_PYTHON=str(self.folder / python)),
                        stderr=(python, "python3-h5py", "KNOTHE_PYTHON", "studies/reproduction --quick"))

    def test_an_interruption_keeps_the_runs_that_are_done(self):
        self.need_python()
        process = subprocess.Popen([KNOTHE, "reproduce", "--quick", "--json", "-o", "study"], cwd=self.folder,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   env=dict(os.environ, KNOTHE_THREADS="1"))
        parts = self.folder / "study" / "models" / "reference.h5.parts"
        deadline = time.monotonic() + 200
        while not (parts.is_dir() and list(parts.glob("*.h5"))) and time.monotonic() < deadline:
            self.assertIsNone(process.poll())
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 130, err)
        self.assertIn("kept", err)
        self.assertTrue(list(parts.glob("*.h5")))
        # The figure that needs no model is out already, as JSON lines and nothing else.
        self.assertIn('"figure": "5"', out)
        self.assertFalse((self.folder / "study" / "reproduce.html").exists())

    def test_its_parts_on_a_coarse_beam(self):
        python = self.need_python()
        done = subprocess.run([python, "-B", STUDY / "study_test.py"], cwd=self.folder, capture_output=True, text=True, timeout=280,
                              env=dict(os.environ, KNOTHE=KNOTHE, PYTHONPATH=str(PACKAGE)))
        self.assertEqual(done.returncode, 0, done.stderr[-4000:])

    def test_the_quick_study_is_complete(self):
        """Nightly: minutes. Every figure has rows; numbers are near the paper's where they should be."""
        self.need_python()
        lines = self.expect(0, "reproduce", "--quick", "--json", "-o", "study", timeout=1700).lines()
        last = lines.pop()
        self.assertIs(last["done"], True)
        figures = ["5", "6-7", "8-9", "10-12", "13", "14-15", "onset", "16-17", "18", "models", "supports", "choices"]
        self.assertEqual(list(dict.fromkeys(line["figure"] for line in lines)), figures)
        for line in lines:
            for key in ("quantity", "unit", "paper", "here", "why"):
                self.assertTrue(line[key], line)

        def value(figure, begins):
            (line,) = [l for l in lines if l["figure"] == figure and l["quantity"].startswith(begins)]
            return line["here_value"]

        self.assertAlmostEqual(value("8-9", "A_d: maximum"), 1, delta=0.05)
        self.assertAlmostEqual(value("8-9", "Y₀: maximum"), 1, delta=0.5)
        self.assertGreater(value("8-9", "CPU time"), 3)
        self.assertAlmostEqual(value("13", "the same, coarse"), 37.6, delta=3)
        self.assertGreater(value("14-15", "m = 3: the same"), 3)
        self.assertEqual(value("16-17", "chosen dofs right"), 100)
        record = json.loads((self.folder / "study" / "reproduce.json").read_text())
        self.assertEqual([figure["figure"] for figure in record["figures"]], figures)
        self.assertIn("</html>", (self.folder / "study" / "reproduce.html").read_text())


if __name__ == "__main__":
    unittest.main()

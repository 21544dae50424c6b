"""knothe reproduce: what it says before it works, and what an interruption leaves. Its parts are tested in knothe/reproduction."""
import json
import os
import signal
import subprocess
import time
import unittest

from support import KNOTHE, Case


class Test(Case):
    def test_help_has_an_example_and_names_the_folder(self):
        text = self.expect(0, "reproduce", "--help").out
        for word in ("Example:", "knothe reproduce --quick", "reproduction/", "--json"):
            self.assertIn(word, text)

    def test_what_cannot_be_is_refused_before_any_work(self):
        self.expect(2, "reproduce", "--fast")
        (self.folder / "taken").write_text("a file")
        self.expect(5, "reproduce", "--quick", "-o", "taken", stderr="taken")
        self.expect_nothing_but(self.folder, ["taken"])

    def test_an_interruption_keeps_the_runs_that_are_done(self):
        process = subprocess.Popen([KNOTHE, "reproduce", "--quick", "--json", "-o", "study"], cwd=self.folder,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   env=dict(os.environ, KNOTHE_THREADS="1"))
        parts = self.folder / "study" / "models" / "reference.parts"
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
        self.assertIn('"figure":"5"', out)
        self.assertFalse((self.folder / "study" / "reproduce.html").exists())

    def test_the_quick_study_is_complete(self):
        """Nightly: minutes. Every figure has rows; numbers are near the paper's where they should be."""
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

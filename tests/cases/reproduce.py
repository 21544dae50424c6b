"""knothe reproduce: what it says before it works, and what an interruption leaves. Its parts are tested in knothe/reproduction."""
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
        deadline = time.monotonic() + 100
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


if __name__ == "__main__":
    unittest.main()

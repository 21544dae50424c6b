"""A disk that is full, a folder that cannot be made: exit status 5, and no partial file under the final name."""
import resource
import shutil
import signal
import subprocess
import unittest

from support import KNOTHE, Case, Outcome

NOTHING_LEFT = "%left:"


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def expect_full(self, kibibytes, *arguments):
        """Runs knothe where `out/` has so much room only: a small file system of its own, or else a limit on the size of files."""
        out = self.folder / "out"
        out.mkdir()
        if shutil.which("unshare") and subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode == 0:
            script = (f"mount -t tmpfs -o size={kibibytes}k none out || exit 99; \"$@\"; status=$?; "
                      f"echo '{NOTHING_LEFT}' $(find out -type f) >&2; exit $status")
            ended = subprocess.run(["unshare", "-m", "sh", "-c", script, "sh", KNOTHE, *arguments], cwd=self.folder,
                                   capture_output=True, text=True, timeout=60)
            if ended.returncode != 99:
                left = ended.stderr.partition(NOTHING_LEFT)[2].split()
                return self.check(Outcome(ended), left, "No space left on device")

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # then writing fails, as on a full disk
            resource.setrlimit(resource.RLIMIT_FSIZE, (1024 * kibibytes, 1024 * kibibytes))

        outcome = self.run_knothe(*arguments, preexec_fn=limit, restore_signals=False)
        return self.check(outcome, [str(p) for p in out.rglob("*") if p.is_file()], "File too large")

    def check(self, outcome, left, cause):
        self.assertEqual(outcome.status, 5, str(outcome))
        self.assertIn("out/", outcome.err)
        self.assertNotIn("internal error", outcome.err)
        return left, cause, outcome

    def test_a_model_is_written_whole_or_not_at_all(self):
        left, cause, outcome = self.expect_full(16, "model", "import", "snapshots.h5", "-o", "out/new.h5")
        self.assertEqual(left, [])
        self.assertIn(cause, outcome.err)

    def test_simulated_data_are_written_whole_or_not_at_all(self):
        left, cause, outcome = self.expect_full(4, "simulate", self.project_name, "--model", "model.h5", "-o", "out/d.h5")
        self.assertEqual(left, [])
        self.assertIn(cause, outcome.err)

    def test_a_field_is_written_whole_or_not_at_all(self):
        left, cause, outcome = self.expect_full(4, "model", "evaluate", "model.h5", "--at", "Y0=1,Ad=1", "--step", "3", "-o", "out/f.vtu")
        self.assertEqual(left, [])
        self.assertIn(cause, outcome.err)

    def test_results_are_written_whole_or_not_at_all(self):
        left, _, _ = self.expect_full(256, "assimilate", self.project_name, "-o", "out/results")
        self.assertNotIn("out/results/posterior.nc", left)
        self.assertFalse([name for name in left if name.endswith(".part")], left)

    def test_a_report_is_written_whole_or_not_at_all(self):
        self.expect(0, "assimilate", self.project_name)
        left, cause, outcome = self.expect_full(8, "report", "results", "-o", "out/report.html")
        self.assertEqual(left, [])
        self.assertIn(cause, outcome.err)

    def test_a_results_folder_that_cannot_be_made_is_an_io_error(self):
        (self.folder / "file").write_text("in the way\n")
        self.expect(5, "assimilate", self.project_name, "--json", "-o", "file/results", stderr="file/results")
        self.assertEqual((self.folder / "file").read_text(), "in the way\n")

    def test_a_model_that_cannot_be_written_is_an_io_error(self):
        (self.folder / "file").write_text("in the way\n")
        self.expect(5, "model", "import", "snapshots.h5", "-o", "file/new.h5", stderr="file")

    def test_an_older_file_survives_a_failed_writing(self):
        """The last good model is better than none."""
        model = self.own_copy("model.h5")
        before = model.read_bytes()

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (16384, 16384))

        self.expect(5, "model", "import", "snapshots.h5", "-o", "model.h5", stderr="model.h5", preexec_fn=limit, restore_signals=False)
        self.assertEqual(model.read_bytes(), before)
        self.assertFalse(list(self.folder.glob(".*.part")))


if __name__ == "__main__":
    unittest.main()

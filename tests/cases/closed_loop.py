"""examples/driven_test/closed_loop.py, as its page shows it (docs/how-to/drive-a-machine.md); in the short form with the model of beam.toml,
which is so coarse that the data may reject it.
"""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

from support import FIXTURES, REPOSITORY, Case, by_form, exit_status

EXAMPLE = REPOSITORY / "examples" / "driven_test" / "closed_loop.py"
PAGE = REPOSITORY / "docs" / "how-to" / "drive-a-machine.md"


@unittest.skipUnless(shutil.which("node"), "node is not installed")
class Test(Case):
    project_name = "beam.toml"
    fixture = "beam"

    def test_the_loop_closes_and_the_specimen_is_whole(self):
        folder = self.folder / "loop"
        folder.mkdir()
        if by_form(True, False):
            shutil.copy(FIXTURES / "beam" / "model.h5", folder / "beam.h5")
        tools = os.pathsep.join([str(pathlib.Path(os.environ["KNOTHE"]).parent), os.environ["PATH"]])
        done = subprocess.run([sys.executable, EXAMPLE, "--folder", folder, "--rate", "1"], capture_output=True, text=True, check=False, timeout=1000,
                              env={**os.environ, "PATH": tools})
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr[-4000:])
        self.assertIn("/ is the live page; ", done.stderr)
        lines = done.stdout.splitlines()
        self.assertEqual([line.split(":")[0] for line in lines[:4]], ["commands", "held", "posterior", "specimen"], done.stdout)
        self.assertRegex(lines[3], "did not fail: its crack is .* failure, from 0[.][0-9]+ mm on")
        spool = [json.loads(line) for line in (folder / "spool.jsonl").read_text().splitlines()]
        orders = [entry for entry in spool if "action" in entry]
        self.assertTrue(lines[0].startswith(f"commands:  {len(orders)} sent, {len(orders)} acknowledged; loaded to 0.0"), lines[0])
        if by_form(False, True):
            page = re.search("```text\n(.*?)```", PAGE.read_text(), re.S)[1].splitlines()
            for shown, line in zip(page, lines, strict=True):
                self.assertTrue(line.startswith(shown.rstrip("…")), f"{shown}\n{line}")


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False, verbosity=2).result))

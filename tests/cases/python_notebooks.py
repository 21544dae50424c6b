"""The notebooks of examples/notebooks run from top to bottom, as `jupyter nbconvert --execute` does it, and are committed without outputs."""
import base64
import json
import os
import pathlib
import subprocess
import sys
import unittest

try:
    import ipykernel  # noqa: F401
    import matplotlib  # noqa: F401
    import nbconvert  # noqa: F401
    import numpy  # noqa: F401
    import xarray  # noqa: F401
except ImportError as missing:
    print(f"skipped: {sys.executable} has no {missing.name} (Debian: python3-{missing.name})")
    sys.exit(77)

from support import Case, KNOTHE, REPOSITORY

NOTEBOOKS = REPOSITORY / "examples" / "notebooks"


class Test(Case):
    def execute(self, name):
        """Runs a notebook; its pictures go to the folder KNOTHE_KEEP_FIGURES, if that is set (docs/images/notebook-*.png)."""
        environment = {**os.environ, "PATH": f"{pathlib.Path(KNOTHE).parent}:{os.environ['PATH']}", "JUPYTER_PLATFORM_DIRS": "1",
                       "TMPDIR": str(self.folder), "HOME": str(self.folder)}
        environment.pop("MPLBACKEND", None)  # pictures go into the notebook
        done = subprocess.run(
            [sys.executable, "-m", "nbconvert", "--to", "notebook", "--execute", "--ExecutePreprocessor.timeout=250",
             "--output-dir", str(self.folder), "--output", f"{name}.ipynb", str(NOTEBOOKS / f"{name}.ipynb")],
            env=environment, cwd=NOTEBOOKS, capture_output=True, text=True, timeout=280)
        self.assertEqual(done.returncode, 0, done.stderr[-3000:])
        cells = json.loads((self.folder / f"{name}.ipynb").read_text())["cells"]
        pictures = [output["data"]["image/png"] for cell in cells for output in cell.get("outputs", ()) if "image/png" in output.get("data", {})]
        self.assertTrue(pictures)
        kept = os.environ.get("KNOTHE_KEEP_FIGURES")
        for number, picture in enumerate(pictures if kept else ()):
            (pathlib.Path(kept) / f"notebook-{name}-{number}.png").write_bytes(base64.b64decode(picture))

    def test_beam(self):
        if not (pathlib.Path(KNOTHE).parent / "knothe-offline").exists():
            self.skipTest("knothe-offline is not built")
        self.execute("beam")

    def test_own_model(self):
        self.execute("own_model")

    def test_own_pictures(self):
        self.execute("own_pictures")

    def test_transport_maps(self):
        self.execute("transport_maps")

    def test_umbridge(self):
        self.execute("umbridge")

    def test_each_is_run_and_has_no_outputs(self):
        tested = {name[len("test_"):] for name in dir(self) if name.startswith("test_")}
        for path in NOTEBOOKS.glob("*.ipynb"):
            self.assertIn(path.stem, tested)
            for cell in json.loads(path.read_text())["cells"]:
                self.assertFalse(cell.get("outputs") or cell.get("execution_count"), f"{path.name}: strip the outputs before committing")


if __name__ == "__main__":
    unittest.main()

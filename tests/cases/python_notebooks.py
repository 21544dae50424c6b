"""The notebooks of examples/notebooks run from top to bottom, as `jupyter nbconvert --execute` does it, and print what is committed in them.

Committed are the outputs that are text; numbers, which depend on the machine, are not compared. To write them anew:
KNOTHE_WRITE_NOTEBOOKS=1 ctest --test-dir build/release -R cases.python_notebooks
"""
import base64
import json
import os
import pathlib
import re
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


def text_outputs(cell):
    """What a cell prints or shows, as text alone."""
    outputs = []
    for output in cell.get("outputs", ()):
        text = "".join(output.get("text", ()) if output["output_type"] == "stream" else output.get("data", {}).get("text/plain", ()))
        if output.get("name") != "stderr" and text and not text.startswith("<Figure size"):
            outputs.append(re.sub(r"/\S*/knothe-\S*/", "…/", text))
    return "".join(text if text.endswith("\n") else f"{text}\n" for text in outputs)


def without_numbers(text):
    """Words, and where numbers stand; a table's columns are as wide as its numbers."""
    return re.sub(r"[ ─━-]{2,}", "  ", re.sub(r"[-+−]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+|·10[⁻⁰¹²³⁴-⁹]+)?", "#", text))


class Test(Case):
    maxDiff = None

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
        self.compare(NOTEBOOKS / f"{name}.ipynb", cells)
        kept = os.environ.get("KNOTHE_KEEP_FIGURES")
        for number, picture in enumerate(pictures if kept else ()):
            (pathlib.Path(kept) / f"notebook-{name}-{number}.png").write_bytes(base64.b64decode(picture))

    def compare(self, path, cells):
        """The committed notebook's outputs with those of `cells`, or writes them into it."""
        notebook = json.loads(path.read_text())
        for number, (cell, executed) in enumerate(zip(notebook["cells"], cells, strict=True)):
            if cell["cell_type"] != "code":
                continue
            text = text_outputs(executed)
            if os.environ.get("KNOTHE_WRITE_NOTEBOOKS"):
                cell["outputs"] = [{"name": "stdout", "output_type": "stream", "text": text.splitlines(keepends=True)}] if text else []
            else:
                self.assertEqual(without_numbers(text_outputs(cell)), without_numbers(text), f"{path.name}, cell {number}: write it anew")
        if os.environ.get("KNOTHE_WRITE_NOTEBOOKS"):
            path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n")

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

    def test_each_is_run_and_can_be_read(self):
        tested = {name[len("test_"):] for name in dir(self) if name.startswith("test_")}
        for path in NOTEBOOKS.glob("*.ipynb"):
            self.assertIn(path.stem, tested)
            for cell in json.loads(path.read_text())["cells"]:
                self.assertFalse(cell.get("execution_count"), f"{path.name}: strip the counts before committing")
                for output in cell.get("outputs", ()):
                    self.assertEqual(output["output_type"], "stream", f"{path.name}: text alone is committed")
                    self.assertLessEqual(len(output["text"]), 40, f"{path.name}: more than a reader takes in")


if __name__ == "__main__":
    unittest.main()

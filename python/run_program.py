#!python
"""`knothe` of the wheel: runs the program in the package's folder, without importing the package."""
import importlib.util
import os
import pathlib
import sys

package = importlib.util.find_spec("knothe")
if package is None or package.origin is None:
    sys.exit("knothe: the package is not installed for this Python: `pip install knothe`")
program = pathlib.Path(package.origin).parent / "bin" / "knothe"
os.execv(program, ["knothe", *sys.argv[1:]])

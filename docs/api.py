"""Sphinx extension for the reference of the interfaces: Python's by autodoc from the docstrings of python/knothe, C++'s by Doxygen and
Breathe from the installed headers. Nothing has to be compiled for it; without Doxygen or Breathe its page says what is left out.
"""
import importlib.util
import pathlib
import shutil
import subprocess
import sys
import types

from docutils import nodes
from docutils.parsers.rst import Directive

SOURCE = pathlib.Path(__file__).resolve().parent.parent
HEADERS = ["knothe.hpp", "base/error.hpp", "library/posterior.hpp", "library/transport_map.hpp", "library/assimilation.hpp",
           "library/correlation.hpp"]
RESULTS = ("Posterior", "InferenceResult", "Forecast", "Verdict", "Reason", "Decision", "Displacements", "Results")
# The text after `@file` would be the name of a file for Doxygen.
DOXYGEN = """
INPUT = {headers}
INPUT_FILTER = "sed 's|@file |@file\\n/// |'"
OUTPUT_DIRECTORY = "{folder}"
GENERATE_HTML = NO
GENERATE_LATEX = NO
GENERATE_XML = YES
XML_PROGRAMLISTING = NO
MACRO_EXPANSION = YES
PREDEFINED = KNOTHE_EXPORT=
QUIET = YES
WARN_IF_UNDOCUMENTED = NO
WARN_AS_ERROR = FAIL_ON_WARNINGS
"""


class Compiled(types.ModuleType):
    """In place of what is compiled, of which the docstrings need no more than names."""

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


def prepare_python(version):
    """`import knothe` from the sources."""
    sys.path.insert(0, str(SOURCE / "python"))
    for module, attribute in (("knothe._version", "__version__"), ("knothe._knothe", "version")):
        sys.modules[module] = Compiled(module)
        setattr(sys.modules[module], attribute, version)


def plain_signature(app, what, name, each, options, signature, returns):
    """None for what only the library makes; types by their last name."""
    if what == "class" and (name.rpartition(".")[2] in RESULTS or (signature or "").startswith("(native")):
        return "", returns
    return tuple(text and text.replace("collections.abc.", "") for text in (signature, returns))


class LeftOut(Directive):
    """In place of Breathe's directives."""
    required_arguments, has_content = 1, True
    option_spec = dict.fromkeys(("members", "content-only", "undoc-members"), lambda argument: argument)

    def run(self):
        text = f"{self.arguments[0]}: left out here; Debian's doxygen and python3-breathe were not installed when these pages were made."
        return [nodes.note("", nodes.paragraph("", text))]


def prepare_cpp(app, config):
    if "breathe" not in config.extensions:
        return
    folder = pathlib.Path(app.doctreedir) / "doxygen"
    folder.mkdir(parents=True, exist_ok=True)
    headers = " ".join(f'"{SOURCE / "knothe" / header}"' for header in HEADERS)
    subprocess.run(["doxygen", "-"], input=DOXYGEN.format(headers=headers, folder=folder), text=True, check=True)
    config.breathe_projects = {"knothe": str(folder / "xml")}


def setup(app):
    prepare_python(app.config.version)
    app.connect("autodoc-process-signature", plain_signature)
    if shutil.which("doxygen") and importlib.util.find_spec("breathe"):
        app.setup_extension("breathe")
        app.config.extensions.append("breathe")
        app.connect("config-inited", prepare_cpp, priority=1)
    else:
        for directive in ("doxygenstruct", "doxygenclass", "doxygenfunction", "doxygenenum", "doxygenfile"):
            app.add_directive(directive, LeftOut)
    return {"parallel_read_safe": True}

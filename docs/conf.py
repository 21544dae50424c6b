"""Sphinx configuration of the documentation: `make docs` writes build/docs/index.html.

The pages work from a folder (file://) and ask nothing of the network: MathJax is copied from Debian's package libjs-mathjax.
"""
import pathlib
import re
import shutil
import sys

HERE = pathlib.Path(__file__).resolve().parent
MATHJAX = pathlib.Path("/usr/share/javascript/mathjax")
NORMALIZE = pathlib.Path("/usr/share/javascript/normalize.css/normalize.css")  # Debian's furo depends on it

project = "knothe"
author = "the knothe authors"
project_copyright = author
# The same line that `knothe --version` comes from.
version = release = re.search(r"project\(knothe VERSION ([\d.]+)", (HERE.parent / "CMakeLists.txt").read_text())[1]

sys.dont_write_bytecode = True  # nothing is left in the sources
sys.path.insert(0, str(HERE))
extensions = ["myst_parser", "sphinx.ext.mathjax", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "api", "options"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["_static"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_dmath_allow_space = False
myst_heading_anchors = 4

# The reference of Python and of C++ (api.py).
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
autodoc_mock_imports = ["numpy"]  # the docstrings need no more than its name
python_use_unqualified_type_names = True
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "Axes", "Picture", "Prior", "Steps")}
autodoc_typehints_format = "short"
add_module_names = False
default_role = "py:obj"
breathe_default_project = "knothe"
breathe_default_members = ("members", "undoc-members")
breathe_show_include = False

html_theme = "furo"
pygments_style = "xcode"  # contrasts that can be read (WCAG AA)
pygments_dark_style = "github-dark"
html_title = f"knothe {version}"
html_static_path = ["_static"]
html_css_files = ["knothe.css"]
html_favicon = "_static/favicon.svg"
html_copy_source = False
html_show_sphinx = False
highlight_language = "none"
suppress_warnings = ["misc.highlighting_failure"]  # C++ with an ellipsis is not C++

# MathJax 2 draws SVG with fonts of its own, which are scripts and so load from a folder too.
mathjax_path = "mathjax/MathJax.js?config=TeX-AMS_SVG"
mathjax2_config = {"messageStyle": "none", "showMathMenu": False, "tex2jax": {"processClass": "math"},
                   "SVG": {"font": "TeX", "linebreaks": {"automatic": True}}}
myst_update_mathjax = False  # that would be for MathJax 3
MATHJAX_PARTS = ["MathJax.js", "config/TeX-AMS_SVG.js", "extensions", "jax/element", "jax/input/TeX", "jax/output/SVG/autoload",
                 "jax/output/SVG/config.js", "jax/output/SVG/jax.js", "jax/output/SVG/fonts/TeX"]


def copy_mathjax(app, exception):
    """What the pages need of MathJax, 2 MB of 54, into the output."""
    if exception or app.builder.format != "html":
        return
    for part in MATHJAX_PARTS:
        source, target = MATHJAX / part, pathlib.Path(app.outdir) / "_static" / "mathjax" / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
        else:
            shutil.copy(source, target)


def mend_theme(app, exception):
    """Debian's furo asks the web server for normalize.css, and its script is a module: neither works from a folder."""
    static = pathlib.Path(app.outdir) / "_static"
    style = static / "styles" / "furo.css"
    if exception or app.builder.format != "html" or not style.exists():
        return
    shutil.copy(NORMALIZE, static / "styles" / "normalize.css")
    style.write_text(style.read_text().replace("url(/javascript/normalize.css/normalize.css)", "url(normalize.css)"))
    shutil.copy(HERE / "_static" / "knothe.js", static / "scripts" / "furo.js")


def setup(app):
    if not MATHJAX.is_dir():
        raise FileNotFoundError(f"{MATHJAX} is missing: install Debian's package libjs-mathjax (make docs does)")
    app.connect("build-finished", copy_mathjax)
    app.connect("build-finished", mend_theme)

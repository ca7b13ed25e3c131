"""How Sphinx builds the documentation: `sphinx-build -W -b html docs docs/_build`."""

import os
import sys
from pathlib import Path

from rigidmc.engine import compile_helper
from rigidmc.version import VERSION

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

# Two processes read pages, and tests may run beside them: no second process compiles for a page,
# which takes 1.5 s more of a processor. The kernels of notebooks learn it from IPython's files.
compile_helper.threads_available = lambda: 1
IPYTHON = Path(__file__).parent / "_build" / "ipython"
STARTUP = IPYTHON / "profile_default" / "startup"
STARTUP.mkdir(parents=True, exist_ok=True)
(STARTUP / "alone.py").write_text(
    "from rigidmc.engine import compile_helper\n"
    "compile_helper.threads_available = lambda: 1\n"
    "del compile_helper\n"
)
os.environ["IPYTHONDIR"] = str(IPYTHON)

project = "rigidmc"
author = "the rigidmc developers"
release = VERSION
html_title = f"rigidmc {VERSION}"

extensions = [
    "myst_nb",
    "sphinx_design",
    "sphinx-mathjax-offline",
    "sphinxcontrib.bibtex",
    "sphinx.ext.autodoc",
    "numpydoc",
    "commands",
    "links",
    "names",
    "pictures",
]
exclude_patterns = ["_build", "extensions", "static"]
nitpicky = True
smartquotes = False  # `--dt` keeps its two hyphens
autodoc_typehints = "none"
numpydoc_show_class_members = False
default_role = "code"  # of `words` in docstrings

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist", "attrs_block"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_timeout = 120
nb_execution_raise_on_error = True
bibtex_bibfiles = ["references.bib"]

html_static_path = ["static"]
html_css_files = ["wide.css"]
html_theme = "pydata_sphinx_theme"
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "footer_end": [],
}
html_show_sourcelink = False
html_sidebars = {
    name: []
    for name in ("first_ensemble", "gallery", "viewer", "comparison", "contributing", "changelog")
}


def setup(app):
    """Let two processes read the pages: this extension only copies files once all are built, and
    does not declare that it is safe."""
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True

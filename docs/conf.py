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
    "get_ipython().run_line_magic('precision', '%.6g')\n"  # of numbers that cells show
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
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "sphinx_llms_txt",
    "numpydoc",
    "commands",
    "links",
    "names",
    "notebooks",
    "pictures",
    "synonyms",
]
exclude_patterns = ["_build", "extensions", "static", "paper"]
nitpicky = True
smartquotes = False  # `--dt` keeps its two hyphens
autodoc_typehints = "none"
autosummary_generate = False  # `names` writes the pages
python_maximum_signature_line_length = 88  # longer ones have a line for each parameter
copybutton_exclude = ".linenos, .gp, .go"  # prompts and what a command prints are not copied
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
    "header_links_before_dropdown": 3,
}
html_show_sourcelink = False
html_sidebars = {
    name: []
    for name in (
        *("learn", "ensembles", "study", "first_ensemble", "gallery", "viewer"),
        *("comparison", "contributing", "changelog"),
    )
}
llms_txt_summary = (
    "rigidmc integrates ensembles of rigid bodies that turn about a fixed point or their centre of "
    "mass in parallel, and reports the drift of energy and |L|^2. From Python: import rigidmc as "
    "rm; rm.simulate(scene) returns an xarray Dataset. From the shell: rigidmc run SCENE."
)
# Where the workflow publishes the site, pages link to their sources and to other versions.
if REPOSITORY := os.environ.get("GITHUB_REPOSITORY"):
    owner, name = REPOSITORY.split("/")
    html_context = {
        "github_user": owner,
        "github_repo": name,
        "github_version": "main",
        "doc_path": "docs",
    }
    html_theme_options |= {
        "use_edit_page_button": True,
        # in the menu on a telephone: at 390 pixels the bar has no room for it
        "navbar_end": ["version-switcher", "theme-switcher", "navbar-icon-links"],
        "switcher": {
            "json_url": f"https://{owner.lower()}.github.io/{name}/versions.json",
            "version_match": os.environ.get("DOCS_VERSION", "dev"),
        },
        "check_switcher": False,  # the first site has none yet
    }


def setup(app):
    """Let two processes read the pages: this extension only copies files once all are built, and
    does not declare that it is safe."""
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True

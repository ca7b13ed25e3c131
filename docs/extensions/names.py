"""The Python reference: the directive `names`, and a page for each public name that it lists.

    ```{names} simulate Body protocols.Effect
    ```

makes a table of names with their first sentences; `studies` stands for the registered studies. The
pages are written before Sphinx reads the sources, to `reference/api`, which git ignores.
"""

import operator
import re
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList

import rigidmc
import rigidmc.protocols
import rigidmc.views.accessor
from rigidmc.studies import STUDIES

REFERENCE = Path(__file__).parent.parent / "reference"
# {name: the members that its page has}; of a protocol what is called, and not its numbers
MEMBERS = {
    **dict.fromkeys(("Body", "Scene", "views.accessor.Rigid", "views.accessor.Pictures"), ""),
    "protocols.Event": "bind, results",
    "protocols.Running": "results",
    "protocols.VectorDistribution": "check, sample",
}
TITLES = {"views.accessor.Rigid": "ds.rigid", "views.accessor.Pictures": "ds.rigid.plot"}


def listed(words):
    """The names that the argument of a directive stands for."""
    return list(STUDIES) if words == "studies" else words.split()


def page(name):
    """The source of the page of a name."""
    kind = "class" if isinstance(operator.attrgetter(name)(rigidmc), type) else "function"
    title = TITLES.get(name, f"rigidmc.{name}")
    lines = [title, "=" * len(title), "", f".. auto{kind}:: rigidmc.{name}"]
    if name in MEMBERS:
        lines += [f"   :members: {MEMBERS[name]}".rstrip(), "   :inherited-members:"]
    elif name.startswith("protocols."):
        lines += ["   :no-members:"]
    return "\n".join(lines) + "\n"


def write_pages(app):
    """Write the pages of all names; what has not changed is not read again."""
    text = (REFERENCE / "python.md").read_text("utf-8")
    names = [name for words in re.findall(r"\{names\} (.+)", text) for name in listed(words)]
    pages = {f"rigidmc.{name}.rst": page(name) for name in names}
    folder = REFERENCE / "api"
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


class Names(Directive):
    """A table of public names, with links to their pages."""

    required_arguments, final_argument_whitespace = 1, True

    def run(self):
        here = nodes.container()
        names = [f"   rigidmc.{name}" for name in listed(self.arguments[0])]
        options = ["   :toctree: api", "   :nosignatures:", ""]
        lines = ["```{eval-rst}", ".. autosummary::", *options, *names, "```"]
        self.state.nested_parse(StringList(lines), self.content_offset, here)
        return here.children


def setup(app):
    app.connect("builder-inited", write_pages, priority=100)  # before sources are looked for
    app.add_directive("names", Names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

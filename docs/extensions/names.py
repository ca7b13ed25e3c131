"""The Python reference, made of the public names: the directive `names`, which takes some."""

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList

import rigidmc
from rigidmc.studies import STUDIES

WITH_METHODS = ("Body", "Scene")


class Names(Directive):
    """The docstrings of some public names of rigidmc, or with `studies` those of the registry."""

    required_arguments, final_argument_whitespace = 1, True

    def run(self):
        here = nodes.container()
        lines = []
        words = self.arguments[0].split()
        for name in STUDIES if words == ["studies"] else words:
            kind = "class" if isinstance(getattr(rigidmc, name), type) else "function"
            methods = ["   :members:", "   :inherited-members:"] * (name in WITH_METHODS)
            lines += ["```{eval-rst}", f".. auto{kind}:: rigidmc.{name}", *methods, "```", ""]
        self.state.nested_parse(StringList(lines), self.content_offset, here)
        return here.children


def setup(app):
    app.add_directive("names", Names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

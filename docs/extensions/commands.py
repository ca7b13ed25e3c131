"""The command reference, made of the commands themselves: the directive `commands`."""

import inspect

import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList

from rigidmc.cli import app as application


def words(text):
    """A help text on one line."""
    return " ".join(inspect.cleandoc(text or "").split())


def names(option):
    """An option as it is typed, with the kind of its value."""
    kind = "" if option.is_flag or not option.metavar else f" {option.metavar}"
    return ", ".join(f"`{name}{kind}`" for name in (*option.opts, *option.secondary_opts))


def command(name, one):
    """The lines of a command."""
    arguments = [p for p in one.params if p.param_type_name == "argument"]
    options = [p for p in one.params if p.param_type_name == "option" and not p.hidden]
    usage = " ".join(
        ["rigidmc", name, *(p.metavar or p.name.upper() for p in arguments), "[OPTIONS]"]
    )
    yield from (f"### {name}", "", words(one.help), "", "```", usage, "```", "")
    for option in options:
        yield from (names(option), f": {words(option.help)}", "")


class Commands(Directive):
    """Every command of `rigidmc` with its options."""

    def run(self):
        group = typer.main.get_command(application)
        context = typer.Context(group)
        lines, panel = [], ""
        for name in group.list_commands(context):
            one = group.get_command(context, name)
            if one.rich_help_panel != panel:
                panel = one.rich_help_panel
                lines += [f"## {panel}", ""]
            lines += command(name, one)
        here = nodes.section()
        here.document = self.state.document
        self.state.nested_parse(StringList(lines), self.content_offset, here, match_titles=1)
        return here.children


def setup(app):
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""The panels of `rigidmc --help`. A command names its own: `@app.command(rich_help_panel=LOOK)`."""

from inspect import cleandoc
from typing import Any

import typer
from typer.core import TyperGroup

from rigidmc.cli.codes import INVALID

PANELS = ("Start", "Look", "Study", "Long runs", "Reference")
START, LOOK, STUDY, LONG_RUNS, REFERENCE = PANELS
# what users want first comes first; others follow as they are registered
FIRST = ("run", "show", "check", "scenes", "new", "body", "view", "plot", "animate", "summary")


def unwrapped(text: str) -> str:
    """A help text with each paragraph on one line, except those marked with a backspace."""
    paragraphs = cleandoc(text).split("\n\n")
    return "\n\n".join(p if p.startswith("\b") else " ".join(p.split()) for p in paragraphs)


class Commands(TyperGroup):
    """The commands by panel, those of FIRST before others."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for command in self.commands.values():
            command.help = unwrapped(command.help or "")

    def invoke(self, ctx: Any) -> Any:
        """Run a command; a value that an option cannot take ends it as one does that the command
        itself finds wrong, and not as a wrong word."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            if type(error) is typer.BadParameter:  # a missing one is of a class of its own
                error.exit_code = INVALID
            raise

    def list_commands(self, ctx: Any) -> list[str]:
        def place(name: str) -> tuple[int, int]:
            panel: Any = getattr(self.commands[name], "rich_help_panel", None)
            # a command without a panel: at the end
            return (*PANELS, panel).index(panel), (*FIRST, name).index(name)

        return sorted(self.commands, key=place)

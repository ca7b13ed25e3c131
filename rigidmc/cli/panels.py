"""The panels of `rigidmc --help`. A command names its own: `@app.command(rich_help_panel=LOOK)`."""

from inspect import cleandoc
from typing import Any

from typer.core import TyperGroup

PANELS = ("Start", "Look", "Study", "Long runs", "Reference")
START, LOOK, STUDY, LONG_RUNS, REFERENCE = PANELS


def unwrapped(text: str) -> str:
    """A help text with each paragraph on one line, except those marked with a backspace."""
    paragraphs = cleandoc(text).split("\n\n")
    return "\n\n".join(p if p.startswith("\b") else " ".join(p.split()) for p in paragraphs)


class Commands(TyperGroup):
    """The commands by panel; `run` is the first, the others as they are registered."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for command in self.commands.values():
            command.help = unwrapped(command.help or "")

    def list_commands(self, ctx: Any) -> list[str]:
        def place(name: str) -> tuple[int, bool]:
            panel: Any = getattr(self.commands[name], "rich_help_panel", None)
            return (*PANELS, panel).index(panel), name != "run"  # without a panel: at the end

        return sorted(self.commands, key=place)

"""rigidmc doctor."""

import json
from typing import Annotated

import typer

from rigidmc.cli.common import app
from rigidmc.cli.panels import REFERENCE


@app.command(rich_help_panel=REFERENCE)
def doctor(
    machine: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Say what this machine offers: cores, vector width, threads, kernel cache, versions."""
    from rigidmc.views.machine import machine_facts

    facts = machine_facts()
    if machine:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        print(f"{key:16s} {value}")

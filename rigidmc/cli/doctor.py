"""rigidmc doctor."""

import json
from typing import Annotated

import typer

from rigidmc.cli.common import FLAGGED, app, reported
from rigidmc.cli.panels import REFERENCE


@app.command(rich_help_panel=REFERENCE)
def doctor(
    machine: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    cuda_check: Annotated[
        bool,
        typer.Option(
            "--cuda-check",
            help="Compare the bits of every integrator on graphics processors with those of this"
            " processor, then measure steps a second. Exit code 4 if any bit differs.",
        ),
    ] = False,
) -> None:
    """Say what this machine offers: cores, vector width, threads, kernel cache, graphics
    processors, versions."""
    if cuda_check:
        with reported():
            if _different():
                raise typer.Exit(FLAGGED)
        return
    from rigidmc.views.machine import machine_facts

    facts = machine_facts()
    if machine:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        print(f"{key:16s} {value}")


def _different() -> int:
    """Print how graphics processors compare with this one; how many cases have other bits."""
    from rigidmc.engine.cuda_device import chosen
    from rigidmc.studies.bits import compared, speeds

    wrong = 0
    for one in chosen(None):
        word, equal = f"cuda:{one.number}", list[bool]()
        print(f"{word}: {one.name}")
        for name, same in compared(word):
            print(f"{'same bits ' if same else 'OTHER BITS'}  {name}", flush=True)
            equal.append(same)
        print(f"{sum(equal)} of {len(equal)} cases have the bits of this processor")
        wrong += len(equal) - sum(equal)
        for name, steps, operations in speeds(word):
            share = 100 * operations / one.peak
            print(f"{steps / 1e9:8.2f} G steps/s, {share:.0f} % of the peak in float64  {name}")
    return wrong

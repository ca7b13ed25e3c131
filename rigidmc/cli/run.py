"""rigidmc run: integrate the ensemble of a scene."""

import os
import sys
import time
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import FLAGGED, INCOMPLETE, OK, load_scene
from rigidmc.cli.directories import (
    DirectoryOptions,
    names_a_run,
    refuse_directory_options,
    refuse_force,
    start_directory,
    with_directory_options,
)
from rigidmc.cli.options import (
    AllowCode,
    Device,
    Force,
    OutputOrRun,
    Plot,
    SceneArgument,
    Set,
    Threads,
    add_setting_options,
    count_option,
)
from rigidmc.cli.reporting import (
    plots_module,
    refuse_outputs,
    report_errors,
    report_files,
    save_picture,
)
from rigidmc.errors import OptionError
from rigidmc.results.labels import count_text

if TYPE_CHECKING:
    import xarray as xr

    from rigidmc.runs.directory.folder import RunDirectory
    from rigidmc.scene.scene import Scene
    from rigidmc.statistics.intervals import Estimate

Until = Annotated[
    str | None,
    typer.Option(
        metavar="MEASURE",
        help="Add members until the interval of a measure is this narrow, e.g."
        ' "p(flips >= 1) +- 0.001", "mean(flip_wait) +- 1 %".',
    ),
]
Most = Annotated[int, count_option("--most", 32, help="With --until: most members to run.")]


@add_setting_options()
@with_directory_options
def run_command(
    scene: SceneArgument,
    run: dict[str, Any],
    ways: DirectoryOptions,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    threads: Threads = None,
    device: Device = None,
    output: OutputOrRun = None,
    plot: Plot = None,
    force: Force = False,
    until: Until = None,
    most: Most = 10_000_000,
) -> None:
    began = time.perf_counter()
    with report_errors(scene):
        loaded = load_scene(scene, settings, allow_code, run)
        if output is not None and names_a_run(output):
            if plot is not None or until is not None:
                rule = "a run directory allows neither --plot nor --until: consolidate it first"
                raise OptionError(rule, at="output", value=output)
            refuse_force(output, force)
            make = partial(_created, loaded, output, device)
            raise typer.Exit(start_directory(make, ways, threads, allow_code, device)[0])
        refuse_directory_options(ways)
        output = output and output.rstrip(os.sep)
        refuse_outputs(force, output, plot)
        how = dict[str, Any](threads=threads, device=device, output=output, force=force)
        if until is None:
            from rigidmc.runs.simulate import simulate

            dataset, code, reached = simulate(loaded, progress=True, **how), OK, ""
        else:
            if "members" in run:
                rule = "cannot be combined with --until, which adds members as needed: give --most"
                raise OptionError(rule, at="members", value=run["members"])
            dataset, code, reached = _until(loaded, until, most, how)
        if plot is not None:
            save_picture(plots_module().summary(dataset), plot, force)
        files = [p for p in (output, plot) if p]
        flagged = _summarise(dataset, time.perf_counter() - began, files, reached)
        dataset.close()
    raise typer.Exit(code or (FLAGGED if flagged else OK))


def _created(
    scene: "Scene", path: str, device: str | None, size: float | None, only: range | None,
    threads: int | None, limit: float | None,
) -> "RunDirectory":  # fmt: skip
    """Create a run directory, as `Make` of `rigidmc.cli.directories`."""
    from rigidmc.runs.directory.create import create

    return create(scene, path, size, only, threads, limit=limit, device=device, plots=True)


def _until(
    scene: "Scene", until: str, most: int, how: dict[str, Any]
) -> tuple["xr.Dataset", int, str]:
    """Add members until a measure's interval is narrow enough; return (result, exit code, line)."""
    from rigidmc.studies.until import is_goal_reached, simulate_until

    def show(members: int, interval: "Estimate") -> None:
        line = f"  {count_text(members, 'member')}: {interval.value:.6g} +- {interval.half:.2g}"
        print(line, file=sys.stderr, flush=True)

    dataset, interval = simulate_until(scene, until, most, progress=show, **how)
    code = OK if is_goal_reached(until, interval) else INCOMPLETE
    return dataset, code, f"  {until}: {interval.words()}"


def _summarise(dataset: "xr.Dataset", wall: float, files: list[str], reached: str) -> bool:
    """Print run, cost, drifts of energy and |L|^2, and flagged members; return if there are any."""
    from rigidmc.inputs.amounts import two_digits
    from rigidmc.scene.drifts import one_way
    from rigidmc.scene.user_parts.registry import origin_of

    cost = origin_of(dataset)
    count, steps, seconds = dataset.sizes["member"], cost["steps"], cost["run_seconds"]
    each = (
        f"{steps:,.1f} steps on average, different for each member,"
        if "turn" in dataset.attrs
        else f"{count_text(int(steps), 'step')} of {dataset.attrs['dt']:.6g} s"
    )
    print(
        f"{dataset.attrs['title']}: {count_text(count, 'member')} x {each}"
        f" with {dataset.attrs['integrator']}"
    )
    print(
        f"  {seconds:.2f} s, {two_digits(count * steps / seconds)} member-steps/s,"
        f" {two_digits(count / seconds)} members/s; compiled in {cost['compile_seconds']:.2f} s;"
        f" total {wall:.2f} s"
    )
    for name, word in (
        ("energy", "energy less work" if "work" in dataset else "energy"),
        ("l2", "|L|^2"),
    ):
        _print_drift(dataset[f"{name}_drift_max"], word)
    if line := one_way(dataset):
        print(f"  {line}")
    flags = ", ".join(f"{v:,} {k}" for k, v in cost["flagged"].items() if v and k != "ok")
    where = "; `status`, `status_step` and `status_time` show which and when" if flags else ""
    print(f"  flagged members: {flags or 'none'}{where}")
    if not files:
        print("  nothing was written: -o FILE saves the result, --plot FILE draws it")
    for line in (*report_files(files), *filter(None, [reached])):
        print(line)
    return bool(flags)


def _print_drift(drift: "xr.DataArray", word: str) -> None:
    """Print the median and the worst drift of a quantity, or its change if it is not conserved."""
    import numpy as np

    values = drift.values[np.isfinite(drift.values)]
    if values.size:
        conserved = drift.attrs["conserved"]
        if conserved == "yes":
            kind, note = "drift", ""
        else:
            kind, note = "change", f"   (not conserved: {conserved[4:]})"
        numbers = f"median {np.median(values):.1e}   worst {values.max():.1e}"
        print(f"  {f'{kind} of {word}':18s}{numbers}{note}")

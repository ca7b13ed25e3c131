"""rigidmc map."""

import sys
from typing import Annotated

import typer

from rigidmc.cli.common import (
    FLAGGED,
    OK,
    AllowCode,
    Dt,
    Force,
    Integrator,
    Output,
    Plot,
    Seed,
    Set,
    TEnd,
    Threads,
    Tolerance,
    Turn,
    app,
    count_option,
    keep,
    load_scene,
    refuse_outputs,
    reported,
)


@app.command("map")
def make_map(
    name: Annotated[str, typer.Argument(metavar="NAME|SCENE", help="A map of the package (rigidmc map list), a TOML file, or a shipped scene.")],
    which: Annotated[str | None, typer.Argument(metavar="[NAME]", help="With `rigidmc map list`: the map to explain.")] = None,
    x: Annotated[str | None, typer.Option(metavar="KEY=LOW:HIGH", help="Scene parameter across, e.g. body.moments.1=0:1; :log for even ratios.")] = None,
    y: Annotated[str | None, typer.Option(metavar="KEY=LOW:HIGH", help="Scene parameter upwards.")] = None,
    of: Annotated[list[str], typer.Option(metavar="MEASURE", help='What a pixel is asked: "p(flips >= 1)", "mean(megno)", "quantile(flip_wait, 0.9)"; may be repeated.')] = [],  # noqa: B006
    resolution: Annotated[int, count_option("--resolution", help="Pixels a side.")] = 256,
    members: Annotated[int | None, count_option("--members", help="Members to a pixel; default 16, or the map's own, or 1 where nothing else is drawn.")] = None,
    integrator: Integrator = None, dt: Dt = None, turn: Turn = None, t_end: TEnd = None, tolerance: Tolerance = None,
    seed: Seed = None, threads: Threads = None, settings: Set = [], allow_code: AllowCode = False,  # noqa: B006
    output: Output = None, plot: Plot = None, force: Force = False,
):  # fmt: skip
    """Map two parameters of a scene against what its members do, with replicas and a confidence interval for every pixel."""
    with reported():
        from rigidmc.errors import OptionError, RigidmcError, unknown
        from rigidmc.studies.maps.catalogue import MAPS, case_map

        if name == "list":
            if which is not None and which not in MAPS:
                raise unknown("", "map", which, "map", MAPS, OptionError)
            for word, case in MAPS.items() if which is None else [(which, MAPS[which])]:
                made = case()
                print(f"{word:18s} {made.title}")
                print(f"{'':18s} {made.x[0]} and {made.y[0]}: {', '.join(made.of)}")
                if made.source:
                    print(f"{'':18s} theory: {made.source}")
                if which is not None:
                    _explain(made)
            return
        if which is not None:
            raise OptionError("", "NAME", which, "goes with `rigidmc map list NAME`")
        refuse_outputs(force, output, plot, size=8 * max(resolution, 1) ** 2 * (4 + 3 * len(of)))

        def show(done, total):
            if sys.stderr.isatty():
                print(
                    f"\r{100 * done / total:3.0f} % of {total:,} pixels",
                    end="" if done < total else "\n",
                    file=sys.stderr,
                    flush=True,
                )

        try:
            changed = {
                "tolerance": tolerance,
                "integrator": integrator,
                "dt": dt,
                "turn": turn,
                "t_end": t_end,
            }
            if name in MAPS and not (x or y or of or settings):
                found = case_map(name, resolution, members, threads, show, seed=seed, **changed)
            else:
                from rigidmc.studies.maps.stability_map import stability_map

                if name in MAPS and not (x and y and of):
                    rule = "a map of the package has its own x, y, measures and scene; give --resolution, --members, --dt and the like"
                    raise OptionError(
                        "", "map", name, f"{rule}, or a scene with all of --x, --y and --of"
                    )
                if not (x or y or of or settings):
                    raise unknown("", "map", name, "map", MAPS, OptionError)
                if not (x and y and of):
                    missing = ", ".join(
                        key for key, value in (("--x", x), ("--y", y), ("--of", of)) if not value
                    )
                    raise OptionError(
                        "",
                        missing,
                        None,
                        f"is missing: a map of a scene needs it; maps of the package: {', '.join(MAPS)}",
                    )
                scene = load_scene(name, settings, allow_code)
                sides = _side(x, "--x"), _side(y, "--y")
                found = stability_map(
                    scene, *sides, of, resolution, members, threads, show, seed=seed, **changed
                )
        except RigidmcError as error:
            error.file = error.file or name
            raise

        def draw(found):
            from rigidmc.views import maps

            return maps.stability_map(found)

        lines = list[str]()
        try:
            lines = keep(found, output, plot, force, draw)
        finally:  # what was found is told also where it could not be written
            _close(found)
            print("\n".join(lines), end="\n" * bool(lines))
    raise typer.Exit(FLAGGED if int(found.failed.sum()) else OK)


def _explain(case):
    """What a map of the package computes."""
    sides = [
        f"{name} from {low:g} to {high:g}{' in even ratios' * bool(log)}"
        for name, low, high, *log in (case.x, case.y)
    ]
    print(f"{'':18s} across {sides[0]}; upwards {sides[1]}")
    print(
        f"{'':18s} {case.members} members to a pixel; {', '.join(f'{k} = {v}' for k, v in case.settings.items())}"
    )
    print(f"\n{case.scene.dumps()}", end="")


def _side(text, key):
    """(parameter, low, high, whether in even ratios) of KEY=LOW:HIGH[:log]."""
    from rigidmc.errors import OptionError

    name, equals, ends = text.partition("=")
    parts = ends.split(":")
    try:
        low, high = float(parts[0]), float(parts[1])
    except (ValueError, IndexError):
        low = high = float("nan")
    if not equals or len(parts) not in (2, 3) or parts[2:] not in ([], ["log"]) or low != low:
        raise OptionError(
            "", key, text, "expected KEY=LOW:HIGH or KEY=LOW:HIGH:log, e.g. body.moments.1=0.1:0.9"
        )
    return name.strip(), low, high, len(parts) == 3


def _close(found):
    """The closing summary."""
    import numpy as np

    pixels, none = found.good.size, int(((found.good == 0) & (found.failed == 0)).sum())
    failed, count = int(found.failed.sum()), found.attrs["members"]
    print(f"{found.attrs['title']}")
    print(
        f"  {found.sizes['x']} x {found.sizes['y']} pixels of {count} members with {found.attrs['integrator']}: "
        f"{found.attrs['seconds']:.1f} s, {pixels * count / found.attrs['seconds']:,.0f} members/s"
    )
    for name in found.data_vars:
        values = found[name].values
        if (
            name in ("good", "failed", "none")
            or name.endswith(("_low", "_high"))
            or not (values == values).any()
        ):
            continue
        wide = found[f"{name}_high"] - found[f"{name}_low"] if f"{name}_low" in found else None
        sure = (
            f", intervals of {100 * found.attrs['confidence']:g} % +-{float(wide.where(np.isfinite(wide)).median()) / 2:.2g} in the median"
            if wide is not None and count > 1 and np.isfinite(wide).any()
            else ", too few members for intervals" * (count > 1 and wide is not None)
        )
        print(
            f"  {name:28s} {float(found[name].min()):.4g} to {float(found[name].max()):.4g}, median {float(found[name].median()):.4g}{sure}"
        )
    print(f"  pixels without body or start: {none:,}; members that failed: {failed:,}")

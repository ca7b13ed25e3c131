"""Maps: two parameters of a scene against anything that its members are asked, with replicas and a confidence interval for every pixel."""

import time
import warnings

import numpy as np
import xarray as xr

from rigidmc.effects import labelled
from rigidmc.engine.layout import STATUSES
from rigidmc.errors import OptionError, RigidmcError, SceneError, SceneWarning
from rigidmc.planning.notes import notes
from rigidmc.planning.plan import prepare
from rigidmc.planning.tolerance.choose import resolved
from rigidmc.runs.simulate import simulate
from rigidmc.scene.amounts import counted
from rigidmc.scene.parameters import with_parameter
from rigidmc.scene.quantities import Distribution, grid
from rigidmc.storage.schema import member_variables
from rigidmc.studies.measures import measure, observing
from rigidmc.version import VERSION

CHUNK = 2**17  # members at once: 20 to 40 MB, and 40 waits for the last block of a map of 4e6
REPLICAS = 16  # members of a pixel
MOST = 4096  # pixels a side


def on_map(scene, x, y, resolution, members):
    """The scene whose members are the pixels of a map, `members` to each, row by row.

    x, y : (parameter, low, high) or (parameter, low, high, True) for even ratios;  resolution : pixels a side, or (columns, rows)
    """
    sides, members = _sides(resolution), counted(members, "members")
    for key, side in (("x", x), ("y", y)):
        if isinstance(side, str) or len(side) not in (3, 4) or not isinstance(side[0], str):
            raise OptionError(
                "",
                key,
                side,
                'expected (parameter, low, high) or (parameter, low, high, True), as ("body.moments.1", 0.1, 0.9)',
            )
    if x[0] == y[0]:
        raise OptionError("", "y", y[0], "is the parameter of x already")
    for key, (name, low, high, *log), side, stride in (
        ("x", x, sides[0], members),
        ("y", y, sides[1], members * sides[0]),
    ):
        try:
            between = grid(low, high, side, stride, bool(log and log[0]))
        except RigidmcError as error:
            rule = (
                error.rule
                if "whole number" in error.rule
                else f"expected low < high{', both above 0 for even ratios' if log and log[0] else ''}"
            )
            raise OptionError("", key, f"{name} from {low} to {high}", rule) from None
        scene = with_parameter(scene, name, between, key)
    return scene.with_run(members=members * sides[0] * sides[1], first=0)


def stability_map(
    scene,
    x,
    y,
    of,
    resolution=256,
    members=None,
    threads=None,
    progress=None,
    confidence=0.95,
    **settings,
):
    """A map as a Dataset with the coordinates y and x.

    of : what the members of a pixel are asked, or several such: "p(flips >= 1)", "mean(megno)", see `rigidmc.studies.measures`
    x, y, resolution, members : see `on_map`; members by default REPLICAS, or 1 where nothing but x and y differs
    settings : of `rigidmc.simulate`
    progress : a function of (pixels done, all)

    For each measure: its value, `low` and `high` of its confidence interval; `good` members of each pixel, `failed` ones, which are flagged in
    `status` and count for nothing, and `none`, for which there is no such body or start. Pixels where all failed are nan, as are those of none.
    Member r of pixel (i, j) is member (j columns + i) members + r of the scene in the attributes, to the bit.
    Raises OptionError for parameters and measures that the scene has not.
    """
    of = (of,) if isinstance(of, str) else tuple(of)
    if not of or not all(isinstance(text, str) for text in of):
        raise OptionError("", "of", of, 'expected measures, such as "p(flips >= 1)"')
    if members is None:
        members = REPLICAS if _drawn(on_map(scene, x, y, 1, 1)) else 1
    sides, members = _sides(resolution), counted(members, "members")
    made = on_map(scene, x, y, resolution, members).with_run(
        save=settings.pop("save", ()), **settings
    )
    if made.run.points != "independent":
        raise SceneError(
            "run",
            "points",
            made.run.points,
            "the members of a pixel are independent ones: their spread tells its interval",
        )
    made = observing(made, of)
    given = made
    if made.run.integrator == "auto":
        run = resolved(made.coarse(), threads)[0].run
        made = made.with_run(
            integrator=run.integrator,
            dtype=run.dtype,
            **({"dt": run.dt} if run.turn is None else {"turn": run.turn}),
        )
    variables = {name: v.dims for name, v in member_variables(made, False).items()}
    asked = [measure(text, variables) for text in of]
    plan, pixels, each = prepare(made, threads or 1), sides[0] * sides[1], max(1, CHUNK // members)
    for note in notes(
        given, plan._replace(notes=())
    ):  # without the plan's notes on large steps: maps take them on purpose
        warnings.warn(note, SceneWarning, stacklevel=2)
    parts = {one.text: np.full((3, pixels), np.nan) for one in asked}
    counts, began = np.zeros((3, pixels), "i4"), time.perf_counter()
    for low in range(0, pixels, each):
        high = min(pixels, low + each)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # what there is to say was said above
            dataset = simulate(made, members=range(low * members, high * members), threads=threads)
        status = dataset.status.values.reshape(-1, members)
        none, good = status == STATUSES["invalid_input"], status == 0
        counts[:, low:high] = good.sum(1), (~good & ~none).sum(1), none.sum(1)
        for one in asked:
            parts[one.text][:, low:high] = one.interval(
                one.values(dataset).reshape(-1, members), good, confidence
            )
        if progress is not None:
            progress(high, pixels)
    if not (counts[0] + counts[1]).any():
        rule = f"between {x[1]:g} and {x[2]:g}, and {y[1]:g} and {y[2]:g} of {y[0]} no pixel has a body and a start: moments must obey I_i <= I_j + I_k"
        raise OptionError("", "x", x[0], rule)
    return _dataset(
        made,
        plan,
        asked,
        parts,
        counts,
        x,
        y,
        sides,
        members,
        confidence,
        time.perf_counter() - began,
    )


def _sides(resolution):
    """(columns, rows) of a map; OptionError."""
    sides = resolution if isinstance(resolution, (list, tuple)) else (resolution, resolution)
    if len(sides) != 2:
        raise OptionError(
            "", "resolution", resolution, "expected pixels a side, or (columns, rows)"
        )
    columns, rows = (counted(side, "resolution", 1, MOST) for side in sides)
    return columns, rows


def _drawn(scene):
    """Whether members differ by more than the parameters of a map."""
    every = scene.quantities()
    return any(hasattr(q, "_fields") or isinstance(q, Distribution) for q in every) or isinstance(
        scene.start.attitude, str
    )


def _dataset(scene, plan, asked, parts, counts, x, y, sides, members, confidence, seconds):
    shape = sides[1], sides[0]
    variables, known = {}, member_variables(scene, plan.carried)
    for one in asked:
        attrs = dict(known[one.name].attrs)
        units = "1" if one.kind == "p" else attrs.get("units", "1")
        name = one.text.replace(" ", "")
        text = f"{one.text}: {attrs.get('long_name', '')}"
        for suffix, values in zip(("", "_low", "_high"), parts[one.text], strict=True):
            end = (
                ""
                if not suffix
                else f", {suffix[1:]} end of its interval of {100 * confidence:g} %"
            )
            variables[name + suffix] = (
                ("y", "x"),
                values.reshape(shape),
                {"units": units, "long_name": text + end},
            )
    words = (
        "good members",
        "members that failed",
        "members for which there is no such body or start",
    )
    for name, values, text in zip(("good", "failed", "none"), counts, words, strict=True):
        variables[name] = (("y", "x"), values.reshape(shape), {"units": "1", "long_name": text})
    coordinates = {}
    for key, (name, low, high, *log), side in (("x", x, sides[0]), ("y", y, sides[1])):
        values = grid(low, high, side, 1, bool(log and log[0])).values()
        coordinates[key] = (
            (key,),
            values,
            {"long_name": name, "units": units_of(scene, name), "log": int(bool(log and log[0]))},
        )
    attrs = {
        "title": scene.title,
        "source": f"rigidmc {VERSION}",
        "scene": scene.dumps(),
        "members": members,
        "confidence": confidence,
        "integrator": scene.run.integrator,
        "t_end": scene.run.t_end,
        "seconds": seconds,
    }
    return xr.Dataset(variables, coordinates, attrs)


def units_of(scene, name):
    """The units of a scene parameter."""
    table, first, *rest = name.split(".")
    if table == "effects":
        effect = dict(labelled(scene.effects))[first]
        return getattr(effect, "units", {}).get(rest[0], "1")
    last = rest[-1] if rest else first
    named = {
        "angle": "rad",
        "azimuth": "rad",
        "phi": "rad",
        "theta": "rad",
        "psi": "rad",
        "energy": "J",
        "kT": "J",
        "mass": "kg",
        "centre": "m",
    }
    return named.get(
        last,
        {"moments": "kg m2", "centre": "m", "omega": "rad s-1", "momentum": "kg m2 s-1"}.get(
            first, "1"
        ),
    )

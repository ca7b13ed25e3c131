"""A study as a Dataset and as text."""

import math
from typing import Any

import xarray as xr

from rigidmc.observables import squared
from rigidmc.storage.schema import member_variables, saved_variables
from rigidmc.studies.multilevel.corrections import Level, Plain, plain
from rigidmc.studies.multilevel.driver import Stand
from rigidmc.studies.multilevel.levels import Asked, Request


def dataset(request: Request, asked: Asked, now: Stand) -> xr.Dataset:
    """The Dataset of a study that is as far as `now`, whose first round has ended."""
    levels, rounds, found = now.levels, now.rounds, now.found
    assert found is not None
    name, order, scene = request.measure.result.name, asked.order, request.scene
    units = {**member_variables(scene, False), **saved_variables(scene)}[name].attrs["units"]
    of_levels = {
        "steps": ([one.steps for one in levels], "steps of the fine paths", "1"),
        "dt": ([scene.run.t_end / one.steps for one in levels], "their length", "s"),
        "members": ([one.members for one in levels], "members that count", "1"),
        "flagged": ([one.flagged for one in levels], "flagged members, left out", "1"),
        "mean": ([one.mean for one in levels], "mean of the corrections", units),
        "error": ([one.error for one in levels], "its standard error", units),
        "variance": (
            [one.variance for one in levels],
            "variance of the corrections",
            squared(units),
        ),
        "price": ([one.price for one in levels], "cost of a member, in steps", "1"),
    }
    variables: dict[str, Any] = {
        key: ("level", values, {"long_name": text, "units": of})
        for key, (values, text, of) in of_levels.items()
    }
    half = found.half
    numbers = {
        "value": (found.value, "the mean"),
        "low": (found.value - half, "lower end of its interval"),
        "high": (found.value + half, "upper end of its interval"),
        "sampling": (found.sampling, "half the width by sampling alone"),
        "bias": (found.bias, "half the width by the error of the step alone"),
    }
    for key, (value, text) in numbers.items():
        variables[key] = ((), value, {"long_name": text, "units": units})
    about = {"long_name": "half the width so far", "units": units}
    variables["half"] = ("round", [h for _, h in rounds], about)
    variables["cost"] = ("round", [c for c, _ in rounds], {"long_name": "cost so far, in steps"})
    attrs = {
        "title": scene.title,
        "measure": request.measure.text,
        "until": asked.text,
        "reached": int(half <= asked.goal.half_at(found.value)),
        "missing": len(now.next),
        "confidence": asked.confidence,
        "order": order,
        "order_seen": found.order,
        "variance_order_seen": found.variance_order,
        "scene": scene.dumps(),
    }
    return xr.Dataset(variables, {"level": [one.number for one in levels]}, attrs)


def levels_of(study: xr.Dataset) -> list[Level]:
    """The levels of a study."""
    names = "level", "steps", "members", "flagged", "mean", "variance"
    each = zip(*(study[name].values.tolist() for name in names), strict=True)
    return [Level(i, steps, n, f, m, v * (n - 1.0)) for i, steps, n, f, m, v in each]


def plain_members(study: xr.Dataset, half: float) -> Plain:
    """The plain members that would give an interval of this half width."""
    return plain(levels_of(study), study.attrs["order"], half, study.attrs["confidence"])


def table(study: xr.Dataset) -> list[str]:
    """The study in lines of text."""
    attrs, cost = study.attrs, float(study.cost[-1])
    v = {name: float(study[name]) for name in ("value", "low", "high", "sampling", "bias")}
    lines = [
        attrs["title"],
        f"  {attrs['measure']} = {v['value']:.8g}, {100 * attrs['confidence']:g} % between"
        f" {v['low']:.8g} and {v['high']:.8g}:",
        f"  +- {v['sampling']:.2g} by sampling, {v['bias']:.2g} by the step",
        f"  {'level':>5s} {'steps':>9s} {'step [s]':>10s} {'members':>14s}"
        f" {'correction':>24s} {'variance':>10s} {'of the cost':>12s}",
    ]
    spent = (study.members + study.flagged) * study.price
    for i in range(study.sizes["level"]):
        one = study.isel(level=i)
        lines.append(
            f"  {int(one.level):5d} {int(one.steps):9,d} {float(one['dt']):10.4g}"
            f" {int(one.members):14,d} {float(one['mean']):+12.5g} +- {float(one.error):8.2g}"
            f" {float(one.variance):10.3g} {100 * float(spent[i] / spent.sum()):10.1f} %"
        )
    if not math.isnan(attrs["order_seen"]):
        lines.append(
            f"  the last corrections fall with the order {attrs['order_seen']:.2f} in the step"
            f" ({attrs['order']:g} is expected), their variance with"
            f" {attrs['variance_order_seen']:.2f}"
        )
    single = plain_members(study, float(study.half[-1]))
    lines.append(
        f"  cost: {cost:.3g} steps; {single.members:.2g} plain members of {single.steps:,} steps:"
        f" {single.cost:.2g}, {single.cost / cost:.2g} times as many"
    )
    if single.cost < cost:
        lines.append("  which is less: for this width `rigidmc run --until` with that step will do")
    if not attrs["reached"]:
        lines.append(f"  {attrs['until']} is not reached")
    if attrs["missing"]:
        lines.append(f"  {attrs['missing']:,} tasks are missing: `rigidmc resume` goes on")
    if left := int(study.flagged.sum()):
        lines.append(f"  flagged members, which are left out: {left:,}")
    return lines

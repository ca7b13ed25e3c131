"""A result in a few lines: who is well, what was kept, and every number that its members have, with its interval."""

import numpy as np

from rigidmc.engine.layout import STATUSES
from rigidmc.files.reading import toml
from rigidmc.scene.stored import scene_text
from rigidmc.studies import intervals

_PLAIN = ("status", "status_step", "status_time", "mass", "steps")


def summary(dataset, confidence=0.95):
    """Lines of text on a result of `rigidmc.simulate`: flagged members, drifts, and of each number per member its mean with its interval, its
    middle 90 % with the median, and for how many members it never happened."""
    status = dataset.status.values
    good, count = status == 0, status.size
    run = (
        f"dt = {dataset.attrs['dt']:.6g} s"
        if "dt" in dataset.attrs
        else f"turn = {dataset.attrs.get('turn', float('nan')):.6g} rad"
    )
    settings = toml(scene_text(dataset))["run"]
    points, planned = settings.get("points", "independent"), settings["members"]
    of = f" of {planned:,}" if count < planned else ""
    independent = points == "independent"
    lines = [
        f"{dataset.attrs.get('title', 'result')}: {count:,}{of} members to {float(dataset.time.values[-1]):g} s with {dataset.attrs['integrator']}, {run}"
    ]
    flags = [
        f"{int((status == code).sum()):,} {word}"
        for word, code in STATUSES.items()
        if code and (status == code).any()
    ]
    lines.append(
        f"  flagged: {', '.join(flags) or 'none'}" + ("; they are left out below" if flags else "")
    )
    for name, variable in dataset.data_vars.items():
        if (
            {"time", "thinned_time"} & set(variable.dims)
            or "member" not in variable.dims
            or name in _PLAIN
            or name.startswith("start_")
        ):
            continue
        parts = (
            [(str(name), variable)]
            if variable.ndim == 1
            else [
                (f"{name}[{i}]", variable.isel({variable.dims[0]: i - 1}))
                for i in range(1, variable.shape[0] + 1)
            ]
        )
        lines += [
            line
            for label, part in parts
            if (line := _line(label, part, good, confidence if independent else None))
        ]
    if not independent:
        lines.append(
            f"  its members are {points} points, whose spread tells no interval: see rigidmc.randomised"
        )
    saved = [str(name) for name, v in dataset.data_vars.items() if "time" in v.dims]
    lines.append(f"  saved at {dataset.sizes['time']:,} times: {', '.join(saved) or 'nothing'}")
    if few := [str(name) for name, v in dataset.data_vars.items() if "thinned_time" in v.dims]:
        lines.append(f"  and at {dataset.sizes['thinned_time']:,}: {', '.join(few)}")
    return "\n".join(lines)


def _line(label, variable, good, confidence):
    """One number per member on a line; None where it is the same for all."""
    values = variable.values[good]
    seen = values[np.isfinite(values)]
    if not seen.size:
        return f"  {label:24s} never, for none of {values.size:,}"
    if np.ptp(seen) == 0.0 and seen.size == values.size:
        return (
            None
            if label.startswith("moments")
            else f"  {label:24s} {seen[0]:.6g} for all {_units(variable)}".rstrip()
        )
    found = intervals.mean(seen, confidence=confidence or 0.95)
    width = f" +- {found.half:.2g}" if confidence else ""
    driven = variable.attrs.get("conserved", "yes")
    driven = "" if driven == "yes" else f"   (not conserved: {driven.removeprefix('no: ')})"
    low, middle, high = np.quantile(seen, (0.05, 0.5, 0.95))
    never = f"; never for {values.size - seen.size:,}" if seen.size < values.size else ""
    return (
        f"  {label:24s} {found.value:.6g}{width}, median {middle:.6g}, 90 % in {low:.4g} to {high:.4g} {_units(variable)}{never}".rstrip()
        + driven
    )


def _units(variable):
    units = variable.attrs.get("units", "1")
    return "" if units == "1" else units

"""Samples of results for pictures: thinning, headings, and whether lines may join the points.

A sample has evenly spaced times and members and no flagged members, so that a picture of a million
members takes seconds. `note_on` warns if saves are too far apart for a picture to show the motion,
by the rule in `rigidmc.planning.saves`.
"""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rigidmc.engine.compiler.compose import NumbaError
from rigidmc.errors import RigidmcError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import euler
from rigidmc.physics.effects import label_effects
from rigidmc.planning.saves import ATTITUDE, AXIS, BODY, Drive, Sparse, drive, sparse, turning_rates
from rigidmc.results.labels import count_text, in_symbols, value_text
from rigidmc.results.principal_axes import described, in_principal_axes, principal
from rigidmc.scene.scene import scene_of
from rigidmc.views.figures import new_figure

TIMES = 4000  # most saves to read: a line on a picture cannot show more
# most members to read: MEMBERS, more up to POINTS vectors, fewer beyond VECTORS
MEMBERS, POINTS, VECTORS = 20_000, 2_000_000, 8_000_000
DRAWN = 4  # members drawn as lines over a density: more are hard to follow
LINES = 20  # most members that a picture of single members draws as lines instead of a density
KEYED = 6  # most lines that a legend names
FINE = 0.2  # rad between two points of a curve: it then looks smooth, also on a small cap
DENSE = 1600, 20_000  # least and most points of the curve of a member

SAVES = "rigidmc_saves"  # key for the saves of the result, in the encoding of a sample

_STATES = ("omega", "momentum", "attitude", "start_omega", "start_momentum")


def thin_result(ds: xr.Dataset) -> xr.Dataset:
    """Load evenly spaced members and times, without flagged members.

    The sample includes the last time. A sample of a sample is the sample itself.
    """
    times, members = ds.sizes.get("time", 1), ds.sizes["member"]
    read = min(times, TIMES)
    most = min(VECTORS // read, max(MEMBERS, POINTS // read))
    every, stride = -(-times // TIMES), -(-members // most)
    states = [name for name in _STATES if name in ds]
    even = {"time": slice((times - 1) % every, None, every), "member": slice(None, None, stride)}
    # the momentum of rotors affects the rate at which omega turns, see `drive_of`
    held = [name for name in map(str, ds.data_vars) if name.endswith("_momentum")]
    held = [name for name in held if name not in states and ds[name].dims == ("axis", "member")]
    axes = ["principal_axes"] if "principal_axes" in ds else []
    names = [*states, *held, *axes, "moments", "status", "energy_drift_max", "l2_drift_max"]
    part = ds[names].isel(even, missing_dims="ignore").load()
    good = part.status == 0
    for name in states:
        others = [dim for dim in part[name].dims if dim != "member"]
        good = good & (abs(part[name]) < np.inf).all(others)
    if not good.any():
        raise ValueError(
            f"nothing to draw: all {good.size:,} members of the sample are flagged or not finite"
        )
    part = part if good.all() else part.isel(member=good.values)
    part.encoding[SAVES] = ds.encoding.get(SAVES) or _saves(ds)
    return part


def _saves(ds: xr.Dataset) -> tuple[int, float]:
    """Return the number of saves of a result, and the longest time between two [s]."""
    t = np.atleast_1d(ds.time.values)
    return t.size, float(np.diff(t).max(initial=0.0))


def omega_or_momentum(part: xr.Dataset, name: str) -> tuple[Array, str]:
    """Return omega or momentum (time, axis, member), and a description of the times.

    Either follows from the other by L_i = I_i omega_i. If neither was saved, use the start.
    """
    for prefix in ("", "start_"):
        for saved in ("omega", "momentum"):
            if prefix + saved in part:
                vectors = part[prefix + saved]
                if saved != name:
                    v = principal(part, prefix + saved)
                    by = v * part.moments if name == "momentum" else v / part.moments
                    vectors = described(part, by)
                values = vectors.transpose(..., "axis", "member").values
                values = values if values.ndim == 3 else values[None]
                return values, "at the start (later states were not saved)" if prefix else span(
                    part
                )
    raise ValueError(
        "nothing to draw: neither omega nor momentum was saved, not even at the start:"
        ' run with save=("omega",)'
    )


def span(part: xr.Dataset, save: int | None = None) -> str:
    """Describe the times of a sample, or the time of one save."""
    t = part.time.values
    if save is None and t.size > 2:
        return f"t = {t[0]:,.7g} to {t[-1]:,.7g} s"
    return f"t = {t[-1 if save is None else save]:,.7g} s"


def drawn_members(values: NDArray[Any]) -> NDArray[np.int_]:
    """Return indices of DRAWN members, evenly spaced over the last axis."""
    return np.unique(np.linspace(0, values.shape[-1] - 1, DRAWN).round().astype(int))


def figure_of_result(ds: xr.Dataset, size: tuple[float, float]) -> Figure:
    """Return an empty figure with a heading: title, members, integrator, dt, seed, flagged
    members."""
    flagged = np.count_nonzero(ds.status.values)
    facts = [count_text(ds.sizes["member"], "member"), ds.attrs.get("integrator", "")]
    facts += [f"dt = {ds.attrs['dt']:.6g} s"] if "dt" in ds.attrs else []
    facts += [f"seed {ds.attrs['seed']}"] if "seed" in ds.attrs else []
    facts += [f"{flagged:,} flagged and excluded"] if flagged else []
    title = ds.attrs.get("title", "ensemble")
    return new_figure(f"{title}: {', '.join(filter(None, facts))}", size)


def good_members(ds: xr.Dataset) -> xr.Dataset:
    """Return the members that are not flagged; ValueError if all are."""
    good = ds.status.values == 0
    if not good.any():
        raise ValueError(f"nothing to draw: all {good.size:,} members are flagged")
    return ds if good.all() else ds.isel(member=good)


class MemberPath(NamedTuple):
    """The motion of one member at times t (n,) [s] that are close enough for smooth lines.

    attitude (n, 4) of the axes of the result;  principal_attitude (n, 4), momentum (n, 3)
    [kg m2/s] and omega (n, 3) [rad/s] in principal axes;  moments (3,) [kg m2]
    """

    member: int
    t: Array
    attitude: Array
    principal_attitude: Array
    momentum: Array
    omega: Array
    moments: Array


def member_paths(ds: xr.Dataset, kind: str) -> tuple[list[MemberPath], str]:
    """Return the smooth paths of all good members, and a warning if they are not.

    Where the saves are too far apart, or lack a state, the member is recomputed as for an
    animation, up to the time that DENSE[1] points can show. A member that cannot be recomputed, as
    without its scene or with custom code, is drawn through its saves.

    kind : quantity in the picture, from `rigidmc.planning.saves`; for BODY the attitude may be
        missing, and is nan
    """
    good, paths, notes = good_members(ds), [], []
    for k in range(good.sizes["member"]):
        dense, note = _dense(good.isel(member=[k]), kind)
        t = dense.time.values
        l = omega_or_momentum(in_principal_axes(dense), "momentum")[0][..., 0]
        moments = dense.moments.values[:, 0]
        attitude = q = np.full((t.size, 4), np.nan)
        if "attitude" in dense:
            attitude, q = (
                v.transpose("time", "quat", "member").values[..., 0]
                for v in (dense.attitude, principal(dense, "attitude"))
            )
        paths.append(MemberPath(int(dense.member[0]), t, attitude, q, l, l / moments, moments))
        notes += [note] if note else []
    return paths, notes[0] if notes else ""


def _dense(member: xr.Dataset, kind: str) -> tuple[xr.Dataset, str]:
    """Return a member at close times, and a warning if they are not close."""
    from rigidmc.runs.frames import frames

    part = thin_result(member)
    rate = float(fastest(part, kind)[0])
    has_states = ("omega" in member or "momentum" in member) and (
        kind == BODY or "attitude" in member
    )
    apart = float(np.diff(np.atleast_1d(member.time.values)).max(initial=0.0))
    if has_states and member.sizes["time"] > 2 and rate * apart <= FINE:
        return member, ""
    try:
        end = scene_of(member).run.t_end
        count = int(np.clip(np.ceil(rate * end / FINE), *DENSE))
        until = min(end, count * FINE / rate) if rate > 0.0 else end
        return frames(member, int(member.member[0]), count, until=until), ""
    except (RigidmcError, NumbaError):
        if not has_states:
            states = '"omega"' if kind == BODY else '"omega", "attitude"'
            raise ValueError(
                "the member cannot be recomputed, and its states were not saved: run with"
                f' save=({states},) and keep="full"'
            ) from None
        return member, note_on(part, kind)


def starts_of(good: xr.Dataset) -> tuple[Array, Array, Array]:
    """Return (moments, momentum, attitude) of members at the start (member, ...), in principal
    axes."""
    moments = good.moments.transpose("member", "axis").values
    if "start_momentum" in good:
        l = good.start_momentum.transpose("member", "axis").values
    else:
        l = good.start_omega.transpose("member", "axis").values * moments
    if "start_attitude" in good:
        return moments, l, good.start_attitude.transpose("member", "quat").values
    return moments, l, np.tile([1.0, 0.0, 0.0, 0.0], (len(l), 1))


def member_labels(members: NDArray[Any]) -> list[str | None]:
    """Return the labels of the lines of members; more than KEYED lines have none."""
    return [f"member {member}" if members.size <= KEYED else None for member in members]


def start_labels(good: xr.Dataset) -> list[str | None]:
    """Return labels as `member_labels` does, but the values of a number of the body, the effects or
    the start by which alone the members differ: "ω₂(0) = 1 rad/s"."""
    labels, members = member_labels(good.member.values), good.sizes["member"]
    if members > KEYED:
        return labels
    try:
        effects = {f"{label}_" for label, _ in label_effects(scene_of(good).effects)}
    except RigidmcError:  # a result without a scene
        return labels
    stated = ("moments", "mass", "centre", "start_", *effects)
    rows = [
        (f"{name}[{k}]" if len(values) > 1 else str(name), variable, row)
        for name, variable in good.data_vars.items()
        if str(name).startswith(stated) and set(variable.dims) - {"axis", "quat"} == {"member"}
        for values in (np.atleast_2d(variable.transpose(..., "member").values),)
        for k, row in enumerate(values, 1)
        if np.ptp(row) > 0.0
    ]
    if len(rows) != 1:
        return labels
    name, variable, row = rows[0]
    texts = [
        f"{in_symbols(name)} = {value_text(x, variable, 4)}".replace("= -", "= −") for x in row
    ]
    return list(texts) if len(set(texts)) == members else labels


def times_of(paths: list[MemberPath]) -> str:
    """Describe the times that paths cover."""
    return f"t = {paths[0].t[0]:.5g} to {max(path.t[-1] for path in paths):.5g} s"


STATES = 1_000_000  # states per batch when computing rates


def note_on(part: xr.Dataset, kind: str) -> str:
    """Return a warning for a picture that joins the points of a `thin_result` by lines; "" if they
    show the motion.

    kind : quantity in the picture, from `rigidmc.planning.saves`
    """
    if part.sizes.get("time", 1) < 3:
        return ""
    shown = float(np.diff(part.time.values).max())
    rates = fastest(part, kind)
    turn = sparse(rates, shown, drawn_members(rates))
    if turn is None:
        return ""
    saves, saved = part.encoding[SAVES]
    if shown > 1.5 * saved and sparse(rates, saved, drawn_members(rates)) is None:
        end = (part.sizes["time"] - 1) * turn.every
        return (
            f"{part.sizes['time']:,} of {saves:,} saves drawn, {shown:.3g} s apart:"
            f" {turn.who()} between them, which lines cannot show;"
            f" draw {end:.2g} s or less of the run"
        )
    return _words(turn, f"between saves {saved:.4g} s apart")


def _words(turn: Sparse, where: str) -> str:
    return f"{turn.who()} {where}: lines misrepresent the motion; use every <= {turn.every:g} s"


def fastest(part: xr.Dataset, kind: str) -> Array:
    """Return the largest rate of each member over the states of a result (member,) [rad/s].

    Without momenta over time, the rates follow from the momenta at the start and from the angle
    between saved attitudes, which is pi at most.
    """
    part = in_principal_axes(part)
    l, _ = omega_or_momentum(part, "momentum")
    moments, by = part.moments.transpose("axis", "member").values, drive_of(part)
    largest, count = np.empty(l.shape[-1]), max(1, STATES // len(l))
    for first in range(0, l.shape[-1], count):
        some = slice(first, first + count)
        body = by._replace(rotor=by.rotor[:, some]) if by.rotor.shape[1] > 1 else by
        rates = getattr(turning_rates(moments[:, some], l[..., some], body), kind)
        largest[some] = np.max(rates, axis=0, where=np.isfinite(rates), initial=0.0)
    if len(l) == 1 and kind in (AXIS, ATTITUDE) and "attitude" in part:
        largest = np.maximum(largest, _turned(part))
    return largest


def angle_rates(ds: xr.Dataset, name: str) -> Array:
    """Return the largest rate of an angle of each member of a result (member,) [rad/s].

    For phi and psi it includes their rates at the saves, which diverge near theta = 0 and pi:

        phi' = (omega_1 sin psi + omega_2 cos psi)/sin theta,   psi' = omega_3 - phi' cos theta
    """
    rates = fastest(ds, ATTITUDE)
    if name not in ("phi", "psi"):
        return rates
    rates = np.maximum(rates, fastest(ds, AXIS))
    if "omega" not in ds and "momentum" not in ds:
        return rates
    omega, _ = omega_or_momentum(ds, "omega")
    q = ds.attitude.transpose("time", "member", "quat").values
    _, theta, psi = np.moveaxis(euler(q), -1, 0)
    with np.errstate(all="ignore"):
        rate = (omega[:, 0] * np.sin(psi) + omega[:, 1] * np.cos(psi)) / np.sin(theta)
        rate = np.abs(omega[:, 2] - rate * np.cos(theta) if name == "psi" else rate)
    rates = np.maximum(rates, np.max(rate, axis=0, where=np.isfinite(rate), initial=0.0))
    return np.asarray(rates)


def drive_of(ds: xr.Dataset) -> Drive:
    """Return the Drive of a result. Without a scene, or without permission to run the code of its
    effects, infer the presence of torques from the conserved quantities; torques may turn in the
    body with omega."""
    try:
        scene = scene_of(ds)
        rotor = [
            ds[name].transpose("axis", "member").values
            for name in map(str, ds.data_vars)
            if name.endswith("_momentum") and name != "start_momentum"
            if "axis" in ds[name].dims and "parameter" not in ds[name].dims
        ]
        return drive(scene.model, scene.run, sum(rotor[1:], rotor[0]) if rotor else None)
    except (RigidmcError, NumbaError):
        kept = "l2_drift_max" in ds and ds.l2_drift_max.attrs.get("conserved", "yes") == "yes"
        return Drive(attitude=not kept)


def _turned(part: xr.Dataset) -> Array:
    """Return the largest ratio of the angle between two attitudes to the time between them
    (member,) [rad/s]."""
    q = part.attitude.transpose("time", "quat", "member").values
    with np.errstate(all="ignore"):
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        half = np.arccos(np.clip(np.abs((q[1:] * q[:-1]).sum(1)), 0.0, 1.0))
        return np.asarray(np.nanmax(2.0 * half / np.diff(part.time.values)[:, None], axis=0))

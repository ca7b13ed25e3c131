"""Saved attitudes in other forms: scipy's Rotation, and Euler angles of any sequence."""

from typing import Any

import numpy as np
import xarray as xr

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.euler_angles import (
    PROPER,
    TEXTBOOK,
    angle_names,
    angles_of_quaternions,
    check_sequence,
    distance_from_lock,
)
from rigidmc.mechanics.rotation import euler
from rigidmc.planning.saves import ATTITUDE, sparse
from rigidmc.results.principal_axes import apply_lazily

_TEXTBOOK_WORDS = {"phi": "precession", "theta": "nutation", "psi": "proper rotation"}


def saved_attitude(ds: xr.Dataset) -> xr.DataArray:
    """Return the attitudes of a result (time, member, quat), or with fewer dimensions if some were
    selected; ValueError if they were not saved."""
    if "attitude" not in ds:
        raise ValueError(
            'the attitude was not saved at all times: run with save=("attitude",) and keep="full"'
        )
    dims = [dim for dim in ("time", "member") if dim in ds.attitude.dims]
    attitude: xr.DataArray = ds.attitude.transpose(*dims, "quat")
    return attitude


def rotation_of(ds: xr.Dataset) -> Any:
    """Return the scipy Rotation of the saved attitudes, the members of each time together."""
    from scipy.spatial.transform import Rotation

    q = saved_attitude(ds).values
    bad = ~np.isfinite(q).all(-1)
    if bad.any():
        raise ValueError(
            f"{np.count_nonzero(bad):,} of {bad.size:,} attitudes are not finite, which a Rotation"
            " cannot be: leave out flagged members, ds.isel(member=(ds.status == 0).values)"
        )
    return Rotation.from_quat(q.reshape(-1, 4) if q.ndim > 1 else q, scalar_first=True)


def euler_of(ds: xr.Dataset, sequence: str, unwrap: bool) -> xr.Dataset:
    """Return the Euler angles of the saved attitudes, as variables by their names."""
    sequence = check_sequence(sequence)
    q, names = saved_attitude(ds), angle_names(sequence)

    def angles_of(q: Array) -> Array:
        if sequence == TEXTBOOK:
            return euler(q)
        angles: Array = np.moveaxis(angles_of_quaternions(sequence, np.moveaxis(q, -1, 0)), 0, -1)
        return angles

    parts = [(q.rename(quat="angle").drop_vars("angle", errors="ignore"), ["angle"])]
    angles = apply_lazily(angles_of, parts, ["three"], {"three": 3})
    dims = q.dims[:-1]
    variables = {
        name: xr.Variable(dims, angles[..., i].variable.data, _attributes(sequence, i))
        for i, name in enumerate(names)
    }
    dataset = xr.Dataset(
        variables, {name: q[name] for name in ("time", "member") if name in q.coords}
    )
    dataset.attrs["sequence"] = sequence
    return _unwrapped(ds, dataset, sequence) if unwrap else dataset


def _attributes(sequence: str, place: int) -> dict[str, Any]:
    """Return the attributes of an angle, by its place in the sequence."""
    name = angle_names(sequence)[place]
    if sequence == TEXTBOOK:
        return {"units": "rad", "long_name": f"angle of {_TEXTBOOK_WORDS[name]}"}
    before = "" if place == 0 else "new " if place == 1 else "last "
    text = f"{name}, {('first', 'second', 'third')[place]} angle of {sequence}"
    attrs = {"units": "rad", "long_name": f"{text}: about the {before}body axis {sequence[place]}"}
    if place != 1:
        ends = "0 and pi" if sequence in PROPER else "-pi/2 and pi/2"
        first, second, third = angle_names(sequence)
        attrs["comment"] = (
            f"where {second} is {ends}, only the sum or the difference of {first} and {third} is"
            f" determined, and {third} is 0; near there, both have the errors of the attitude"
            " divided by the distance"
        )
    return attrs


def _unwrapped(ds: xr.Dataset, angles: xr.Dataset, sequence: str) -> xr.Dataset:
    """Return the angles with the first and the third unwrapped over the saves; ValueError if turns
    may be lost."""
    first, _, third = angle_names(sequence)
    refuse_lost_turns(ds, angles, sequence)
    for name in (first, third):
        values = np.unwrap(angles[name].values, axis=angles[name].dims.index("time"))
        angles[name] = angles[name].copy(data=values)
    return angles


def refuse_lost_turns(ds: xr.Dataset, angles: xr.Dataset, sequence: str) -> None:
    """Raise ValueError if the first or third angle may turn by more than 2 rad between two saves.

    See `_largest_rates`.
    """
    from rigidmc.views.sample import fastest

    between = np.diff(ds.time.values)
    if not between.size:
        return
    spin, longest = fastest(ds, ATTITUDE), float(between.max())
    rates = _largest_rates(ds, angles, sequence, spin)
    locked, each = np.isinf(rates), range(rates.size)
    turn = sparse(np.maximum(np.where(locked, 0.0, rates), spin), longest, each)
    first, _, third = angle_names(sequence)
    where = f"between saves {longest:.4g} s apart, so turns may be lost: use"
    if turn is not None:
        cure = f"every <= {turn.every:g} s in the run or in a rerun of members"
        raise ValueError(f"{first}, {third}: {turn.who()} {where} {cure}")
    if locked.any():
        who = f"{np.count_nonzero(locked):,} of {locked.size:,} members may pass gimbal lock"
        cure = f"a sequence that stays away from it, such as {_other(sequence)}, or a smaller every"
        raise ValueError(f"{first}, {third}: {who} {where} {cure}")


def _largest_rates(ds: xr.Dataset, angles: xr.Dataset, sequence: str, spin: Array) -> Array:
    """Return the largest rates of the first and third angle between saves (member,) [rad/s].

    With the component w of omega across the third axis k, at a distance d from gimbal lock::

        |first'| <= w/sin d,   |third'| <= |omega_k| + w cos d/sin d,   |second'| <= w

    The distance between two saves follows from second', which the third rotation changes by at
    most w |third'| dt. inf where the second angle may reach gimbal lock.

    spin : bound on w and omega_k where omega was not saved (member,)
    """
    _, second, last = (angles[name].values for name in angle_names(sequence))
    omega = _omega(ds)
    distance = distance_from_lock(sequence, second)
    with np.errstate(invalid="ignore", divide="ignore"):
        if omega is None:
            across = along = swing = np.broadcast_to(spin, second.shape)
            third = np.full_like(second, np.inf)
        else:
            j, k = int(sequence[1]) - 1, int(sequence[2]) - 1
            sign = 1.0 if (j - k) % 3 == 1 else -1.0
            x, y = omega[:, j], sign * omega[:, 3 - j - k]  # along e_j and e_k x e_j
            across, along = np.hypot(x, y), np.abs(omega[:, k])
            swing = np.abs(np.cos(last) * x - np.sin(last) * y)
            third = along + np.abs(np.sin(last) * x + np.cos(last) * y) / np.tan(distance)
        across, along, swing, third = (
            np.maximum(x[1:], x[:-1]) for x in (across, along, swing, third)
        )
        dt = np.diff(ds.time.values)[:, None]
        swing = np.fmin(across, swing + across * third * dt)
        closest = 0.5 * (distance[1:] + distance[:-1] - swing * dt)
        rates = np.maximum(across / np.sin(closest), along + across / np.tan(closest))
    rates = np.where((closest > 0.0) | (across == 0.0), rates, np.inf)
    largest: Array = np.max(rates, axis=0, where=~np.isnan(rates), initial=0.0)
    return largest


def _omega(ds: xr.Dataset) -> Array | None:
    """Return omega (time, axis, member) [rad/s]; None if it was not saved."""
    from rigidmc.views.sample import omega_or_momentum

    if "omega" not in ds and "momentum" not in ds:
        return None
    omega: Array = omega_or_momentum(ds, "omega")[0]
    return omega


def _other(sequence: str) -> str:
    """Return a sequence whose gimbal lock is elsewhere, about the same first axis."""
    i, j = sequence[0], sequence[1]
    return f"{i}{j}{i}" if sequence not in PROPER else f"{i}{j}{6 - int(i) - int(j)}"

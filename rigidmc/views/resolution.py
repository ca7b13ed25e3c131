"""Whether lines through what is saved show the motion: what a picture says where they do not.

`rigidmc.planning.turns` has the rule.
"""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.compiler.compose import NumbaError
from rigidmc.errors import RigidmcError
from rigidmc.mechanics.rotation import euler
from rigidmc.planning.turns import ATTITUDE, AXIS, Drive, Sparse, drive, sparse, turning
from rigidmc.scene.scene import scene_of
from rigidmc.views.sample import SAVES, drawn_members, vectors

STATES = 1_000_000  # whose rates are computed at a time

Floats = NDArray[np.float64]


def note_on(part: xr.Dataset, kind: str) -> str:
    """What a picture of a `sample` of a result, joined by lines, has to say; "" if nothing.

    kind : what the picture shows, of `rigidmc.planning.turns`
    """
    if part.sizes.get("time", 1) < 3:
        return ""
    shown = float(np.diff(part.time.values).max())
    rates = fastest(part, kind)
    found = sparse(rates, shown, drawn_members(rates))
    if found is None:
        return ""
    saves, saved = part.encoding[SAVES]
    if shown > 1.5 * saved and sparse(rates, saved, drawn_members(rates)) is None:
        end = (part.sizes["time"] - 1) * found.every
        return (
            f"{part.sizes['time']:,} of {saves:,} saves are drawn, {shown:.3g} s apart:"
            f" {found.who()} between them, which lines do not show;"
            f" draw {end:.2g} s or less of the run"
        )
    return _words(found, f"between saves {saved:.4g} s apart")


def _words(found: Sparse, where: str) -> str:
    return f"{found.who()} {where}: lines show another motion; use every <= {found.every:g} s"


def fastest(part: xr.Dataset, kind: str) -> Floats:
    """The largest rate of each member over the states of a result (member,) [rad/s].

    Without momenta over time those of the start tell it, and how far the attitude turns between
    saves, which is pi at most.
    """
    l, _ = vectors(part, "momentum")
    moments, by = part.moments.transpose("axis", "member").values, drive_of(part)
    found, count = np.empty(l.shape[-1]), max(1, STATES // len(l))
    for first in range(0, l.shape[-1], count):
        some = slice(first, first + count)
        own = by._replace(rotor=by.rotor[:, some]) if by.rotor.shape[1] > 1 else by
        rates = getattr(turning(moments[:, some], l[..., some], own), kind)
        found[some] = np.max(rates, axis=0, where=np.isfinite(rates), initial=0.0)
    if len(l) == 1 and kind in (AXIS, ATTITUDE) and "attitude" in part:
        found = np.maximum(found, _turned(part))
    return found


def angle_rates(ds: xr.Dataset, name: str) -> Floats:
    """The largest rate of an angle of each member of a result (member,) [rad/s].

    phi and psi have their rates at the saves too, which have no bound near theta = 0 and pi:

        phi' = (omega_1 sin psi + omega_2 cos psi)/sin theta,   psi' = omega_3 - phi' cos theta
    """
    found = fastest(ds, ATTITUDE)
    if name not in ("phi", "psi"):
        return found
    found = np.maximum(found, fastest(ds, AXIS))
    if "omega" not in ds and "momentum" not in ds:
        return found
    omega, _ = vectors(ds, "omega")
    q = ds.attitude.transpose("time", "member", "quat").values
    _, theta, psi = np.moveaxis(euler(q), -1, 0)
    with np.errstate(all="ignore"):
        rate = (omega[:, 0] * np.sin(psi) + omega[:, 1] * np.cos(psi)) / np.sin(theta)
        rate = np.abs(omega[:, 2] - rate * np.cos(theta) if name == "psi" else rate)
    found = np.maximum(found, np.max(rate, axis=0, where=np.isfinite(rate), initial=0.0))
    return np.asarray(found)


def drive_of(ds: xr.Dataset) -> Drive:
    """The Drive of a result. Where the code of its effects may not be run, or there is no scene,
    what is conserved tells whether there are torques; these may turn in the body with omega."""
    try:
        scene = scene_of(ds)
        rotor = [
            ds[name].transpose("axis", "member").values
            for name in map(str, ds.data_vars)
            if name.endswith("_momentum") and name != "start_momentum" and "axis" in ds[name].dims
        ]
        return drive(scene.model, scene.run, sum(rotor[1:], rotor[0]) if rotor else None)
    except (RigidmcError, NumbaError, AttributeError, TypeError):
        kept = "l2_drift_max" in ds and ds.l2_drift_max.attrs.get("conserved", "yes") == "yes"
        return Drive(attitude=not kept)


def _turned(part: xr.Dataset) -> Floats:
    """The largest angle between two attitudes (member,), over the time between them [rad/s]."""
    q = part.attitude.transpose("time", "quat", "member").values
    with np.errstate(all="ignore"):
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        half = np.arccos(np.clip(np.abs((q[1:] * q[:-1]).sum(1)), 0.0, 1.0))
        return np.asarray(np.nanmax(2.0 * half / np.diff(part.time.values)[:, None], axis=0))

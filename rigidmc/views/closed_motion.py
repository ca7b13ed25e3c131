"""The motion of the members of a result in closed form: where one covers the scene, a density shows
the motion between the saves, too."""

import numpy as np
import xarray as xr

from rigidmc.engine.compiler.compose import NumbaError
from rigidmc.errors import RigidmcError
from rigidmc.mechanics.lagrange_top import with_axis_third
from rigidmc.planning.closed_form import ClosedMotion, case_of
from rigidmc.planning.initial import initial_block_of, make_sampler
from rigidmc.results.principal_axes import described
from rigidmc.scene.scene import scene_of
from rigidmc.views.sample import thin_result

# states of a density, which fill its bins in under a second; most members that they are of
STATES, MEMBERS = 400_000, 2000
GOLDEN = 0.618034  # fractions of its multiples are even: times shifted by them alias no motion


def case_of_result(good: xr.Dataset) -> ClosedMotion:
    """Return the ClosedMotion of members of a result; SceneError if no closed form covers them."""
    scene = scene_of(good)
    model, members = scene.model, np.asarray(good.member.values, dtype=np.int64)
    sampler = make_sampler(model, scene.run)
    return case_of(model.effects, *initial_block_of(model, sampler, members))


def heavy_tops(good: xr.Dataset) -> ClosedMotion | None:
    """Return the ClosedMotion of members that are all heavy symmetric tops; None for others."""
    try:
        tops = case_of_result(good)
    except ValueError:  # SceneError too
        return None
    return tops if (tops.form > 0).all() else None


def symmetric_about_3(tops: ClosedMotion) -> ClosedMotion:
    """Relabel the axes of heavy symmetric tops so that the symmetry axis is the third."""
    moments, momentum = tops.moments.copy(), tops.momentum.copy()
    attitude = tops.attitude.copy()
    for form in np.unique(tops.form):
        of = tops.form == form
        turned = with_axis_third(int(form), moments[of].T, momentum[of].T, attitude[of].T)
        moments[of], momentum[of], attitude[of] = (v.T for v in turned)
    return tops._replace(moments=moments, momentum=momentum, attitude=attitude)


def sample_of_motion(ds: xr.Dataset) -> tuple[xr.Dataset, str]:
    """Return a sample of a result for a density, and what it is of: "states" of the motion in
    closed form, if one covers the scene and the result has states at three or more times, or "saved
    states", as in `rigidmc.views.sample.thin_result`."""
    part = thin_result(ds)
    if part.sizes.get("time", 1) < 3 or not ("omega" in part or "momentum" in part):
        return part, "saved states"
    some = part.isel(member=slice(None, None, -(-part.sizes["member"] // MEMBERS)))
    try:
        case = case_of_result(some)
    except (RigidmcError, NumbaError, ValueError):
        return part, "saved states"
    count = STATES // some.sizes["member"]
    share = (np.arange(count) + GOLDEN * np.arange(count) % 1.0) / count
    share[-1] = 1.0
    first, last = part.time.values[[0, -1]]
    t = first + share * (last - first)
    motion = case.motion(t)
    states = {"momentum": (motion.momentum, "axis")}
    if "attitude" in part:
        states["attitude"] = motion.attitude, "quat"
    bare = some.drop_dims("time").assign_coords(time=("time", t, part.time.attrs))
    sample = bare.assign({
        name: described(bare, xr.DataArray(values, dims=("time", "member", dim)))
        for name, (values, dim) in states.items()
    })  # fmt: skip
    return sample, "states"

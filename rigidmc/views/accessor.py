"""`ds.rigid`: what one asks of a result, on the Dataset itself. It is there as soon as rigidmc and xarray are imported, see `rigidmc.views.when_imported`."""

import numpy as np
import xarray as xr

PICTURES = (
    "summary",
    "momentum_sphere",
    "axis_sphere",
    "middle_component",
    "start_and_end",
    "drift_histogram",
)


class Pictures:
    """The pictures of `rigidmc.views.ensemble`, each a method: ds.rigid.plot.momentum_sphere()."""

    def __init__(self, dataset):
        self._dataset = dataset

    def __dir__(self):
        return [*super().__dir__(), *PICTURES]

    def __getattr__(self, name):
        from functools import partial

        from rigidmc.views import ensemble

        if name not in PICTURES:
            raise AttributeError(f"no picture '{name}'; known: {', '.join(PICTURES)}")
        return partial(getattr(ensemble, name), self._dataset)


@xr.register_dataset_accessor("rigid")
class Rigid:
    """The physics of a result: energy, drift, polhode, a member run again, pictures, a summary."""

    def __init__(self, dataset):
        self._dataset = dataset
        self.plot = Pictures(dataset)

    def scene(self, allow_code=False):
        """The Scene that the result was made from."""
        from rigidmc.scene.file import scene_of

        return scene_of(self._dataset, allow_code=allow_code)

    def _whole(self):
        """The Dataset; ValueError where time or member was selected away."""
        for dim in ("time", "member"):
            if dim not in self._dataset.dims:
                raise ValueError(
                    f"the dimension {dim} is gone: select with a list, as in ds.isel({dim}=[0])"
                )
        return self._dataset

    def momentum(self):
        """Angular momentum (time, axis, member) in body axes, saved or from omega [kg m2/s]."""
        ds = self._whole()
        if "momentum" in ds:
            return ds.momentum
        if "omega" not in ds:
            raise ValueError(
                'neither momentum nor omega was saved at all times: run with save=("omega",) and keep="full"'
            )
        return (
            (ds.omega * ds.moments)
            .transpose("time", "axis", "member")
            .assign_attrs(units="kg m2 s-1", long_name="angular momentum, body axes")
        )

    def euler(self):
        """Euler angles phi, theta, psi of what attitudes were saved, a Dataset of (time, member), TdC (3.36) [rad]; ValueError where none were."""
        from rigidmc.mechanics.rotation import euler

        if "attitude" not in self._dataset:
            raise ValueError(
                'the attitude was not saved at all times: run with save=("attitude",) and keep="full"'
            )
        q = self._dataset.attitude.transpose("time", "member", "quat")
        words = "precession", "nutation", "proper rotation"
        return xr.Dataset(
            {
                name: (
                    ("time", "member"),
                    values,
                    {"units": "rad", "long_name": f"angle of {word}"},
                )
                for name, values, word in zip(
                    ("phi", "theta", "psi"), np.moveaxis(euler(q.values), -1, 0), words, strict=True
                )
            },
            {name: q[name] for name in ("time", "member")},
        )

    def phase(self):
        """Where on its free motion a body is (time, member): share of the period 4 K(m)/lambda, see `rigidmc.mechanics.free_top.Kind`; under torques
        that of the free motion from there."""
        from rigidmc.mechanics.free_top import free_motion

        l = self.momentum().transpose("time", "member", "axis")
        moments = np.broadcast_to(self._dataset.moments.transpose("member", "axis").values, l.shape)
        found = free_motion(moments, l.values).phase
        attrs = {"units": "1", "long_name": "phase of the free motion, of its period"}
        return xr.DataArray(
            found, {name: l[name] for name in ("time", "member")}, ("time", "member"), attrs=attrs
        )

    def energy(self):
        """Energy (time, member), saved or of what was saved, TdC (3.16), (3.33) [J]; ValueError where the attitude it needs was not."""
        ds = self._whole()
        if "energy" in ds:
            return ds.energy
        l = self.momentum()
        kinetic = 0.5 * (l**2 / ds.moments).sum("axis")
        scene = self.scene()
        held = [e for e in scene.effects if hasattr(e, "energy")]
        if not held:
            return kinetic.rename("energy").assign_attrs(units="J", long_name="energy")
        if "attitude" not in ds:
            raise ValueError("the energy of its effects needs the attitude, which was not saved")
        from rigidmc.engine.forces import energies
        from rigidmc.planning.rates import physics
        from rigidmc.planning.stage import stage

        q, found = np.moveaxis(ds.attitude.transpose("time", "quat", "member").values, 1, 0), []
        runs = np.split(
            np.arange(ds.sizes["member"]), np.flatnonzero(np.diff(ds.member.values) != 1) + 1
        )
        for run in runs:  # of members that follow each other: what is selected may be any
            block, _ = stage(scene, int(ds.member[run[0]]), run.size, True)
            body, effects = physics(scene.effects, block)
            found.append(
                np.broadcast_to(energies(effects, body, tuple(q[..., run])), (q.shape[1], run.size))
            )
        potential = xr.DataArray(np.concatenate(found, axis=1), dims=("time", "member"))
        return (kinetic + potential).rename("energy").assign_attrs(units="J", long_name="energy")

    def drift(self):
        """Relative drift of the energy (time, member), of that at the first save; of the largest kinetic energy where that is 0."""
        energy = self.energy()
        scale = np.abs(energy.isel(time=0))
        scale = scale.where(scale > 0.0, np.abs(energy).max("time"))
        return (
            ((energy - energy.isel(time=0)) / scale)
            .rename("drift")
            .assign_attrs(units="1", long_name="relative drift of the energy")
        )

    def polhode(self, member, points=400):
        """The curve of constant energy and |L|^2 through a member's start (points, axis), on which the momentum of a free body stays [kg m2/s]."""
        from rigidmc.views.sphere import polhodes

        if member not in self._dataset.member.values:
            raise ValueError(
                f"no member {member}; the members are {self._dataset.member.values[0]} to {self._dataset.member.values[-1]}"
            )
        one = self._dataset.sel(member=[member])
        start = one.start_momentum if "start_momentum" in one else one.start_omega * one.moments
        l = start.transpose("axis", "member").values
        size = np.linalg.norm(l, axis=0)
        found = polhodes(l / size, one.moments.values, points)
        return xr.DataArray(
            found[..., 0] * size[0],
            dims=("point", "axis"),
            attrs={"units": "kg m2 s-1", "long_name": f"polhode of member {member}"},
        )

    def rerun(self, member, **options):
        """A member again, with more saved: see `rigidmc.runs.rerun`."""
        from rigidmc.runs.rerun import rerun

        return rerun(self._dataset, member, **options)

    def summary(self):
        """A few lines of text: see `rigidmc.views.summary.summary`."""
        from rigidmc.views.summary import summary

        return summary(self._dataset)

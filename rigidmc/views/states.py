"""Quantities from the saved states of a result: momentum, phase, energy, polhodes."""

import numpy as np
import xarray as xr

from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.methods import implements
from rigidmc.results.principal_axes import apply_lazily
from rigidmc.views.axes import ResultAxes


class ResultStates(ResultAxes):
    """Physics of the saved states of a result; methods import modules at first use."""

    def momentum(self) -> xr.DataArray:
        """Return the angular momentum in body axes, saved or computed from omega.

        Returns
        -------
        xarray.DataArray (time, axis, member) [kg m^2/s]
            L_i = I_i omega_i

        Raises
        ------
        ValueError
            if neither was saved at all times

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> ds.rigid.momentum().shape
        (3, 3, 4)
        """
        from rigidmc.results.principal_axes import described, principal

        ds = self._whole()
        if "momentum" in ds:
            return ds["momentum"]
        if "omega" not in ds:
            raise ValueError(
                "neither momentum nor omega was saved at all times:"
                ' run with save=("omega",) and keep="full"'
            )
        return (
            described(ds, principal(ds, "omega") * ds["moments"])
            .transpose("time", "axis", "member")
            .assign_attrs(units="kg m2 s-1", long_name="angular momentum, body axes")
        )

    def _principal_momentum(self) -> xr.DataArray:
        """Return the angular momentum in the principal axes."""
        from rigidmc.results.principal_axes import principal

        return principal(self._dataset.assign(momentum=self.momentum()), "momentum")

    def phase(self) -> xr.DataArray:
        """Compute the phase of the free motion, as a fraction of its period 4 K(m)/lambda.

        Under torques, it is the phase of a free motion from the same state. See
        `rigidmc.mechanics.free_top.FreeMotionType`.

        Returns
        -------
        xarray.DataArray (time, member)
            phase from 0 to 1

        Raises
        ------
        ValueError
            if neither momentum nor omega was saved at all times

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> ds.rigid.phase()[:, 0].values.round(3).tolist()
        [0.248, 0.316, 0.384]
        """
        from rigidmc.mechanics.free_top import analyse_free_top

        l = self._principal_momentum().transpose("time", "member", "axis")
        parts = [(self._dataset.moments, ["axis"]), (l, ["axis"])]
        phase = apply_lazily(lambda moments, l: analyse_free_top(moments, l).phase, parts)
        return xr.DataArray(
            phase.transpose("time", "member").variable.data,
            {name: l[name] for name in ("time", "member")},
            ("time", "member"),
            attrs={"units": "1", "long_name": "phase of the free motion, fraction of its period"},
        )

    def energy(self) -> xr.DataArray:
        """Return the energy, saved or computed from saved states, TdC (3.16), (3.33).

        With the potential energy V of the effects::

            E = 1/2 L . I^-1 L + V(q)

        Returns
        -------
        xarray.DataArray (time, member) [J]
            E

        Raises
        ------
        ValueError
            if the energy depends on attitudes that were not saved

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> (1e6 * ds.rigid.energy())[:, 0].values.round(1).tolist()
        [575.4, 575.4, 575.4]
        """
        ds = self._whole()
        if "energy" in ds:
            return ds["energy"]
        energy = 0.5 * (self._principal_momentum() ** 2 / ds["moments"]).sum("axis")
        if any(implements(effect, "energy") for effect in self.scene().effects):
            energy = energy + xr.DataArray(self._potential(), dims=("time", "member"))
        return energy.rename("energy").assign_attrs(units="J", long_name="energy")

    def _potential(self) -> Array:
        """Compute the potential energy of the effects (time, member) [J]."""
        from rigidmc.engine.formulas import energies
        from rigidmc.planning.initial import members_at_start
        from rigidmc.planning.steps import physics
        from rigidmc.results.principal_axes import principal

        ds, scene = self._dataset, self.scene()
        if "attitude" not in ds:
            raise ValueError("the energy of the effects needs the attitude, which was not saved")
        attitude = principal(ds, "attitude").transpose("time", "quat", "member")
        q = np.moveaxis(attitude.values, 1, 0)
        # a selection may hold any members: stage each group of consecutive members
        gaps = np.flatnonzero(np.diff(ds.member.values) != 1) + 1
        parts = []
        for run in np.split(np.arange(ds.sizes["member"]), gaps):
            block, _ = members_at_start(scene.model, scene.run, int(ds.member[run[0]]), run.size)
            body, effects = physics(scene.effects, block)
            potential = energies(effects, body, tuple(q[..., run]))
            parts.append(np.broadcast_to(potential, (q.shape[1], run.size)))
        return np.concatenate(parts, axis=1)

    def drift(self) -> xr.DataArray:
        """Compute the relative drift of the energy since the first save.

        The drift is relative to the energy at the first save; if that is 0, to the largest absolute
        energy.

        Returns
        -------
        xarray.DataArray (time, member)
            (E - E(0))/E(0)

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> bool(abs(ds.rigid.drift()).max() < 1e-8)
        True
        """
        energy = self.energy()
        scale = abs(energy.isel(time=0))
        scale = scale.where(scale > 0.0, abs(energy).max("time"))
        drift: xr.DataArray = (energy - energy.isel(time=0)) / scale
        return drift.rename("drift").assign_attrs(
            units="1", long_name="relative drift of the energy"
        )

    def polhode(self, member: int, points: int = 400) -> xr.DataArray:
        """Compute the curve of constant energy and `|L|` through a member's start.

        The momentum of a free body stays on this curve.

        Parameters
        ----------
        member : int
            index of the member
        points : int, optional
            number of points

        Returns
        -------
        xarray.DataArray (points, axis) [kg m^2/s]
            angular momenta in body axes

        Raises
        ------
        ValueError
            for a member that the result does not have

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> ds.rigid.polhode(0, points=100).shape
        (100, 3)
        """
        from rigidmc.results.principal_axes import described, in_principal_axes
        from rigidmc.views.sphere import polhodes

        members = self._dataset.member.values
        if member not in members:
            raise ValueError(f"no member {member}; the members are {members[0]} to {members[-1]}")
        part = self._dataset.sel(member=[member])
        own = in_principal_axes(part)
        start = own.start_momentum if "start_momentum" in own else own.start_omega * own.moments
        l = start.transpose("axis", "member").values
        size = np.linalg.norm(l, axis=0)
        curve = polhodes(l / size, own.moments.values, points)[..., 0] * size[0]
        attrs = {"units": "kg m2 s-1", "long_name": f"polhode of member {member}"}
        polhode = xr.DataArray(curve, dims=("point", "axis"), attrs=attrs)
        return described(part.isel(member=0), polhode)

"""Vectors and attitudes of a result in other axes, and as rotations and Euler angles."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.results.principal_axes import apply_lazily
from rigidmc.scene.body import IDENTITY

_UNTURNED = ("_min", "_max", "_variance")


def _refuse_extremes(name: str) -> None:
    """Raise ValueError for statistics of components, which are no vector in other axes."""
    if name.endswith(_UNTURNED):
        rule = (
            "extremes and variances of components are no vector: no turn gives them in other axes"
        )
        raise ValueError(f"{name}: {rule}; save them from a run in these axes")


class ResultAxes:
    """Axes and attitudes of the saved states of a result; methods import modules at first use."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self._given = dataset

    @property
    def _dataset(self) -> xr.Dataset:
        """The Dataset; ValueError for a map or a study without members."""
        if "member" not in self._given.coords and "member" not in self._given.dims:
            raise ValueError("a map or a study, not a result with members: only scene() works")
        return self._given

    def scene(self, allow_code: bool = False) -> Any:
        """Return the scene of the result.

        Parameters
        ----------
        allow_code : bool, optional
            whether to run the Python files that define its custom effects

        Returns
        -------
        Scene
            the scene from which the result was computed

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0)
        >>> ds.rigid.scene().run.members
        4
        """
        from rigidmc.scene.scene import scene_of

        return scene_of(self._given, allow_code=allow_code)

    def _whole(self) -> xr.Dataset:
        """Return the Dataset; ValueError if a selection removed time or member."""
        for dim in ("time", "member"):
            if dim not in self._dataset.dims:
                raise ValueError(
                    f"dimension {dim} is missing: select with a list, as in ds.isel({dim}=[0])"
                )
        return self._dataset

    def described(self, name: str) -> xr.DataArray:
        """Return saved states in the axes in which the body was described.

        Results are in these axes already, unless the scene asks for the principal axes, with
        `[body] axes = "principal"`, or version 0.1 wrote the result.

        Parameters
        ----------
        name : str
            variable of the result: "omega", "momentum", "attitude", "start_omega", the fixed vector
            of an effect, such as "rotor_momentum", and so on

        Returns
        -------
        xarray.DataArray
            vectors in the described axes, or attitudes of these axes; lazy if the result is lazy
            and dask is installed

        Raises
        ------
        ValueError
            for a variable that is neither a vector in the body nor an attitude, and for extremes
            and variances of components in other axes, which no turn can find

        Examples
        --------
        >>> law = rm.UncertainInertia(np.diag([2.0, 2.5, 3.0]), 0.01 * np.eye(6))
        >>> scene = rm.Scene(rm.Body.from_tensor(law), start=rm.Start(omega=(0.2, 0.3, 1.0)))
        >>> ds = rm.simulate(scene, members=4, dt=0.1, t_end=1.0)
        >>> ds.rigid.described("start_omega").isel(member=0).values.tolist()
        [0.2, 0.3, 1.0]
        """
        from rigidmc.mechanics.rotation import product, quaternion, to_space
        from rigidmc.physics.dynamics.so3 import conjugate
        from rigidmc.results.principal_axes import is_described
        from rigidmc.scene.scene import scene_of

        ds = self._dataset
        stored = self._body_values(name)
        if is_described(ds):
            return stored
        body = scene_of(ds, allow_code=None).body  # needs no physics
        if body.is_turned or body.axes != IDENTITY:
            _refuse_extremes(name)
        kind = "quat" if "quat" in stored.dims else "axis"
        axes = quaternion(np.array(body.axes))

        def turned(values: NDArray[Any], moved: NDArray[Any] | None = None) -> NDArray[Any]:
            turn = axes if moved is None else product(axes, moved)
            if kind == "axis":
                return to_space(turn, values)
            return product(values, np.stack(conjugate(np.moveaxis(turn, -1, 0)), -1))

        parts = [(stored, [kind])]
        if "principal_axes" in ds:
            parts.append((ds.principal_axes.rename(quat="own"), ["own"]))
        values = apply_lazily(turned, parts, [kind]).transpose(*stored.dims)
        text = f"{stored.attrs.get('long_name', name)}; in the described axes"
        return values.assign_coords(stored.coords).assign_attrs({**stored.attrs, "long_name": text})

    def principal(self, name: str) -> xr.DataArray:
        """Return saved states in the principal axes of each member.

        Each principal axis has the number of the axis of the description that is nearest to it.

        Parameters
        ----------
        name : str
            variable of the result: "omega", "momentum", "attitude", "start_omega", "centre", ...

        Returns
        -------
        xarray.DataArray
            vectors in the principal axes, or attitudes of these axes; lazy if the result is lazy

        Raises
        ------
        ValueError
            as `described`

        Examples
        --------
        >>> body = rm.Body.from_tensor([[1.36, -0.48, 0.0], [-0.48, 1.64, 0.0], [0.0, 0.0, 2.5]])
        >>> scene = rm.Scene(body, start=rm.Start(omega=(0.8, 0.6, 1.0)))
        >>> ds = rm.simulate(scene, members=1, dt=0.1, t_end=1.0)
        >>> abs(ds.rigid.principal("start_omega").isel(member=0)).values.round(12).tolist()
        [1.0, 0.0, 1.0]
        """
        from rigidmc.results.principal_axes import is_described, principal

        values = self._body_values(name)
        if not is_described(self._dataset):
            return values
        _refuse_extremes(name)
        text = f"{values.attrs.get('long_name', name)}; in the principal axes"
        return principal(self._dataset, name).assign_attrs({**values.attrs, "long_name": text})

    def _body_values(self, name: str) -> xr.DataArray:
        """Return a variable; ValueError unless it is a vector in the body or an attitude."""
        values = self._dataset.get(name)
        if values is None or not {"axis", "quat"} & {*values.dims} or name == "moments":
            rule = "neither a vector in the body nor an attitude of this result"
            raise ValueError(f"{name}: {rule}")
        if "parameter" in values.dims:
            rule = "derivatives are in the axes of the result: other axes may change, too"
            raise ValueError(f"{name}: {rule}")
        return values

    def rotation(self) -> Any:
        """Return the saved attitudes as a scipy Rotation, from body to space.

        Returns
        -------
        scipy.spatial.transform.Rotation
            one rotation for each time and member, in this order: all members at the first time,
            then all members at the second; as_quat().reshape(times, members, 4) separates them.
            `ds.isel(time=-1)` gives one for each member, `ds.isel(member=0)` one for each time

        Raises
        ------
        ValueError
            if the attitude was not saved, or is nan, as for members with an impossible start

        Examples
        --------
        >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0, every=0.5)
        >>> ds = rm.simulate(scene, save=("attitude",))
        >>> len(ds.rigid.rotation()), len(ds.isel(time=-1).rigid.rotation())
        (12, 4)
        """
        from rigidmc.views.attitudes import rotation_of

        return rotation_of(self._dataset)

    def euler(self, sequence: str = "313", unwrap: bool = False) -> xr.Dataset:
        """Compute Euler angles of the saved attitudes, of any of the 12 sequences.

        The sequence names the body axes of the three rotations::

            A = R_i(first) R_j(second) R_k(third)

        By default, z-x-z with phi, theta and psi, TdC (3.36). "321" has yaw, pitch and roll; scipy
        calls it "ZYX".

        Parameters
        ----------
        sequence : str, optional
            digits of the axes, such as "321", or scipy's word in capitals
        unwrap : bool, optional
            remove the jumps of 2 pi of the first and third angle over the saves; this reads all
            saves, others are lazy if the result is lazy and dask is installed

        Returns
        -------
        xarray.Dataset
            phi, theta, psi of a proper sequence, or roll, pitch, yaw about the axes 1, 2, 3 of a
            Tait-Bryan sequence, in the order of the rotations (time, member) [rad]. phi, psi and
            the first and third angle lie in (-pi, pi], theta in [0, pi], the second angle of a
            Tait-Bryan sequence in [-pi/2, pi/2]. At the ends of the latter two ranges (gimbal
            lock), the third angle is 0. Write ["roll"]: `.roll` is a method of Datasets

        Raises
        ------
        ValueError
            if the attitude was not saved; with `unwrap`, if an angle may turn by more than 2 rad
            between saves, so that turns could be lost
        SceneError
            for an unknown sequence

        Examples
        --------
        >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0, every=0.5)
        >>> ds = rm.simulate(scene, save=("omega", "attitude"))
        >>> ds.rigid.euler().theta[:, 0].values.round(3).tolist()
        [0.0, 0.011, 0.064]
        >>> list(ds.rigid.euler("321"))
        ['yaw', 'pitch', 'roll']
        """
        from rigidmc.views.attitudes import euler_of

        return euler_of(self._whole() if unwrap else self._dataset, sequence, unwrap)

    def unwrapped(self, name: str) -> xr.DataArray:
        """Unwrap an angle over the saves: remove the jumps of 2 pi.

        Parameters
        ----------
        name : str
            "phi" or "psi" of `euler`, or a saved variable in rad, such as "orbit_angles"

        Returns
        -------
        xarray.DataArray (time, ..., member) [rad]
            the angle, including whole turns

        Raises
        ------
        ValueError
            if the angle was not saved, or if a member turns by more than 2 rad between saves, so
            that turns could be lost; the message names the `every` to use

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("heavy_top"), members=4, t_end=0.8)
        >>> turns = ds.rigid.unwrapped("psi") / (2.0 * np.pi)
        >>> turns[-1].values.round(1).tolist()
        [25.9, 24.4, 24.9, 25.3]
        """
        from rigidmc.planning.saves import sparse
        from rigidmc.views.sample import angle_rates

        ds = self._whole()
        angles = self.euler()[name] if name in ("phi", "psi") else ds.get(name)
        if angles is None or angles.attrs.get("units") != "rad" or "time" not in angles.dims:
            raise ValueError(f"{name}: expected phi, psi or an angle [rad] saved at all times")
        between = float(np.diff(ds.time.values).max(initial=0.0))
        turn = sparse(angle_rates(ds, name), between, range(ds.sizes["member"]))
        if turn is not None:
            raise ValueError(
                f"{name}: {turn.who()} between saves {between:.4g} s apart, so turns may be lost:"
                f" use every <= {turn.every:g} s in the run or in a rerun of members"
            )
        axis = angles.dims.index("time")
        return angles.copy(data=np.unwrap(angles.values, axis=axis))

"""The layout of a result: its variables, sizes, coordinates and attributes, made once for a run. A
Dataset in memory and a netCDF file have the same layout."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.inputs.arrays import Array, Ints
from rigidmc.physics.effects import label_effects
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.results.variables import ROTATED, Variable
from rigidmc.scene.derivatives import derivative_name
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.recording import Recording
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import with_changes
from rigidmc.version import VERSION

Coordinate = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]  # dimensions, values, attributes


class Axes(NamedTuple):
    """The axes of a result besides its members.

    times : of the saves [s];  thinned : indices of the saves kept for thinned observables
    labels : of the effects whose works are saved
    bins : (dimension, edges, units) of each histogram;  dims : dimensions of all kept observables
    parameters, parameter_units : of the derivatives
    """

    times: Array
    thinned: Ints
    labels: tuple[str, ...]
    bins: tuple[tuple[str, Array, str], ...]
    dims: tuple[str, ...]
    parameters: tuple[str, ...] = ()
    parameter_units: tuple[str, ...] = ()

    def coordinates(self, members: Sequence[int] | NDArray[Any] = ()) -> dict[str, Coordinate]:
        """Return coordinates as {name: (dims, values, attrs)}; members : their indices."""
        effects: dict[str, Coordinate] = {}
        if self.labels:
            about = {"long_name": "effect of the scene"}
            effects["effect"] = (("effect",), np.array(self.labels), about)
        thinned: dict[str, Coordinate] = {}
        if self.thinned.size:
            about = {"units": "s", "long_name": "save time of thinned variables"}
            thinned["thinned_time"] = (("thinned_time",), self.times[self.thinned], about)
        bins: dict[str, Coordinate] = {}
        for name, edges, units in self.bins:
            middles, width = 0.5 * (edges[1:] + edges[:-1]), edges[1] - edges[0]
            text = {"units": units, "long_name": "middle of the bin", "width": width}
            bins[name] = ((name,), middles, text)
        derivatives: dict[str, Coordinate] = {}
        if self.parameters:
            about = {"long_name": "parameter of the derivatives"}
            derivatives["parameter"] = (("parameter",), np.array(self.parameters), about)
            about = {"long_name": "unit of the parameter"}
            derivatives["parameter_unit"] = (("parameter",), np.array(self.parameter_units), about)
        indices = np.asarray(members, np.int64)
        return {
            **effects,
            **derivatives,
            **bins,
            "member": (("member",), indices, {"long_name": "index of the member"}),
            "time": (("time",), self.times.copy(), {"units": "s", "long_name": "time"}),
            **thinned,
            **{
                name: ((name,), np.array(labels), {"long_name": text})
                for name, (labels, text) in DIMENSIONS.items()
                if name in ("axis", "quat", *self.dims)
            },
        }

    def lengths(self, members: int) -> dict[str, Any]:
        """Return {dimension: size}; None for `flagged`, which grows."""
        bins = {name: edges.size - 1 for name, edges, _ in self.bins}
        times = {"time": self.times.size, "thinned_time": self.thinned.size}
        return {
            **bins,
            **times,
            "member": members,
            "flagged": None,
            "effect": len(self.labels),
            "parameter": len(self.parameters),
            "component": 6,
            **{name: len(labels) for name, (labels, _) in DIMENSIONS.items()},
        }


class Selection(NamedTuple):
    """The members of a run, or of a part of it.

    first, size : place of the first member, and number of members
    which : the indices of the members at places 0, 1, ...; None if they are these numbers
    block : members moved together, which are a chunk of a file; 0 if that is still open
    """

    first: int
    size: int
    which: Ints | None = None
    block: int = 0

    @classmethod
    def of(cls, members: range | Ints) -> "Selection":
        """Return the members of a range of indices, or of increasing indices."""
        if isinstance(members, range):
            return cls(members.start, len(members))
        return cls(0, members.size, members)

    def indices(self, first: int, count: int) -> Ints:
        """Return the indices of `count` members from place `first` on; beyond the end of chosen
        indices, repeat the last."""
        if self.which is None:
            return np.arange(first, first + count)
        return self.which[np.minimum(np.arange(first, first + count), self.which.size - 1)]


class ResultLayout(NamedTuple):
    """The layout of the result of a run, in the units of its scene.

    scene : the scene of the result;  settings : of [run], which replace the settings of the scene
        in its text, because a rerun needs them
    facts : the attributes after the integrator
    saved : {observable: rows of its values} recorded at saves
    by_member, at_saves, of_ensemble, of_flagged : {name: Variable}
    constant : names of variables that all members share, stored once in memory
    columns : derivatives of a saved value in memory, see `rigidmc.planning.plan.Plan`
    """

    scene: Scene
    settings: dict[str, Any]
    facts: dict[str, Any]
    axes: Axes
    recording: Recording
    saved: dict[str, slice]
    by_member: dict[str, Variable]
    at_saves: dict[str, Variable]
    of_ensemble: dict[str, Variable]
    of_flagged: dict[str, Variable]
    constant: frozenset[str]
    columns: int = 0

    @property
    def values(self) -> int:
        """Number of values that a member records at a save."""
        return max((rows.stop for rows in self.saved.values()), default=0)

    def names_of(self, observable: str) -> tuple[str, ...]:
        """Return the names of a saved observable and, if the run has them, of its derivatives."""
        more = (derivative_name(observable),) if self.axes.parameters else ()
        return observable, *more

    @property
    def numbers(self) -> int:
        """Number of values and derivatives that a member saves in all."""
        return self.axes.times.size * self.values * (1 + self.columns)

    def saves(self, out: Array, width: int) -> Array:
        """Return the memory of saves as an array (time, value, 1 + columns, width): in column 0
        the values, in column 1 + j their derivatives by parameter j."""
        return out.reshape(self.axes.times.size, self.values, 1 + self.columns, width)

    def split(self, saves: Array) -> dict[str, Array]:
        """Return {name: view} of the members in `saves`, for each observable and its derivatives.

        Values are (time, component, member), derivatives (parameter, time, component, member);
        scalars have no components.
        """
        views = {}
        for name, rows in self.saved.items():
            dims = self.recording.observable(name).dims
            views[name] = saves[:, rows if dims else rows.start, 0]
            if self.axes.parameters:
                turns = dims == ROTATED  # three numbers in place of four
                some = slice(rows.start, rows.start + 3) if turns else rows if dims else rows.start
                columns = slice(1, 1 + len(self.axes.parameters))
                views[derivative_name(name)] = np.moveaxis(saves[:, some, columns], -2, 0)
        return views

    @property
    def variables(self) -> dict[str, Variable]:
        """{name: Variable} of all variables."""
        return {**self.by_member, **self.at_saves, **self.of_ensemble, **self.of_flagged}

    def attributes(self) -> dict[str, Any]:
        """Return the global attributes. The scene's TOML and the member range suffice for a rerun
        to the bit."""
        return {
            "Conventions": "CF-1.11",
            "title": self.scene.title,
            "source": f"rigidmc {VERSION}",
            "version": VERSION,
            "scene": self.text(),
            "seed": self.scene.run.seed,
            "integrator": self.scene.run.integrator,
            **self.facts,
            **({"body_axes": self.scene.body.frame} if self.scene.body.is_turned else {}),
        }

    def text(self) -> str:
        """Return the scene as TOML text."""
        settings = {name: value for name, value in self.settings.items() if value is not None}
        return self.scene.dumps(with_changes(self.scene.run, settings))

    def is_rounded(self, name: str) -> bool:
        """Whether files round a variable to a number of digits. They round saves over time, but
        never variables from which a run could start, nor flagged members."""
        dims, dtype, _ = self.variables[name]
        return (
            self.scene.run.digits is not None
            and not {"time", "thinned_time"}.isdisjoint(dims)
            and dims[-1] == "member"
            and dtype == "f8"
        )

    def bytes_of_a_member(self) -> tuple[int, int]:
        """Return the bytes of a member before compression: (of shared values, of other values)."""
        same = other = 0
        sizes = self.axes.lengths(1)
        for name, (dims, dtype, _) in {**self.by_member, **self.at_saves}.items():
            size = math.prod(sizes[dim] for dim in dims) * np.dtype(dtype).itemsize
            same, other = (same + size, other) if name in self.constant else (same, other + size)
        return same, other


def labels_of_works(effects: Sequence[Any], recording: Recording) -> tuple[str, ...]:
    """Return the labels of the effects whose works are saved."""
    return tuple(label for label, _ in label_effects(effects)) if recording.has_work else ()


def constant_variables(model: Model) -> frozenset[str]:
    """Return the names of member variables that all members share."""
    spin = model.start.spin_name
    variables = {
        "moments": model.body.moments,
        "mass": model.body.mass,
        "centre": model.body.centre,
        f"start_{spin}": getattr(model.start, spin),
        "start_attitude": model.start.attitude,
    }
    if model.body.inertia_key == "tensor":  # each member has its own axes
        return frozenset()
    for key in model.start.relative_to_orbit:  # the member's orbit adds to it
        variables.pop(f"start_{key}")
    shared = frozenset(name for name, value in variables.items() if is_shared(value))
    return shared | {"principal_axes"} if model.body.is_turned else shared

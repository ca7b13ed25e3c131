"""The parameters of a fit: numbers of the scene and nuisances of sensors, as one vector.

Numbers of a body and of effects belong to all records, numbers of a start to one record each. A fit
moves in coordinates in which every trial is a body: for principal moments these are u_i = ln J_i of
the second moments J_i > 0, with I_1 = J_2 + J_3 and so on. All other parameters are coordinates
themselves. Source: Wensing, Kim & Slotine, IEEE RA-L 3 (2018) 60.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.mechanics.rotation import hat
from rigidmc.studies.fit.streams import NUISANCES, Array, Stream

PAIRS = np.ones((3, 3)) - np.eye(3)  # I = PAIRS J
MOMENTS = "body.moments"
EXTREME = 20.0  # of ln J: a trial beyond a factor of 5e8 cannot be held in a hand


class Column(NamedTuple):
    """A parameter of one record: a number or vector of the scene, or a nuisance of a sensor.

    name : of the parameter;  first, size : its columns among all of a record
    stream : place of its stream, -1 for a number of the scene;  word : a nuisance, or ""
    is_shared : whether all records have the same
    """

    name: str
    first: int
    size: int
    is_shared: bool
    stream: int = -1
    word: str = ""

    @property
    def columns(self) -> slice:
        """Its columns among all of a record."""
        return slice(self.first, self.first + self.size)


class FitParameters:
    """The layout of the parameters of a fit.

    columns : of one record, first what changes the motion, and moments before all others
    index : place in the vector of all parameters of each column of a record, (records, columns)
    names : of all parameters
    moving : number of columns that change the motion
    moments, quaternions : places of those that are free, (n, 3) and (n, 4); the length of a
        quaternion says nothing
    low, high : limits of the coordinates
    """

    def __init__(
        self,
        nominal: Mapping[str, float | Sequence[float]],
        shared: Sequence[str],
        streams: Sequence[Stream],
        records: int,
        limits: Mapping[str, tuple[float, float]] = {},
        tied: Mapping[str, str] = {},
        inputs: Mapping[str, Array] = {},
    ) -> None:
        """nominal : {parameter of the scene: its value}, moments before all others
        shared : what all records have in common
        limits : {parameter of the scene: least and largest value of its components}
        tied : {parameter of the scene: the nuisance with which it is one}
        inputs : {parameter of the scene: its known value in each record, (records, size)}
        """
        self.tied, self.inputs = tied, inputs
        self.nominal = {name: np.atleast_1d(np.asarray(x, float)) for name, x in nominal.items()}
        self.is_vector = {name: np.ndim(x) == 1 for name, x in nominal.items()}
        columns, at = list[Column](), 0
        for name, x in self.nominal.items():
            columns.append(Column(name, at, x.size, name in shared))
            at += x.size
        self.moving = at
        for i, stream in enumerate(streams):
            for word in stream.nuisances:
                name, size = f"{stream.observable}.{word}", stream.size_of(word)
                columns.append(Column(name, at, size, NUISANCES[word].is_shared, i, word))
                at += size
        self.columns, self.records = tuple(columns), records
        self.index, self.names = self._places(at)
        self.moments = self._vectors(MOMENTS, 3)
        self.quaternions = self._vectors("start.attitude", 4)
        self.low, self.high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for name, (low, high) in limits.items():
            self.low[self.places_of(name)], self.high[self.places_of(name)] = low, high
        if self.mixed:  # in their own coordinates
            middle = np.log(np.mean(self.nominal[MOMENTS]))
            self.low[self.moments], self.high[self.moments] = middle - EXTREME, middle + EXTREME

    def _places(self, size: int) -> tuple[NDArray[np.int64], list[str]]:
        """Return `index` and `names`."""
        index, names = np.empty((self.records, size), np.int64), list[str]()
        places = dict[str, NDArray[np.int64]]()
        for column in self.columns:
            for record in range(self.records):
                name = self.tied.get(column.name, column.name)
                if not column.is_shared and self.records > 1:
                    name += f"[{record + 1}]"
                if name not in places:
                    places[name] = len(names) + np.arange(column.size)
                    each = [f".{k + 1}" for k in range(column.size)] if column.size > 1 else [""]
                    names += [name + word for word in each]
                index[record, column.columns] = places[name]
        return index, names

    def _vectors(self, name: str, size: int) -> NDArray[np.int64]:
        """Return the places of a free vector (n, size), once if all records have the same."""
        is_free = len(self.nominal.get(name, ())) == size
        return np.unique(self.places_of(name), axis=0) if is_free else np.empty((0, size), np.int64)

    @property
    def size(self) -> int:
        """Number of all parameters."""
        return len(self.names)

    @property
    def mixed(self) -> int:
        """Number of columns whose derivatives the coordinates mix: the moments, or none."""
        return 3 if MOMENTS in self.nominal else 0

    def places_of(self, name: str) -> NDArray[np.int64]:
        """Return the places of a parameter, (records, components)."""
        (column,) = (c for c in self.columns if c.name == name)
        return self.index[:, column.columns]

    def coordinates(self, given: Mapping[str, Any]) -> Array:
        """Return the coordinates of parameters by name, (components,) or (records, components);
        the nominal values of the others, and 0 for nuisances."""
        values = np.zeros(self.size)
        for column in self.columns:
            value = given.get(column.name, self.nominal.get(column.name, 0.0))
            values[self.index[:, column.columns]] = value
        return self.coordinates_of(values)

    def coordinates_of(self, values: Array) -> Array:
        """Return the coordinates of values (..., size) of all parameters."""
        x, moments = np.array(values), values[..., self.moments]
        least = 1e-6 * moments.max(-1, keepdims=True)  # noise may ask for a plate, or less
        x[..., self.moments] = np.log(np.maximum(moments @ np.linalg.inv(PAIRS), least))
        return x

    def of_scene(self, x: Array) -> dict[str, Any]:
        """Return {parameter of the scene: values of each member, or their columns} of trials
        (trials, size); members are the records of the first trial, then of the next."""
        rows = x[:, self.index].reshape(-1, self.index.shape[1])
        values: dict[str, Any] = {
            k: tuple(np.tile(y, (len(x), 1)).T) for k, y in self.inputs.items()
        }
        for column in self.columns:
            if column.stream < 0:
                part = rows[:, column.columns]
                part = np.exp(part) @ PAIRS if column.name == MOMENTS else part
                # columns: three members of a vector would read two ways as an array
                values[column.name] = tuple(part.T) if self.is_vector[column.name] else part[:, 0]
        return values

    def of_sensor(self, x: Array, stream: int) -> dict[str, Array]:
        """Return {nuisance: values of each member, (members, components)} of a stream."""
        rows = x[:, self.index].reshape(-1, self.index.shape[1])
        return {c.word: rows[:, c.columns] for c in self.columns if c.stream == stream}

    def chain(self, x: Array) -> Array:
        """Return the derivatives of the first `mixed` parameters by their coordinates, for each
        member: (mixed, mixed, members)."""
        rows = x[:, self.index[:, : self.mixed]].reshape(x.shape[0] * self.records, self.mixed)
        return np.ascontiguousarray(PAIRS[: self.mixed, : self.mixed, None] * np.exp(rows.T))

    def turns(self, x: Array, every: float) -> Array:
        """Return the derivatives of rotations of the sensors, and of offsets in distances of saves
        `every` [s], by their coordinates, the identity for all other columns: (members, columns,
        columns)."""
        rows = x[:, self.index].reshape(-1, self.index.shape[1])
        turns = np.tile(np.eye(rows.shape[1]), (rows.shape[0], 1, 1))
        at = {column.name: column.columns for column in self.columns}
        for column in self.columns:
            own = column.columns
            if column.word == "alignment":
                turns[:, own, own] = left_jacobian(rows[:, own])
            elif column.word == "offset":
                turns[:, own, own] = 1.0 / every
            elif column.name in self.tied:  # as both have one place, where the later column counts
                turns[:, own, at[self.tied[column.name]]], turns[:, own, own] = np.eye(3), 0.0
        return turns

    def values(self, x: Array) -> Array:
        """Return parameters (size,) from their coordinates."""
        values = np.array(x)
        values[self.moments] = np.exp(x[self.moments]) @ PAIRS
        for places in self.quaternions:
            values[places] /= np.copysign(np.linalg.norm(x[places]), x[places[0]])
        return values

    def slopes(self, x: Array) -> Array:
        """Return the derivatives of the parameters by their coordinates, (size, size)."""
        slopes = np.eye(self.size)
        for places in self.moments:
            slopes[np.ix_(places, places)] = PAIRS * np.exp(x[places])
        for places in self.quaternions:
            size = np.copysign(np.linalg.norm(x[places]), x[places[0]])
            across = np.eye(4) - np.outer(x[places], x[places]) / size**2
            slopes[np.ix_(places, places)] = across / size
        return slopes


def record_of(name: str) -> tuple[str, int]:
    """Return (the parameter without its record, the number of this record, 0 for all)."""
    first, _, rest = name.partition("[")
    number, _, last = rest.partition("]")
    return first + last, int(number or 0)


def ratios(value: Array, slopes: Array, i: Any, j: Any) -> tuple[Array, Array]:
    """Return (numbers i over numbers j, their derivatives) of values and their derivatives."""
    ratio = value[i] / value[j]
    return ratio, (slopes[i] - ratio[:, None] * slopes[j]) / value[j][:, None]


def left_jacobian(turn: Array) -> Array:
    """Return the derivatives (n, 3, 3) of small rotations d, exp([d]x) exp([a]x), by a (n, 3).

        J = 1 + (1 - cos a)/a^2 [a]x + (a - sin a)/a^3 [a]x^2

    Source: Chirikjian, Stochastic Models, Information Theory, and Lie Groups 2 (2012), (10.86).
    """
    angle, cross = np.linalg.norm(turn, axis=1)[:, None, None], hat(turn)
    first = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    # By a series below 1e-2, where a - sin a has lost half of its digits: the next term is 1e-9.
    a = np.maximum(angle, 1e-2)
    second = np.where(a > angle, 1.0 / 6.0 - angle**2 / 120.0, (a - np.sin(a)) / a**3)
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))

"""The numbers by which a scene states a body whose inertia then moves to its fixed point.

Mass and centre of mass enter the moved tensor: a change of either is more than a change of
`Body.mass` and `Body.centre`. Derivatives, maps and `--along` are by the stated numbers.
"""

from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np

from rigidmc.inputs.arrays import Array, as_tuples
from rigidmc.mechanics.inertia import shift
from rigidmc.scene.inertia_about import ASSUMED_MASS, mass_and_centre

ORIGIN = (0.0, 0.0, 0.0)
# why a body has no derivative by some of its stated numbers, in place of `Stated`
NO_RATE = (
    "enters the inertia about the fixed point, and only plain numbers are moved there: give the"
    " inertia about the fixed point"
)
MESH = "is in proportion to the moments of the mesh: give moments, mass and centre in its place"


class Stated(NamedTuple):
    """The stated numbers of a body, plain and in SI units.

    inertia : moments (3,), or a tensor (3, 3)
    mass : None if not given
    centre : (3,) from the origin of the described axes
    about : the point of the inertia, "pivot" for the origin, or "centre"
    axes : principal axes (3, 3) of the moments; None for the described axes
    pivot : the fixed point (3,), "centre", or None for the origin
    """

    inertia: Any
    mass: Any = None
    centre: Any = ORIGIN
    about: str = "pivot"
    axes: Any = None
    pivot: Any = None

    @classmethod
    def about_centre(cls, inertia: Any, mass: Any, centre: Any) -> Self:
        """Return the statement of plain moments or a tensor about the centre of mass."""
        m, c = mass_and_centre(mass, centre)
        return cls(inertia, None if mass is None else m, c, "centre")

    @property
    def key(self) -> str:
        """Key for the inertia in a scene file, "moments" or "tensor"."""
        return "tensor" if isinstance(self.inertia[0], tuple) else "moments"

    @property
    def is_free(self) -> bool:
        """Whether the inertia is about the centre of mass, and this is the fixed point."""
        return (self.about, self.pivot) == ("centre", "centre")

    def tensor(self) -> Array:
        """Return the stated inertia (3, 3) in the described axes, about its own point."""
        stated = np.array(self.inertia)
        axes = np.eye(3) if self.axes is None else np.array(self.axes)
        return stated if self.key == "tensor" else (axes * stated) @ axes.T

    def arms(self) -> tuple[Array, Array]:
        """Return the centre of mass from the point of the inertia, and from the fixed point."""
        centre, zero = np.array(self.centre), np.zeros(3)
        moved = zero if self.pivot == "centre" else centre - np.array(self.origin_to_pivot())
        return (zero if self.about == "centre" else centre), moved

    def origin_to_pivot(self) -> Any:
        """Return the fixed point (3,) in the described axes."""
        return self.centre if self.pivot == "centre" else self.pivot or ORIGIN

    def is_of(self, tensor: Array, mass: float, centre: Any) -> bool:
        """Return whether a body with this tensor about its fixed point has the stated numbers."""
        m, tensor_stated, (old, new) = _mass(self), self.tensor(), self.arms()
        size = np.abs(tensor_stated).max() + m * (old @ old + new @ new)
        off = np.abs(tensor_stated + m * (shift(new) - shift(old)) - tensor).max() / size
        away = np.abs(np.array(centre) - new).max() * np.sqrt(m / size)
        return bool(m == mass and max(off, away) < 1e-12)  # rounding

    def make(self, kind: Any, frame: str, parts: Any = ()) -> Any:
        """Return the Body of class `kind` with these numbers, as a scene file makes it; SceneError.

        parts : solids that pictures draw
        """
        about, centre = self.about, self.centre
        if self.is_free:
            # where the centre of mass was does not matter, and moving there and back costs digits
            about, centre = "pivot", ORIGIN
        numbers = self.inertia, self.mass, centre, about
        if self.key == "moments":
            body = replace(kind.from_moments(*numbers), frame=frame)
        else:
            body = kind.from_tensor(*numbers, frame)
        if self.axes is not None:
            body = replace(body, axes=self.axes)
        if self.pivot == "centre" and not self.is_free:
            body = body.with_pivot_at_centre()
        elif isinstance(self.pivot, tuple):
            body = body.with_pivot(self.pivot)
        return replace(body, shape=parts, stated=self)

    def scaled(self, mass: float, length: float) -> Self:
        """Return the numbers in units that multiply masses and lengths by these factors."""
        by = {"inertia": mass * length**2, "mass": mass, "centre": length, "pivot": length}
        values = {key: getattr(self, key) for key in by}
        return self._replace(
            **{
                key: value
                if value is None or value == "centre"
                else as_tuples(by[key] * np.array(value))
                for key, value in values.items()
            }
        )

    def as_table(self) -> dict[str, Any]:
        """Return the numbers by the keys of a scene file."""
        values = self._asdict()
        table = {self.key: values.pop("inertia"), "principal_axes": values.pop("axes"), **values}
        return {key: value for key, value in table.items() if value is not None}

    def rates(self) -> dict[tuple[Any, ...], tuple[float, Array, Array]]:
        """Return {(field, *indices): relative rate of the mass, rates of the centre of mass from
        the fixed point and of the tensor about it}, with C = m (c^2 1 - c c^T) of either arm c,
        TdC (3.26):

            I = J - C_stated + C_moved
        """
        m, (old, new), zero, unit = _mass(self), self.arms(), np.zeros((3, 3)), np.eye(3)
        rates: dict[tuple[Any, ...], tuple[float, Array, Array]] = {
            place: (0.0, zero[0], change) for place, change in self._inertia_rates().items()
        }
        rates["mass",] = 1.0 / m, zero[0], shift(new) - shift(old)
        by_old = zero if self.about == "centre" else unit
        by_new = zero if self.pivot == "centre" else unit
        for i in range(3):
            change = m * (_shift_rate(new, by_new[i]) - _shift_rate(old, by_old[i]))
            rates["centre", i] = 0.0, by_new[i], change
            if isinstance(self.pivot, tuple):
                rates["pivot", i] = 0.0, -unit[i], -m * _shift_rate(new, unit[i])
        return rates

    def _inertia_rates(self) -> dict[tuple[Any, ...], Array]:
        """Return the rates of the stated tensor by its elements, and by the stated moments."""
        axes = np.eye(3) if self.axes is None else np.array(self.axes)
        rates = dict[tuple[Any, ...], Array]()
        for i in range(3):
            if self.key == "moments":
                rates["moments", i] = np.outer(axes[:, i], axes[:, i])
            for j in range(i, 3):
                unit = np.zeros((3, 3))
                unit[i, j] = unit[j, i] = 1.0
                rates["tensor", i, j] = unit
        return rates


def refused_numbers(stated: Stated | str | None) -> dict[str, str]:
    """Return {parameter: why a body has no derivative by it, and no map along it}."""
    if stated == MESH:
        return dict.fromkeys(("body.mass", "body.density", "body.scale"), MESH)
    names = ["body.mass", *(f"body.centre.{i}" for i in (1, 2, 3))]
    # of the centre and of the mass, of which the moved tensor depends, too
    names += [f"body.tensor.covariance.{i}.{j}" for j in range(7, 11) for i in range(1, j + 1)]
    return dict.fromkeys(names, NO_RATE) if stated == NO_RATE else {}


def _mass(stated: Stated) -> float:
    return ASSUMED_MASS if stated.mass is None else float(stated.mass)


def _shift_rate(c: Array, by: Array) -> Array:
    """Return the rate 2 c.b 1 - c b^T - b c^T of c^2 1 - c c^T for the rate b of c."""
    rate: Array = 2.0 * (c @ by) * np.eye(3) - np.outer(c, by) - np.outer(by, c)
    return rate

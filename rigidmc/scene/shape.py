"""The shape of a body: the solids that pictures draw, without effect on the motion."""

import inspect
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import SceneError, unknown
from rigidmc.files.reading import MESHES, sha256_of
from rigidmc.inputs.arrays import Array, as_tuples, floats
from rigidmc.mechanics import rotation
from rigidmc.mechanics.solids import COMPONENTS, SOLIDS

ORIGIN, UPRIGHT = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
MOST_CORNERS = 2000  # of a mesh; the text of a scene with 1,902 corners has 320 kB
MOST_PARTS = 200


class ShapePart(NamedTuple):
    """A solid of a shape, placed in the described axes of its body.

    solid : a name in `rigidmc.mechanics.solids.SOLIDS`, "particles", "mesh" or "mesh_file"
    sizes : {name: number or tuple of numbers} [m], the arguments of its maker without mass
    at, turned : its origin [m] and its attitude in the described axes
    hole : whether the solid is subtracted
    """

    solid: str
    sizes: dict[str, Any]
    at: tuple[float, ...] = ORIGIN
    turned: tuple[float, ...] = UPRIGHT
    hole: bool = False

    def __repr__(self) -> str:
        """Return the solid with its sizes; for a mesh or many particles, with counts."""
        more = {k: getattr(self, k) for k in ("at", "turned", "hole")}
        words = [
            f"{len(size):,} {key}" if isinstance(size, tuple) and len(size) > 4 else f"{key}={size}"
            for key, size in self.sizes.items()
        ]
        words += [f"{k}={v}" for k, v in more.items() if v != self._field_defaults[k]]
        return f"{self.solid}({', '.join(words)})"

    def placed(self, at: ArrayLike, turned: ArrayLike = UPRIGHT) -> "ShapePart":
        """Return the part after turning its body about the origin, then moving it."""
        if turned is UPRIGHT:  # a tenth of the time: each result writes its scene
            origin = np.array(self.at) + floats(at, "at", 3)
            return self._replace(at=tuple(origin.tolist()))
        origin = rotation.to_space(turned, np.array(self.at)) + floats(at, "at", 3)
        attitude = rotation.product(rotation.quaternion(turned), self.turned)
        return self._replace(at=tuple(origin.tolist()), turned=tuple(attitude.tolist()))

    def as_table(self) -> dict[str, Any]:
        """Return the part as a table of a scene file, without default values."""
        table: dict[str, Any] = {"solid": self.solid}
        table |= {key: _listed(value) for key, value in self.sizes.items()}
        for key in ("at", "turned", "hole"):
            value = getattr(self, key)
            if value != self._field_defaults[key]:
                table[key] = _listed(value)
        return table


Shape = tuple[ShapePart, ...]

# solids that are only drawn: {name: their sizes}
_DRAWN = {
    "particles": ("masses", "positions"),
    "mesh": ("corners", "faces"),
    "mesh_file": ("file", "sha256", "scale"),
}


def sizes_of(solid: str) -> tuple[str, ...]:
    """Return the names of a solid's sizes; SceneError for an unknown solid."""
    if solid in _DRAWN:
        return _DRAWN[solid]
    if solid not in SOLIDS:
        raise unknown("solid", (*SOLIDS, *_DRAWN), at="body.shape.solid", value=solid)
    names = inspect.signature(SOLIDS[solid]).parameters
    return tuple(name for name in names if name not in ("mass", "density"))


def read_shape(tables: Any) -> Shape:
    """Read the shape in the tables [[body.shape]] of a scene file.

    Raises SceneError for an unknown solid or size, and for sizes that are not positive numbers.
    """
    tables = [tables] if isinstance(tables, dict) else tables
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise SceneError("expected tables [[body.shape]]", at="body.shape")
    if len(tables) > MOST_PARTS:
        raise SceneError(f"has more than {MOST_PARTS} parts", at="body.shape")
    return tuple(map(_part_of, tables))


def _part_of(table: dict[str, Any]) -> ShapePart:
    at = "body.shape"
    if not isinstance(table.get("solid"), str):
        rule = 'each part must name its solid, e.g. solid = "cylinder"'
        raise SceneError(rule, at=f"{at}.solid", value=table.get("solid"))
    solid = table["solid"]
    wanted = sizes_of(solid)
    for key in table:
        if key not in ("solid", "at", "turned", "hole", *wanted):
            raise unknown("key", (*wanted, "at", "turned", "hole"), at=at, key=key)
    for key in wanted:
        if key not in table:
            raise SceneError(f"is missing: a {solid} has {', '.join(wanted)}", at=f"{at}.{key}")
    hole = table.get("hole", False)
    if not isinstance(hole, bool):
        raise SceneError("expected true or false", at=f"{at}.hole", value=hole)
    sizes = {key: _size(solid, key, table[key]) for key in wanted}
    if solid == "mesh" and not 0 <= np.min(sizes["faces"]) <= np.max(sizes["faces"]) < len(
        sizes["corners"]
    ):
        raise SceneError("refer to corners that do not exist", at=f"{at}.faces")
    if solid == "particles" and len(sizes["masses"]) != len(sizes["positions"]):
        raise SceneError("expected one position for each mass", at=f"{at}.positions")
    place = _numbers("at", table.get("at", ORIGIN), (3,))
    turned = rotation.quaternion(_numbers("turned", table.get("turned", UPRIGHT), (4,)))
    return ShapePart(solid, sizes, tuple(place.tolist()), tuple(turned.tolist()), hole)


def _size(solid: str, key: str, value: Any) -> Any:
    """Return a checked size as a number or as tuples of numbers."""
    if solid == "mesh_file" and key != "scale":
        # pictures hash no file of another kind, whatever a foreign scene names
        is_valid = isinstance(value, str) and (
            re.fullmatch("[0-9a-f]{64}", value)
            if key == "sha256"
            else value.lower().endswith(MESHES)
        )
        if not is_valid:
            words = "64 hexadecimal digits" if key == "sha256" else "the name of a mesh file"
            raise SceneError(f"expected {words}", at=f"body.shape.{key}", value=value)
        return value
    if solid in ("particles", "mesh"):
        columns = () if key == "masses" else (3,)
        array = _numbers(key, value, (np.shape(value)[:1] or (1,)) + columns)
        if key == "faces" and not (array == np.floor(array)).all():
            raise SceneError("expected indices of corners", at=f"body.shape.{key}")
        return as_tuples(array.astype(int) if key == "faces" else array)
    count = COMPONENTS.get((solid, key))
    array = _numbers(key, value, () if count is None else (count,))
    if not (array > 0.0).all():
        raise SceneError("must be positive", at=f"body.shape.{key}", value=value)
    return as_tuples(array)


def _numbers(key: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return an array of finite numbers with the given shape; SceneError."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.shape != shape or not np.isfinite(array).all():
        words = f"finite numbers, {' x '.join(map(str, shape))}" if shape else "a finite number"
        raise SceneError(
            f"expected {words}", at=f"body.shape.{key}", value=value if array.size < 20 else None
        )
    return array


def shape_of_mesh(triangles: Array) -> ShapePart:
    """Return the part for a closed mesh, triangles (n, 3, 3) [m], with at most MOST_CORNERS
    corners.

    Corners in the same cell of a lattice are merged at their mean; numbers keep five digits.
    """
    corners = triangles.reshape(-1, 3)
    low, size = corners.min(0), np.ptp(corners, axis=0).max()
    cells = 256
    while True:
        lattice = np.round((corners - low) / size * cells).astype(np.int64)
        _, index = np.unique(lattice, axis=0, return_inverse=True)
        index = index.ravel()
        count = int(index.max()) + 1
        if count <= MOST_CORNERS:
            break
        cells = cells * 3 // 4
    weight = np.bincount(index, minlength=count)
    means = np.stack([np.bincount(index, x, count) / weight for x in corners.T], -1)
    digits = 5 - int(np.ceil(np.log10(size)))
    faces = index.reshape(-1, 3)
    a, b, c = faces.T
    faces = np.unique(faces[(a != b) & (b != c) & (c != a)], axis=0)
    return ShapePart("mesh", {"corners": as_tuples(means.round(digits)), "faces": as_tuples(faces)})


def shape_of_mesh_file(file: str, scale: float) -> ShapePart:
    """Return the part for a mesh file, which names the file and its sha256; pictures read it.

    scale : metres per unit of the file
    """
    return ShapePart("mesh_file", {"file": file, "sha256": sha256_of(file), "scale": float(scale)})


def shape_of_particles(masses: Array, positions: Array) -> Shape:
    """Return the shape of particles with masses (N,) at positions (N, 3); () if too many."""
    if masses.size > MOST_CORNERS:
        return ()
    return (
        ShapePart("particles", {"masses": as_tuples(masses), "positions": as_tuples(positions)}),
    )


def shape_of_region(region: Any) -> Shape:
    """Return the shape of a region of `Body.from_density`, a box or a cylinder; () for others."""
    if region[0] == "box":
        low, high = np.array(region[1:], dtype=float).T
        size, at = as_tuples(high - low), as_tuples(0.5 * (high + low))
        return (ShapePart("box", {"size": size}, at),)
    if region[0] == "cylinder":
        _, radius, (low, high) = region
        sizes = {"radius": float(radius), "height": float(high - low)}
        return (ShapePart("cylinder", sizes, (0.0, 0.0, 0.5 * float(high + low))),)
    return ()


def join_shapes(first: Shape, other: Iterable[ShapePart], hole: bool) -> Shape:
    """Join two shapes, the other already placed; () if one of them is unknown."""
    parts = tuple(part._replace(hole=part.hole != hole) for part in other)
    return (*first, *parts) if first and parts else ()


def _listed(value: Any) -> Any:
    """Convert tuples to lists, for TOML."""
    return [_listed(part) for part in value] if isinstance(value, (list, tuple)) else value

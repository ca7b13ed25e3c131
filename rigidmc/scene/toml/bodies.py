"""Reading of the table [body]: by moments, a tensor, a solid, particles or a file."""

import inspect
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import as_tuples
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.scene.body import Body
from rigidmc.scene.inertia_about import is_about_centre
from rigidmc.scene.quantities import is_shared, vector
from rigidmc.scene.shape import read_shape
from rigidmc.scene.stated import NO_RATE, ORIGIN, Stated
from rigidmc.scene.toml.values import (
    DataSources,
    check_keys,
    check_plain,
    read_measured,
    read_plain,
    read_quantity,
)
from rigidmc.scene.units import BODY, in_si, size_units, vector_in_si
from rigidmc.scene.vector_distributions.bodies import UncertainInertia

# bodies given by plain numbers: {key: (keys of its own table, maker)}
SHAPES: dict[str, tuple[tuple[str, ...], Callable[..., Body]]] = {
    **{
        name: (tuple(inspect.signature(make).parameters), partial(Body.solid, name))
        for name, make in SOLIDS.items()
    },
    "particles": (("masses", "positions"), Body.from_particles),
}
BODIES = ("moments", "tensor", "file", *SHAPES)  # a body has exactly one of these keys
# other keys of a body from a file, the arguments of Body.read
OF_FILE = ("link", "products", "about", "density", "mass", "scale", "solid")


def _one_of(keys: list[str], table: dict[str, Any]) -> SceneError:
    """Return the error of a body that has no key of BODIES, or several."""
    if keys:
        rule = "keep one of these keys; in Python, body.join makes one body of two"
        return SceneError(rule, at=f"body.{', '.join(keys)}")
    drawn = "a shape is only drawn; " if "shape" in table else ""
    return SceneError(f"{drawn}give one of these keys: {', '.join(BODIES)}", at="body.moments")


def read_body(table: dict[str, Any], stored: DataSources) -> Body:
    """Return the body of the table [body]."""
    others = ("about", "mass", "centre", "principal_axes", "axes", "pivot", "shape")
    more_keys = OF_FILE if "file" in table else ()
    check_keys(table, dict.fromkeys((*BODIES, *others, *more_keys)), "body")
    keys = [key for key in BODIES if key in table]
    if len(keys) != 1:
        raise _one_of(keys, table)
    key = keys[0]
    if isinstance(table.get("axes"), list):
        # until 0.1 this key held the principal axes, and scenes with it were in these
        table = {**table, "principal_axes": table["axes"], "axes": "principal"}
    # results until 0.1 with an uncertain tensor have no such key, and are in the principal axes
    is_old = stored.is_recorded and isinstance(table.get("tensor"), dict)
    frame = table.get("axes", "principal" if is_old else "described")
    if key == "file":
        body = replace(_of_file(table, stored), frame=frame)
    elif key in SHAPES:
        body = replace(_shaped(table, key), frame=frame)
    else:
        body = _of_inertia(table, key, frame, stored)
    if "principal_axes" in table:
        axes = check_plain(table["principal_axes"], "body.principal_axes")
        body = replace(body, axes=tuple(map(tuple, axes)))
    if "shape" in table:
        body = replace(body, shape=read_shape(_shape_in_si(table["shape"])))
    if "pivot" not in table:
        return body
    pivot = read_measured(table["pivot"], "body.pivot", lambda inner: inner)
    if key in ("moments", "tensor") and body.stated is None:
        body = replace(body, stated=_stated(body, table, key))
    if pivot == "centre" and table.get("about") == "centre":
        return body  # its inertia is about the fixed point as given
    return body.with_pivot_at_centre() if pivot == "centre" else body.with_pivot(pivot)


def _stated(body: Body, table: dict[str, Any], key: str) -> Stated | str:
    """Return the numbers of a body before its fixed point moves; `body` has its inertia as
    stated."""
    if not is_shared(body.moments, body.mass, body.centre):
        return NO_RATE
    inertia = body.moments
    if key == "tensor":
        inertia = as_tuples(np.array(read_plain(table[key], BODY[key], f"body.{key}"), dtype=float))
    numbers = inertia, body.mass if body.has_mass else None
    if table.get("about") != "centre":
        axes = body.axes if "principal_axes" in table else None
        return Stated(*numbers, body.centre, axes=axes)
    centre = vector_in_si(
        read_measured(table.get("centre", ORIGIN), "body.centre", tuple), "m", "body.centre"
    )
    return Stated(*numbers, vector(centre, "body.centre"), "centre", None, "centre")


def _of_inertia(table: dict[str, Any], key: str, frame: str, stored: DataSources) -> Body:
    """Return a body given by its moments or its tensor."""
    more = {
        k: read_quantity(table[k], f"body.{k}", stored) for k in ("mass", "centre") if k in table
    }
    is_whole = isinstance(table[key], dict) and "value" not in table[key]
    if key == "tensor" and not is_whole:
        inertia = read_plain(table[key], BODY[key], f"body.{key}")
    else:
        inertia = read_quantity(table[key], f"body.{key}", stored)
    about = table.get("about", "pivot")
    if is_about_centre(about) and "principal_axes" in table:
        rule = 'has no principal_axes with about = "centre": give the tensor instead'
        raise SceneError(rule, at=f"body.{key}")
    if is_about_centre(about) and table.get("pivot") == "centre":
        # where the centre of mass was does not matter, and moving there and back costs digits
        centre = vector_in_si(more.pop("centre", (0.0, 0.0, 0.0)), "m", "body.centre")
        vector(centre, "body.centre")
        about = "pivot"
        if isinstance(inertia, UncertainInertia):
            inertia = inertia.check("body.tensor").with_exact_centre()
    if key == "moments":
        return replace(Body.from_moments(inertia, **more, about=about), frame=frame)
    return Body.from_tensor(inertia, **more, about=about, axes=frame)


def _of_file(table: dict[str, Any], stored: DataSources) -> Body:
    """Return the body of a file, in the folder of the scene unless its path is absolute."""
    for extra in ("centre", "principal_axes", "shape"):
        if extra in table:
            rule = "the file of the body defines this"
            raise SceneError(rule, at=f"body.{extra}", value=table[extra])
    if not isinstance(table["file"], str):
        rule = 'expected the name of a file, such as "arm.urdf"'
        raise SceneError(rule, at="body.file", value=table["file"])
    path = os.path.join(stored.folder or "", table["file"])
    options = {key: table[key] for key in OF_FILE if key in table}
    try:
        return Body.read(path, **options)
    except FileNotFoundError:
        where = os.path.abspath(stored.folder or os.curdir)
        rule = f"no such file in {where}"
        raise SceneError(rule, at="body.file", value=table["file"]) from None


def _shape_in_si(tables: Any) -> Any:
    """Return the tables [[body.shape]] with the sizes and places that have a unit in SI."""
    if isinstance(tables, list):
        return [_shape_in_si(table) for table in tables]
    if not isinstance(tables, dict):
        return tables
    plain = ("solid", "turned", "hole", "faces", "file", "sha256")
    return {
        key: value
        if key in plain
        else in_si(
            read_measured(value, at := f"body.shape.{key}", lambda inner: inner),
            size_units(key),
            at,
        )
        for key, value in tables.items()
    }


def _shaped(table: dict[str, Any], key: str) -> Body:
    """Return a solid, or a body of particles, from its own table within [body]."""
    keys, make = SHAPES[key]
    for extra in ("mass", "centre", "about"):
        if extra in table:
            rule = f"the table of a {key} defines its mass and centre: {', '.join(keys)}"
            raise SceneError(rule, at=f"body.{extra}", value=table[extra])
    check_keys(table[key], keys, f"body.{key}", required=keys)
    numbers = {k: read_plain(table[key][k], size_units(k), f"body.{key}.{k}") for k in keys}
    return make(**numbers)

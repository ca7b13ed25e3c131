"""A body in lines of text: mass, centre, tensor, principal axes, and which rotations are stable."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError
from rigidmc.files.meshes import MESHES
from rigidmc.mechanics import inertia
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import is_shared

SAME = 1e-12  # relative difference below which moments count as equal


def body_of(
    source: str, density: float | None = None, mass: float | None = None, scale: float = 1.0
) -> tuple[Body, str]:
    """(Body, title) of a mesh file, a scene file or a shipped scene.

    A mesh without density and mass has density 1.
    """
    if source.lower().endswith(MESHES):
        density = 1.0 if density is None and mass is None else density
        return Body.from_mesh(source, density, mass, scale), source
    from rigidmc.scene.scene import Scene

    if density is not None or mass is not None or scale != 1.0:
        rule = "are for meshes; a scene has its mass in its [body]"
        raise OptionError("", "--density, --mass, --scale", None, rule)
    scene = Scene.load(source)
    if not is_shared(*scene.body.quantities()):
        rule = "the body differs from member to member; give plain numbers to see one"
        raise SceneError("body", "moments", None, f"{rule}, e.g. in a copy of the scene")
    return scene.body, scene.title


def facts(body: Body) -> dict[str, Any]:
    """The facts of a body of plain numbers, as lists and numbers (SI)."""
    moments = np.array(body.moments)
    order = np.argsort(moments, kind="stable")
    about_centre = inertia.about_centre(body.tensor, body.mass, body.centre)
    return {
        "mass": float(body.mass),
        "centre": list(body.centre),
        "tensor": body.tensor.tolist(),
        "moments": moments.tolist(),
        "axes": np.array(body.axes).tolist(),
        "tensor_about_centre": about_centre.tolist(),
        "order": (order + 1).tolist(),
        "growth_per_turn_rate": float(inertia.growth_rate(moments)),
        "shape": shape_of(moments),
        "exists": not bool(inertia.too_far(moments, body.mass, body.to_principal(body.centre))),
    }


def shape_of(moments: NDArray[np.float64]) -> str:
    """Spherical, symmetric (oblate or prolate) or asymmetric, and flat if I3 = I1 + I2."""
    low, middle, high = np.sort(moments)
    if high - low <= SAME * high:
        word = "spherical: all moments equal"
    elif middle - low <= SAME * high:
        word = "symmetric, oblate: two equal moments below the third"
    elif high - middle <= SAME * high:
        word = "symmetric, prolate: two equal moments above the third"
    else:
        word = "asymmetric"
    return word + (", flat (I3 = I1 + I2)" if abs(high - low - middle) <= SAME * high else "")


def describe(body: Body, title: str) -> list[str]:
    """Lines of text about a body."""
    known = facts(body)
    moments, axes, centre = (np.array(known[key]) for key in ("moments", "axes", "centre"))
    size = np.sqrt(moments.max() / known["mass"])  # m
    lines = [
        f"{title}: {known['shape']}",
        f"mass         {known['mass']:.12g} kg",
        f"centre       ({_row(centre, size)}) m from the fixed point, in the body's own axes",
        "tensor       about the fixed point, in the body's own axes [kg m2]",
    ]
    largest = np.abs(known["tensor"]).max()
    clean = [[0.0 if abs(x) < 1e-15 * largest else x for x in row] for row in known["tensor"]]
    lines += ["             " + " ".join(f"{x:18.10g}" for x in row) for row in clean]
    lines.append("principal    moment [kg m2]       axis in the body's own axes")
    names = dict(zip(known["order"], ("smallest", "middle", "largest"), strict=True))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        if abs(moments[a] - moments[b]) <= SAME * moments[a]:
            names[a + 1] = names[b + 1] = "equal"
    for k in range(3):
        axis = f"({_row(axes[:, k])})"
        lines.append(f"  axis {k + 1}     {moments[k]:<18.12g}  {axis}   {names[k + 1]}")
    if np.linalg.norm(centre) > SAME * size:
        principal = inertia.survives(axes.T, centre)
        words = ", ".join(str(k + 1) for k in range(3) if principal[k]) or "none"
        lines.append(f"axes that are principal about the centre of mass too: {words}")
    lines += _stability(moments, known)
    if not known["exists"]:
        lines.append(f"note         such a body cannot exist: {inertia.TOO_FAR}")
    return lines


def _stability(moments: NDArray[np.float64], known: dict[str, Any]) -> list[str]:
    """Which rotations are stable without torque, and how fast a disturbance grows."""
    low, middle, high = known["order"]
    growth, shape = known["growth_per_turn_rate"], known["shape"]
    if growth > 1e-6:
        turns = np.log(10.0) / growth / (2.0 * np.pi)
        return [
            f"rotations    without torque: about axes {low} and {high} stable, about axis {middle}"
            f" unstable: a disturbance grows as exp({growth:.6g} omega t),",
            f"             by ten every {turns:.3g} turns",
        ]
    if shape.startswith("spherical"):
        return [
            "rotations    without torque: about any axis steady, and a disturbance does not grow"
        ]
    if shape.startswith("symmetric"):
        oblate = moments[middle - 1] - moments[low - 1] < moments[high - 1] - moments[middle - 1]
        return [
            f"rotations    without torque: about axis {high if oblate else low} stable; about any"
            " axis across it steady, but a disturbance moves on at a constant rate"
        ]
    return [
        f"rotations    without torque: two moments all but equal: the growth about axis {middle},"
        f" {growth:.2g} omega, is slow"
    ]


def _row(values: NDArray[np.float64], size: float = 1.0) -> str:
    """Numbers in words, those that are rounding of their size 0."""
    return ", ".join(f"{0.0 if abs(x) < 1e-15 * size else x:.10g}" for x in values)

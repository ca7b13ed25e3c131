"""What a body is, in lines of text: mass, centre, tensor, principal axes, and which rotations are stable."""

import numpy as np

from rigidmc.errors import OptionError, SceneError
from rigidmc.mechanics import inertia
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import is_shared

SAME = 1e-12  # relative difference under which moments count as equal
MESHES = (".stl", ".obj", ".ply", ".off")


def body_of(source, density=None, mass=None, scale=1.0):
    """(Body, title) of a mesh file, of a scene file or of a shipped scene. A mesh without density and mass has density 1."""
    if source.lower().endswith(MESHES):
        return Body.from_mesh(
            source, 1.0 if density is None and mass is None else density, mass, scale
        ), source
    from rigidmc.scene.file import load

    if density is not None or mass is not None or scale != 1.0:
        raise OptionError(
            "",
            "--density, --mass, --scale",
            None,
            "are for meshes; a scene has its mass in its [body]",
        )
    scene = load(source)
    if not is_shared(*scene.body.quantities()):
        raise SceneError(
            "body",
            "moments",
            None,
            "the body differs from member to member; give plain numbers to see one, e.g. a copy of the scene",
        )
    return scene.body, scene.title


def facts(body):
    """The facts of a body of plain numbers, as plain lists and numbers (SI)."""
    moments = np.array(body.moments)
    order = np.argsort(moments, kind="stable")
    return {
        "mass": float(body.mass),
        "centre": list(body.centre),
        "tensor": body.tensor.tolist(),
        "moments": moments.tolist(),
        "axes": np.array(body.axes).tolist(),
        "tensor_about_centre": inertia.about_centre(body.tensor, body.mass, body.centre).tolist(),
        "order": (order + 1).tolist(),
        "growth_per_turn_rate": float(inertia.growth_rate(moments)),
        "shape": shape_of(moments),
    }


def shape_of(moments):
    """ "spherical", "oblate", "prolate" or "asymmetric" in words, and "flat" where the largest moment is the sum of the others."""
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


def describe(body, title):
    """Lines of text about a body."""
    f = facts(body)
    moments, axes, centre = np.array(f["moments"]), np.array(f["axes"]), np.array(f["centre"])
    lines = [
        f"{title}: {f['shape']}",
        f"mass         {f['mass']:.12g} kg",
        f"centre       ({_row(centre)}) m from the fixed point, in the body's own axes",
        "tensor       about the fixed point, in the body's own axes [kg m2]",
    ]
    size = np.abs(f["tensor"]).max()
    clean = [[0.0 if abs(x) < 1e-15 * size else x for x in row] for row in f["tensor"]]
    lines += ["             " + " ".join(f"{x:18.10g}" for x in row) for row in clean]
    lines.append("principal    moment [kg m2]       axis in the body's own axes")
    names = dict(zip(f["order"], ("smallest", "middle", "largest"), strict=True))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        if abs(moments[a] - moments[b]) <= SAME * moments[a]:
            names[a + 1] = names[b + 1] = "equal"
    for k in range(3):
        lines.append(
            f"  axis {k + 1}     {moments[k]:<18.12g}  ({_row(axes[:, k])})   {names[k + 1]}"
        )
    if np.linalg.norm(centre) > SAME * np.sqrt(moments.max() / f["mass"]):
        stays = inertia.survives(axes.T, centre)
        kept = ", ".join(str(k + 1) for k in range(3) if stays[k]) or "none"
        lines.append(f"axes that are principal about the centre of mass too: {kept}")
    return lines + _stability(moments, f)


def _stability(moments, f):
    low, middle, high = f["order"]
    growth = f["growth_per_turn_rate"]
    if growth > 1e-6:
        return [
            f"rotations    about axes {low} and {high} stable, about axis {middle} unstable: a disturbance grows as exp({growth:.6g} omega t),",
            f"             by ten every {np.log(10.0) / growth / (2.0 * np.pi):.3g} turns",
        ]
    if f["shape"].startswith("spherical"):
        return ["rotations    about any axis: steady, and a disturbance does not grow"]
    if f["shape"].startswith("symmetric"):
        own = (
            high
            if moments[middle - 1] - moments[low - 1] < moments[high - 1] - moments[middle - 1]
            else low
        )
        return [
            f"rotations    about axis {own} stable; about any axis across it steady, but a disturbance moves on at a constant rate"
        ]
    return [
        f"rotations    two moments all but equal: the growth about axis {middle}, {growth:.2g} omega, is slow"
    ]


def _row(values):
    return ", ".join(f"{0.0 if abs(x) < 1e-15 else x:.10g}" for x in values)

"""A derivative is by the number that the scene states, for every way to describe a body.

Each parameter of a body that `wrt` accepts, against differences of scenes in which that number of
the text is another: mass and centre also move the inertia where the scene states this about
another point. Maps, `--along` and `--set` make the same body, bit for bit.
"""

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.planning.initial import block_rows, initial_block
from rigidmc.planning.unit_scale import scale_scene
from rigidmc.scene.derivatives import parameter_names_of_derivatives, seeds_of
from rigidmc.scene.parameters import parameter_names, with_parameters
from rigidmc.views.live.sliders import make_sliders
from tests.planning.test_tangents import by_differences, rows_of, tangents

# what files leave open is assumed with a note, and gravity does not turn a body about its centre
pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
MOMENTS = [2.0, 3.0, 4.0]
TENSOR = [[2.0, 0.2, -0.1], [0.2, 3.0, 0.3], [-0.1, 0.3, 4.0]]
MASS = {"mass": 1.5, "centre": [0.11, -0.21, 0.34]}
TURNED = Rotation.from_euler("xyz", (0.2, 0.1, -0.3)).as_matrix().tolist()
POINT = [0.05, 0.12, -0.2]
MOVES = {
    "at the origin": {},
    "about the centre": {"about": "centre"},
    "about another point": {"pivot": POINT},
    "moved to the centre": {"pivot": "centre"},
    "about the centre, another point": {"about": "centre", "pivot": POINT},
    "free": {"about": "centre", "pivot": "centre"},
}
SOLIDS = {
    "box": {"mass": 2.0, "size": [0.3, 0.5, 0.7]},
    "ball": {"mass": 2.0, "radius": 0.3},
    "shell": {"mass": 2.0, "radius": 0.3},
    "cylinder": {"mass": 2.0, "radius": 0.3, "height": 0.9},
    "hollow_cylinder": {"mass": 2.0, "inner": 0.3, "outer": 0.5, "height": 0.8},
    "cone": {"mass": 2.0, "radius": 0.3, "height": 0.9},
    "ellipsoid": {"mass": 2.0, "semiaxes": [0.3, 0.5, 0.6]},
    "rod": {"mass": 2.0, "length": 0.9, "radius": 0.1},
    "plate": {"mass": 2.0, "size": [0.3, 0.5]},
    "disc": {"mass": 2.0, "radius": 0.3},
    "ring": {"mass": 2.0, "radius": 0.3},
    "t_handle": {"density": 8e3, "radius": 0.01, "bar": 0.1, "stem": 0.06},
}
PARTICLES = {
    "masses": [1.0, 2.0, 1.5, 0.5],
    "positions": [[0.3, 0.0, 0.1], [0.0, 0.4, -0.1], [-0.2, 0.1, 0.5], [0.1, -0.3, 0.2]],
}
URDF = """<robot name="r"><link name="arm"><inertial><origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/>
<mass value="1.5"/><inertia ixx="2" iyy="3" izz="4" ixy="0.2" ixz="-0.1" iyz="0.3"/></inertial>
</link></robot>"""
MJCF = """<mujoco><worldbody><body name="arm"><inertial pos="0.1 0.2 0.3" mass="1.5"
fullinertia="2 3 4 0.2 -0.1 0.3"/></body></worldbody></mujoco>"""
CAD = """Mass = 1.5 kilograms
Center of mass: ( meters )
\tX = 0.1
\tY = 0.2
\tZ = 0.3
Moments of inertia: ( kilograms * square meters )
Taken at the center of mass and aligned with the output coordinate system.
Lxx = 2.0\tLxy = -0.2\tLxz = 0.1
Lyx = -0.2\tLyy = 3.0\tLyz = -0.3
Lzx = 0.1\tLzy = -0.3\tLzz = 4.0
"""
CORNERS = np.array([(0, 0, 0), (1.0, 0, 0), (0, 0.8, 0), (0, 0, 0.6)])
STL = "solid a\n" + "".join(
    "facet normal 0 0 0\nouter loop\n"
    + "".join("vertex {} {} {}\n".format(*CORNERS[i]) for i in face)
    + "endloop\nendfacet\n"
    for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
) + "endsolid a\n"  # fmt: skip
FILES = {"arm.urdf": URDF, "arm.xml": MJCF, "arm.txt": CAD, "part.stl": STL}


def tables():
    """{what a body is: its table [body]}."""
    found = {}
    for (word, inertia), (how, move) in itertools.product(
        (("moments", {"moments": MOMENTS}), ("tensor", {"tensor": TENSOR})), MOVES.items()
    ):
        found[f"{word} {how}"] = inertia | MASS | move
        if word == "tensor":
            found[f"tensor {how}, principal"] = inertia | MASS | move | {"axes": "principal"}
        elif "about" not in move:
            found[f"turned moments {how}"] = inertia | MASS | move | {"principal_axes": TURNED}
    found["on its axis"] = {"moments": MOMENTS, "mass": 1.5, "centre": [0.0, 0.0, 0.6]}
    found["on its axis, about the centre"] = found["on its axis"] | {"about": "centre"}
    for name, sizes in SOLIDS.items():
        found[name] = {name: sizes}
        # equal moments off the axes of the table leave their axes to rounding
        point = [0.0, 0.0, -0.2] if name in ("ball", "shell") else POINT
        found[f"{name} about another point"] = {name: sizes, "pivot": point}
    found["cone, free"] = {"cone": SOLIDS["cone"], "pivot": "centre"}
    found["particles"] = {"particles": PARTICLES}
    found["particles about another point"] = {"particles": PARTICLES, "pivot": POINT}
    for file in FILES:
        options = {".stl": {"mass": 1.5, "scale": 1.0}, ".txt": {"products": "negative"}}
        found[file] = {"file": file} | options.get(file[-4:], {})
        found[f"{file} about another point"] = found[file] | {"pivot": POINT}
    found["mesh by density"] = {"file": "part.stl", "density": 900.0, "scale": 1.0}
    return found


BODIES = tables()
SMALL = (
    "moments about the centre", "tensor moved to the centre", "turned moments about another point",
    "tensor free, principal", "cone about another point", "cone, free", "part.stl", "cylinder",
    "ellipsoid", "plate", "ball", "hollow_cylinder",
)  # fmt: skip
# largest relative difference between the derivatives and differences of order 6: measured 7e-11
TOLERANCE = 1e-9


def load(tmp_path, table):
    """The heavy body of a table."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    start = {"omega": [1.0, 2.0, 3.0], "attitude": [0.1, 0.2, 0.3]}
    scene = {"body": table, "effects": {"gravity": {"g": 9.81}}, "start": start}
    path = tmp_path / "scene.toml"
    path.write_text(tomli_w.dumps(scene))
    return rm.Scene.load(path)


def stated_table(tmp_path, table):
    """The table that states moments, mass and centre: that of the text of a derived body."""
    if {"moments", "tensor", *SOLIDS} & table.keys():
        return table
    scene = load(tmp_path, table)
    body = scene.body
    found = {"tensor": body.tensor.tolist(), "mass": body.mass, "centre": list(body.centre)}
    return found if body.is_turned else {**found, "moments": list(body.moments)}


def changed(table, name, by):
    """The table with the named number larger by a relative amount."""
    table = copy.deepcopy(table)
    _, *path = name.split(".")
    if path[0] == "tensor" and "tensor" not in table:
        axes = np.array(table.pop("principal_axes", np.eye(3)))
        table["tensor"] = ((axes * np.array(table.pop("moments"))) @ axes.T).tolist()
    elif path[0] == "moments" and "tensor" in table:
        return of_moments(table, int(path[1]) - 1, by)
    whole = table
    for word in path[:-1]:
        whole = whole[int(word) - 1 if word.isdecimal() else word]
    key = int(path[-1]) - 1 if path[-1].isdecimal() else path[-1]
    whole[key] += by
    if path[0] == "tensor" and path[1] != path[2]:
        table["tensor"][key][int(path[1]) - 1] = whole[key]
    if table.get("tensor") is not None:
        table.pop("moments", None)
    return table


def of_moments(table, i, by):
    """A table with a tensor, whose principal moment i is larger."""
    body = rm.Body.from_tensor(np.array(table["tensor"]))
    axes = np.array(body.axes)
    grown = np.array(table["tensor"]) + by * np.outer(axes[:, i], axes[:, i])
    return {key: value for key, value in table.items() if key != "moments"} | {
        "tensor": (0.5 * (grown + grown.T)).tolist()
    }


@pytest.mark.parametrize(
    "name", [n if n in SMALL else pytest.param(n, marks=pytest.mark.slow) for n in sorted(BODIES)]
)
def test_derivatives_are_by_stated_numbers(name, tmp_path):
    """Of each parameter of a body."""
    table = BODIES[name]
    scene, given = load(tmp_path, table), stated_table(tmp_path, table)
    names = [n for n in parameter_names_of_derivatives(scene.model) if n.startswith("body.")]
    assert names
    for parameter, tangent in zip(names, tangents(scene, names, 1), strict=True):
        number = given
        for word in parameter.split(".")[1:]:
            number = number.get(word, 1.0) if isinstance(number, dict) else number
        h = 1e-3 * (abs(number) if isinstance(number, float) and number else 0.3)

        def rows(by, parameter=parameter):
            return rows_of(load(tmp_path, changed(given, parameter, by)), 1)

        true = by_differences(rows, h)
        off = np.abs(tangent - true).max() / max(np.abs(true).max(), 1e-3)
        assert off < TOLERANCE, (parameter, off)


def same_body(one, other):
    """Whether two bodies have the same bits."""
    parts = ("moments", "mass", "centre", "axes", "frame")
    return all(getattr(one, part) == getattr(other, part) for part in parts)


NUMBERS = ("body.moments.2", "body.mass", "body.centre.3")


@pytest.mark.parametrize("name", [one for one in BODIES if one.startswith(("moments", "tensor"))])
def test_a_map_makes_the_body_of_the_scene_with_this_number(name, tmp_path):
    table = BODIES[name]
    scene = load(tmp_path, table)
    for number in parameter_names(scene.model):
        if number not in NUMBERS or ("moments" in number and "tensor" in table):
            continue
        other = copy.deepcopy(table)
        key, *place = number.split(".")[1:]
        value = 1.01 * (other[key][int(place[0]) - 1] if place else other[key])
        if place:
            other[key][int(place[0]) - 1] = value
        else:
            other[key] = value
        assert same_body(
            with_parameters(scene.model, {number: value}).body, load(tmp_path, other).body
        ), number


@pytest.mark.parametrize("name", SMALL)
def test_a_text_states_the_same_numbers(name, tmp_path):
    scene = load(tmp_path, BODIES[name])
    again = rm.Scene.loads(scene.dumps(), str(tmp_path / "again.toml"))
    assert same_body(again.body, scene.body)
    assert again.body.stated == (None if name == "part.stl" else scene.body.stated)
    larger = scale_scene(scene, 2.0, 4.0)
    if not isinstance(scene.body.stated, str | None):
        assert larger.body.stated is not None
        assert scale_scene(larger, 0.5, 0.25).body.stated == scene.body.stated


def test_a_changed_body_states_other_numbers():
    body = rm.Body.from_moments(MOMENTS, 1.5, (0.1, 0.0, 0.6), about="centre")
    assert body.stated is not None and replace(body, mass=2.0).stated is None
    assert body.with_pivot(POINT).stated.pivot == tuple(POINT)
    assert body.with_pivot(POINT).with_pivot(POINT).stated is None
    free = rm.Body.from_tensor(TENSOR, 1.5, (0.1, 0.0, 0.6), about="centre").with_pivot_at_centre()
    assert free.stated.is_free
    assert free.tensor.tolist() == rm.Body.from_tensor(TENSOR).tensor.tolist()


@pytest.mark.parametrize(
    ("table", "name", "words"),
    [
        (BODIES["part.stl"], "body.mass", "in proportion to the moments of the mesh"),
        (BODIES["mesh by density"], "body.density", "in proportion to the moments of the mesh"),
        (BODIES["tensor free"], "body.moments.1", "states a tensor: name its elements"),
        (BODIES["cone, free"], "body.cone.height", "moves the centre of mass, at which"),
        (BODIES["on its axis, about the centre"], "body.centre.1", "turns the principal axes"),
    ],
)
def test_a_number_without_a_derivative_is_refused_with_the_reason(table, name, words, tmp_path):
    with pytest.raises(SceneError, match=words):
        seeds_of(load(tmp_path, table).model, [name])


def test_members_do_not_differ_by_a_number_that_moves_the_inertia(tmp_path):
    scene = load(tmp_path, BODIES["moments about the centre"])
    for value in (rm.uniform(1.0, 2.0), np.array([1.0, 2.0])):
        with pytest.raises(
            SceneError, match=r"body\.mass.*enters the inertia about the fixed point"
        ):
            with_parameters(scene.model, {"body.mass": value})
    with pytest.raises(rm.RigidmcError, match="enters the inertia"):
        rm.stability_map(scene, ("body.mass", 1.0, 2.0), ("start.omega.1", 1.0, 2.0), of="tilt")
    scene = load(tmp_path, BODIES["on its axis, about the centre"])
    _, start = initial_block(scene.model, 7, 0, 1, True, block_rows(scene.effects, False))
    with pytest.raises(rm.RigidmcError, match="it also moves the inertia"):
        make_sliders(scene.model, start, {"body.mass": None})
    sliders = make_sliders(scene.model, start, None)
    assert all(not slider.name.startswith("body.") for slider in sliders)

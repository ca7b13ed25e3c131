"""The parameters of a model by name, such as body.moments.1, start.omega.angle or
effects.gravity.g: one catalogue of names, units and derivatives, and models with other numbers."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.mechanics.euler_angles import ANGLES, angle_names
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.physics.effects import EFFECTS, label_effects, name_of
from rigidmc.physics.effects.protocol import facts, shape, user_parameters
from rigidmc.scene.body import Body
from rigidmc.scene.body_parameters import body_parameters, solid_of
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import (
    Parameter,
    Parameters,
    Path,
    Seed,
    by_name,
    of_field,
    of_quantities,
    of_quantity,
    of_vector,
    one_seed,
    refused,
)
from rigidmc.scene.quantities import Drawn, Grid, Rate, Varied, draw, is_shared, quantity
from rigidmc.scene.scene import Scene
from rigidmc.scene.stated import NO_RATE, Stated, refused_numbers
from rigidmc.scene.units import START
from rigidmc.scene.vector_distributions.attitudes import Fisher, Pointing
from rigidmc.scene.vector_distributions.protocol import EquilibriumEnsemble, VectorDistribution

END = "run.t_end"  # enters no member at its start, see `rigidmc.runs.blocks`


def parameters_of(model: Model) -> Parameters:
    """Return all parameters of a model by name."""
    which = model.start.spin_name
    spin, parameters = getattr(model.start, which), body_parameters(model.body)
    parameters |= by_name(of_vector(f"start.{which}", ("start", which), spin, START[which]))
    if isinstance(spin, EquilibriumEnsemble) and model.body.is_turned:
        parameters |= refused(parameters, (f"start.{which}.{i}" for i in (1, 2, 3)), _TURNED)
    has_angles = model.start.has_euler_angles
    attitude = by_name(_of_attitude(model)).items()
    parameters |= {k: p._replace(is_settable=p.is_settable and has_angles) for k, p in attitude}
    for i, (label, effect) in enumerate(label_effects(model.effects)):
        for field in user_parameters(effect):
            unit, path = facts(effect).units.get(field, "1"), ("effects", i, field)
            of_one = of_quantity if shape(effect, field) is None else of_vector
            value = getattr(effect, field)
            parameters |= by_name(of_one(f"effects.{label}.{field}", path, value, unit))
    parameters |= refused(parameters, *_refused_by_rejection(model, parameters))
    return parameters | {END: Parameter(END, "s", list)}


def parameter_names(model: Model) -> list[str]:
    """Return the names of all parameters of a model that may differ between members."""
    return [name for name, p in parameters_of(model).items() if p.is_settable]


def unit_at(model: Model, name: str) -> str:
    """Return the SI units of a parameter or a vector; "1" for a name that is neither."""
    return units_at(model, (name,))[0]


def units_at(model: Model, names: Iterable[str]) -> tuple[str, ...]:
    """Return `unit_at` for each name."""
    if not (names := tuple(names)):
        return ()  # to list all parameters takes .2 of the 2.5 ms of a run of few members
    units: dict[str, str] = {}
    for word, p in parameters_of(model).items():
        units[word] = units[vector_of(word)] = p.unit
    return tuple(units.get(name, "1") for name in names)


def vector_of(name: str) -> str:
    """Return the name of the vector that contains a component; "" for a scalar."""
    vector, _, last = name.rpartition(".")
    return vector if last.isdecimal() or (vector == "start.attitude" and last in ANGLES) else ""


def path_of(model: Model, name: str) -> Path:
    """Return where a model has a parameter or a vector that may differ between members."""
    table, *words = name.split(".")
    path: list[str | int] = [int(word) - 1 if word.isdecimal() else word for word in words]
    if table == "effects":
        path[0] = [label for label, _ in label_effects(model.effects)].index(words[0])
    elif table == "start" and words[-1] in (angles := angle_names(model.start.sequence)):
        path[-1] = angles.index(words[-1])
    elif words[0] in SOLIDS:
        path = path[1:]  # the mass of a solid is that of its body
    return table, *path


def value_at(model: Model, name: str) -> Any:
    """Return the value of a parameter or a vector."""
    value: Any = model
    for key in path_of(model, name):
        value = value[key] if isinstance(key, int) else getattr(value, key)
    return value


_TURNED = "is drawn in the principal axes of each member, not in the axes of the scene"
_POLE = "is a direction along z, where the azimuth of the direction jumps"
_TABLE = "is a parameter of a distribution whose quantiles are read from a table"


def _of_attitude(model: Model) -> Iterator[Parameter]:
    """Yield the parameters of the attitude at the start: its angles, the four components of its
    quaternion, which is normalised, or the rotations of an attitude that is drawn as a whole."""
    name, path, value = "start.attitude", ("start", "attitude"), model.start.attitude
    if model.start.has_euler_angles:
        for i, angle in enumerate(angle_names(model.start.sequence)):
            yield from of_quantity(f"{name}.{angle}", (*path, i), value[i], START["attitude"])
    elif isinstance(value, tuple) and any(isinstance(x, Distribution) for x in value):
        yield from of_quantities(name, path, value, "1")
    elif isinstance(value, tuple):
        for k in range(4):
            yield Parameter(f"{name}.{k + 1}", "1", partial(_of_component, value, k))
    else:
        is_turned = value == "ensemble" and model.body.is_turned
        for i in range(3):  # rotations about the body axes
            seeds = one_seed(("start", "sample_attitude"), _own_rotation(i))
            yield Parameter(f"{name}.{i + 1}", "rad", _TURNED if is_turned else seeds)
    if isinstance(value, Fisher):
        yield from (Parameter(f"{name}.{field}", "1", _TABLE) for field in value.names())
    elif isinstance(value, VectorDistribution):
        for field, part in value.as_dict().items():
            at_pole = isinstance(value, Pointing) and not any(value.direction[:2])
            rule = _POLE if at_pole and field == "direction" else None
            for p in of_field(f"{name}.{field}", (*path, field), part, "1"):
                yield p._replace(seeds=rule or p.seeds)


def _own_rotation(i: int) -> Rate:
    """Return the derivatives q (0, e_i)/2 of attitudes (4, n) by a rotation about body axis i."""
    half = tuple(0.5 * float(i == k) for k in range(3))
    return lambda drawn: np.stack(multiply(tuple(drawn.values), (0.0, *half)))


def _of_component(value: Any, k: int) -> list[Seed]:
    """Return the Seeds of component k of a quaternion p: its change orthogonal to p.

    The rest changes only the norm. Normalising would remove it, but p may already be normalised,
    and is then used as it is.
    """

    def rate_of(i: int) -> Rate:
        def rate(drawn: Drawn) -> Any:
            p = draw(value, 0, "", drawn.first, drawn.values.size)
            return float(i == k) - p[i] * p[k] / (p * p).sum(0)

        return rate

    return [Seed(("start", "attitude", i), rate_of(i)) for i in range(4)]


def _refused_by_rejection(model: Model, parameters: Parameters) -> tuple[list[str], str]:
    """Return the parameters on which the attitudes of an ensemble depend, and the reason why they
    have no derivative."""
    rule = (
        'changes which attitudes are accepted: attitude = "ensemble" is drawn by rejection, which'
        " jumps from one attitude to another"
    )
    acting = [pair for pair in label_effects(model.effects) if implements(pair[1], "energy")]
    if model.start.attitude != "ensemble" or not acting:
        return [], rule
    parts = ("body.", *(f"effects.{label}." for label, _ in acting))
    parts += tuple(f"start.momentum.{field}" for field in model.start.momentum.names())
    # the energies of the effects shipped depend on the body by its mass and centre alone
    shipped = all(name_of(effect) in EFFECTS for _, effect in acting)
    free = ("body.moments.",) if shipped else ()
    return [k for k in parameters if k.startswith(parts) and not k.startswith(free)], rule


def with_parameter(scene: Scene, name: str, value: Any, key: str = "parameter") -> Scene:
    """Replace a parameter of a scene by a number, distribution or grid; SceneError with the nearest
    name.

    key : name of the argument in the error
    """
    return scene.with_model(with_parameters(scene.model, {name: value}, key))


def with_parameters(
    model: Model,
    values: Mapping[str, Any],
    key: str = "parameter",
    names: Sequence[str] | None = None,
) -> Model:
    """Replace several parameters of a model, as `with_parameter` does.

    Each part is replaced once, because a part checks all its numbers when it is made.

    names : known parameters, by default `parameter_names`
    """
    names = parameter_names(model) if names is None else names
    body, effects = model.body, list(model.effects)
    changed: dict[str, dict[str, Any]] = {"body": {}, "start": {}}
    stated = body.stated if isinstance(body.stated, Stated) else None
    for name, value in values.items():
        if why := refused_numbers(body.stated).get(name):
            raise SceneError(f"cannot differ between members: it {why}", at=key, value=name)
        is_of_body = name.startswith("body.")
        if is_of_body and stated is None and (solid := solid_by_mass(body)):
            body = _of_mass(body, solid, name, value, key)
            continue
        if name not in names:
            raise unknown("scene parameter", names, at=key, value=name)
        table, first, *rest = path_of(model, name)
        if is_of_body and stated is not None:
            if not is_shared(value if type(value) is tuple else quantity(value, name)):
                raise SceneError(f"cannot differ between members: it {NO_RATE}", at=key, value=name)
            stated = _put(stated, ["inertia" if first == stated.key else first, *rest], value)
        elif table == "effects":
            effects[int(first)] = _put(effects[int(first)], rest, value)
        else:
            fields = changed[str(table)]
            old = fields.get(str(first), getattr(getattr(model, str(table)), str(first)))
            fields[str(first)] = _put(old, rest, value)
    if stated is not None and stated is not body.stated:
        body = stated.make(type(body), body.frame)
    if changed["body"]:
        body = replace(body, **changed["body"], shape=())  # the shape belongs to the original body
    start = replace(model.start, **changed["start"]) if changed["start"] else model.start
    return Model(body, tuple(effects), start)


def solid_by_mass(body: Body) -> str | None:
    """Return the name of the solid if a body is a solid given by mass, with any pivot; else None.

    A shape next to explicit moments is only drawn and does not make the body a solid.
    """
    solid = solid_of(body)
    return solid.part.solid if solid is not None and solid.is_by_mass else None


def refuse_part_of_solid(solid: str, name: str, key: str) -> SceneError:
    """Return the error for a parameter of a solid other than its mass."""
    right = f"body.{solid}.mass"
    rule = (
        f"the sizes of a {solid} determine its centre and moments: only {right} can be varied,"
        " and the moments with it; to vary others, give moments, mass and centre in place of"
        f" the {solid}"
    )
    return SceneError(rule, at=key, value=name, nearest=right)


def _of_mass(body: Any, solid: str, name: str, value: Any, key: str) -> Any:
    """Return the solid with another mass and moments in proportion; SceneError for every other
    parameter of a solid.

    value : a number, a grid, a nominal number, or the masses of members
    """
    if name != f"body.{solid}.mass":
        raise refuse_part_of_solid(solid, name, key)
    # of 1 kg, not of the present mass: a rerun, which has other ones, then rounds alike
    part = body.shape[0]
    made = Body.solid(part.solid, mass=1.0, **part.sizes)
    made = made.with_pivot(tuple(-x for x in part.at)) if any(part.at) else made
    each = map(float, made.moments)
    moments = tuple(
        value.times(x) if isinstance(value, (Grid, Varied)) else value * x for x in each
    )
    return replace(body, moments=moments, mass=value)


def _put(part: Any, path: Sequence[str | int], value: Any) -> Any:
    """Return an effect, a distribution or a tuple with one value replaced."""
    if not path:
        return value
    key, *rest = path
    if isinstance(key, int):
        return (*part[:key], _put(part[key], rest, value), *part[key + 1 :])
    change = {key: _put(getattr(part, key), rest, value)}
    if isinstance(part, VectorDistribution):
        return replace(part, **change)
    return part._replace(**change)  # an effect

"""The parameters of a model by name, such as body.moments.1, start.omega.angle or
effects.gravity.g: one catalogue of records, and models with other numbers."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.physics.effects import EFFECTS, label_effects, name_of
from rigidmc.physics.effects.protocol import facts, shape, user_parameters
from rigidmc.scene.body import Body
from rigidmc.scene.body_parameters import STATED, body_parameters, solid_of
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import (
    Parameter,
    Parameters,
    Seed,
    by_name,
    of_field,
    of_quantities,
    of_quantity,
    of_vector,
    one_seed,
    refused,
)
from rigidmc.scene.quantities import Drawn, Rate, draw, is_shared, quantity
from rigidmc.scene.stated import NO_RATE, refused_numbers
from rigidmc.scene.units import START
from rigidmc.scene.validation import parameter_limits
from rigidmc.scene.vector_distributions.attitudes import Fisher, Pointing
from rigidmc.scene.vector_distributions.protocol import EquilibriumEnsemble, VectorDistribution

END = "run.t_end"  # enters no member at its start, see `rigidmc.runs.blocks`


def parameters_of(model: Model, driven: bool = False) -> Parameters:
    """Return all parameters of a model by name. driven : whether damping may be negative"""
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
            value, limits = getattr(effect, field), parameter_limits(effect, field, driven)
            parameters |= by_name(of_one(f"effects.{label}.{field}", path, value, unit, limits))
    parameters |= refused(parameters, *_refused_by_rejection(model, parameters))
    return parameters | {END: Parameter(END, "s", ("run", "t_end"), list)}


def with_vectors(parameters: Parameters) -> Parameters:
    """Return parameters with the vectors that contain them, a vector before its components."""
    found: Parameters = {}
    for name, p in parameters.items():
        if p.vector:
            found.setdefault(p.vector, p._replace(name=p.vector, path=p.path[:-1]))
        found.setdefault(name, p)
    return found


def settable(parameters: Parameters) -> Parameters:
    """Return the parameters that may differ between members."""
    return {name: p for name, p in parameters.items() if p.is_settable}


def parameter_names(model: Model) -> list[str]:
    """Return the names of all parameters of a model that may differ between members."""
    return list(settable(parameters_of(model)))


def unit_at(model: Model, name: str) -> str:
    """Return the SI units of a parameter or a vector; "1" for a name that is neither."""
    return units_at(model, (name,))[0]


def units_at(model: Model, names: Iterable[str]) -> tuple[str, ...]:
    """Return `unit_at` for each name."""
    if not (names := tuple(names)):
        return ()  # to list all parameters takes .2 of the 2.5 ms of a run of few members
    known = with_vectors(parameters_of(model))
    return tuple(known[name].unit if name in known else "1" for name in names)


def value_at(model: Model, name: str) -> Any:
    """Return the value of a parameter or a vector."""
    return with_vectors(parameters_of(model))[name].get(model)


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
            yield Parameter(f"{name}.{k + 1}", "1", (*path, k), partial(_of_component, value, k))
    else:
        is_turned = value == "ensemble" and model.body.is_turned
        for i in range(3):  # rotations about the body axes
            drawn = one_seed(("start", "sample_attitude"), _own_rotation(i))
            seeds = _TURNED if is_turned else drawn
            yield Parameter(f"{name}.{i + 1}", "rad", (*path, i), seeds)
    if isinstance(value, Fisher):
        for field in value.names():
            yield Parameter(f"{name}.{field}", "1", (*path, field), _TABLE)
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


def with_parameters(
    model: Model,
    values: Mapping[str, Any],
    key: str = "parameter",
    parameters: Parameters | None = None,
) -> Model:
    """Replace parameters of a model by numbers, distributions or grids; SceneError with the nearest
    name. Body and start are checked once, when all their numbers are in place.

    key : name of the argument in the error
    parameters : known parameters, by default all that are settable
    """
    known = settable(parameters_of(model)) if parameters is None else parameters
    changed: Any = model
    solid = solid_by_mass(model.body)
    for name, value in values.items():
        if why := refused_numbers(model.body.stated).get(name):
            raise SceneError(f"cannot differ between members: it {why}", at=key, value=name)
        if name not in known:
            if solid is not None and name.startswith("body."):
                raise refuse_part_of_solid(solid, name, key)
            raise unknown("scene parameter", list(known), at=key, value=name)
        if known[name].path[:2] == STATED and not is_shared(quantity(value, name)):
            raise SceneError(f"cannot differ between members: it {NO_RATE}", at=key, value=name)
        changed = known[name].put(changed, value)
    body, start = changed.body, changed.start
    if body.stated is not model.body.stated:
        body = body.stated.make(type(body), body.frame)
    elif body is not model.body:  # the shape belongs to the original body
        body = replace(body, shape=() if solid is None else body.shape)
    return Model(body, changed.effects, start if start is model.start else replace(start))


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

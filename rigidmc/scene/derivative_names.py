"""The parameters by which a model can be differentiated: their names, and where each enters.

A name is that of a map or of `--set`, such as start.omega.2, effects.gravity.g or body.box.size.1.
If members draw that number, the derivative is by the member's own number; a further word names a
parameter of the distribution, as in start.omega.2.mean (`rigidmc.scene.reparametrise`).
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.dynamics.dual_arrays import DualArray
from rigidmc.physics.dynamics.functions import normal_quantile
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.physics.effects import EFFECTS, label_effects, name_of
from rigidmc.physics.effects.protocol import shape, user_parameters
from rigidmc.scene.body_derivatives import (
    Given,
    Path,
    Seed,
    body_parameters,
    of_quantity,
    one_seed,
    symmetric_parameters,
)
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import Drawn, Rate, draw
from rigidmc.scene.reparametrise import own_number
from rigidmc.scene.scene import Scene
from rigidmc.scene.units import BODY, START, size_units, squared, units_of
from rigidmc.scene.vector_distributions.attitudes import Fisher, Pointing
from rigidmc.scene.vector_distributions.bodies import TensorDistribution
from rigidmc.scene.vector_distributions.protocol import EquilibriumEnsemble, VectorDistribution
from rigidmc.scene.vector_distributions.vectors import Correlated, lower_factor, whole_of

_SYMMETRIC = (".tensor", ".mean", ".covariance")  # names before the indices of symmetric matrices
END = "run.t_end"  # enters no member at its start, see `rigidmc.runs.end_of_run`


def parameter_names_of_derivatives(scene: Scene) -> list[str]:
    """Return the names of all parameters by which a scene has derivatives.

    Examples
    --------
    >>> from rigidmc.scene.derivative_names import parameter_names_of_derivatives
    >>> start = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 0.0))
    >>> names = parameter_names_of_derivatives(rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=start))
    >>> [name for name in names if name.startswith("start.omega.1")]
    ['start.omega.1', 'start.omega.1.mean', 'start.omega.1.standard_deviation']
    """
    return _able(parameters_of(scene.model))


def _able(known: Mapping[str, Given]) -> list[str]:
    """Return the names that have a derivative."""
    return [
        name
        for name, given in known.items()
        if not isinstance(given, str) and not isinstance(given(), str)
    ]


def check_derivative_names(scene: Scene, names: Sequence[str], at: str = "run.wrt") -> None:
    """Raise SceneError for a name that is unknown, given twice, or without a derivative; with the
    nearest name, or the reason."""
    seeds_of(scene.model, names, at)


def seeds_of(model: Model, names: Sequence[str], at: str = "run.wrt") -> list[list[Seed]]:
    """Return the Seeds of each name; SceneError as for `check_derivative_names`."""
    known, found = parameters_of(model), []
    names = [_upper_element(name) for name in names]
    for i, name in enumerate(names):
        if name not in known:
            raise unknown("parameter with a derivative", _able(known), at=at, value=name)
        given = known[name]
        seeds = given if isinstance(given, str) else given()
        if isinstance(seeds, str):
            raise SceneError(f"has no derivative: it {seeds}", at=at, value=name)
        if name in names[:i]:
            raise SceneError("is given twice", at=at, value=name)
        found.append(seeds)
    return found


def _upper_element(name: str) -> str:
    """Return the name of an element of a symmetric matrix with its smaller index first."""
    whole, *pair = name.rsplit(".", 2)
    if not whole.endswith(_SYMMETRIC) or not all(map(str.isdecimal, pair)):
        return name
    return ".".join([whole, *sorted(pair, key=int)])


def derivative_unit(scene: Scene, name: str) -> str:
    """Return the SI units of a parameter by which a scene has derivatives."""
    if name == END:
        return "s"
    table, first, *rest = name.split(".")
    if table == "body" and first in SOLIDS:
        return size_units(rest[0])
    if table == "body" and first == "tensor" and "covariance" in rest:
        i, j = ((1, 2) if k <= 6 else (0, 1) if k <= 9 else (1, 0) for k in map(int, rest[1:]))
        powers = zip(("kg", "m"), (i[0] + j[0], i[1] + j[1]), strict=True)
        return " ".join(word + (str(n) if n > 1 else "") for word, n in powers if n)
    if table == "body" and first == "tensor":
        return BODY["centre" if "centre" in rest else "tensor"]
    if name.startswith("start.attitude") and not scene.start.has_euler_angles:
        is_rotation = rest[0].isdecimal() and not isinstance(scene.start.attitude, tuple)
        return "rad" if is_rotation else "1"
    known = {**BODY, **START}
    if first in known and (not rest or rest[0].isdecimal()):
        return known[first]
    unit = units_of(scene, name)
    return squared(unit) if table == "effects" and "covariance" in rest else unit


def parameters_of(model: Model) -> dict[str, Given]:
    """Return {name: function that returns its Seeds, or the reason why it has no derivative}."""
    known, moments = body_parameters(model.body), model.body.moments
    if isinstance(moments, VectorDistribution) and not isinstance(moments, TensorDistribution):
        known |= _of_vector("body.moments", ("body", "moments"), moments)
    which = model.start.spin_name
    spin = getattr(model.start, which)
    known |= _of_vector(f"start.{which}", ("start", which), spin)
    if isinstance(spin, EquilibriumEnsemble) and model.body.is_turned:
        rule = "is drawn in the principal axes of each member, not in the axes of the scene"
        known |= dict.fromkeys((f"start.{which}.{i}" for i in (1, 2, 3)), rule)
    known |= _of_attitude(model)
    for i, (label, effect) in enumerate(label_effects(model.effects)):
        for field in user_parameters(effect):
            value, path = getattr(effect, field), ("effects", i, field)
            name = f"effects.{label}.{field}"
            scalar = shape(effect, field) is None
            known |= of_quantity(name, path, value) if scalar else _of_vector(name, path, value)
    return {**known, **_refused_by_rejection(model, known), END: list}


def _of_vector(name: str, path: Path, value: Any) -> dict[str, Given]:
    """Return the parameters of a vector of quantities, or of a distribution of vectors: the
    member's own components, then the parameters of the distribution."""
    known: dict[str, Given] = {}
    if isinstance(value, VectorDistribution):
        for i in range(3):
            known[f"{name}.{i + 1}"] = one_seed((*path, "sample"), _own_component(i))
        for field, part in value.as_dict().items():
            known |= _of_field(f"{name}.{field}", (*path, field), part)
        return known
    whole = whole_of(value)
    for i, part in enumerate(value):
        one = f"{name}.{i + 1}", (*path, i)
        known |= {one[0]: one_seed(one[1], own_number)} if whole else of_quantity(*one, part)
    return known | (_of_correlated(name, path, whole) if whole else {})


def _own_component(i: int) -> Rate:
    """Return the derivatives (3, n) of drawn vectors by their own component i."""
    return lambda drawn: np.eye(3)[:, i : i + 1] + np.zeros_like(drawn.values)


def _of_field(name: str, path: Path, part: Any) -> dict[str, Given]:
    """Return the parameters of a field of a distribution of vectors."""
    if part is None:
        return {}
    if isinstance(part, int):
        return {name: "is an integer"}
    if not isinstance(part, tuple):
        return of_quantity(name, path, part)
    if isinstance(part[0], tuple):
        return symmetric_parameters(name, path, len(part))
    known: dict[str, Given] = {}
    for i, one in enumerate(part):
        known |= of_quantity(f"{name}.{i + 1}", (*path, i), one)
    return known


def _of_correlated(name: str, path: Path, whole: Correlated) -> dict[str, Given]:
    """Return mean and covariance of a Correlated vector that is a parameter of an effect."""
    known: dict[str, Given] = {
        f"{name}.mean.{i + 1}": one_seed((*path, i), own_number) for i in range(3)
    }

    def by_covariance(i: int, j: int) -> list[Seed]:
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        marked: Any = [
            [DualArray(x, [by]) for x, by in zip(row, rates, strict=True)]
            for row, rates in zip(whole.covariance, unit.tolist(), strict=True)
        ]
        factor: Any = lower_factor(marked)
        rows = [[float(x.tangents[0]) for x in row] for row in factor]

        def rate_of(row: list[float]) -> Rate:
            def rate(drawn: Drawn) -> Any:
                assert drawn.words is not None
                return sum(by * normal_quantile(u) for by, u in zip(row, drawn.words, strict=False))

            return rate

        return [Seed((*path, k), rate_of(row)) for k, row in enumerate(rows)]

    for i, j in combinations_with_replacement(range(3), 2):
        known[f"{name}.covariance.{i + 1}.{j + 1}"] = lambda i=i, j=j: by_covariance(i, j)  # type: ignore[misc]
    return known


def _of_attitude(model: Model) -> dict[str, Given]:
    """Return the parameters of the attitude at the start: its angles, the four components of its
    quaternion, which is normalised, or the rotations of an attitude that is drawn as a whole."""
    name, value = "start.attitude", model.start.attitude
    if not isinstance(value, tuple):
        known = _own_rotations(name, model)
    if isinstance(value, Fisher):
        rule = "is a parameter of a distribution whose quantiles are read from a table"
        return known | {f"{name}.{field}": rule for field in value.names()}
    if isinstance(value, VectorDistribution):
        for field, part in value.as_dict().items():
            known |= _of_field(f"{name}.{field}", ("start", "attitude", field), part)
        if isinstance(value, Pointing) and not any(value.direction[:2]):
            rule = "is a direction along z, where the azimuth of the direction jumps"
            known |= dict.fromkeys((f"{name}.direction.{i}" for i in (1, 2, 3)), rule)
        return known
    if not isinstance(value, tuple):
        return known
    known = {}
    if len(value) == 3:
        for i, angle in enumerate(angle_names(model.start.sequence)):
            known |= of_quantity(f"{name}.{angle}", ("start", "attitude", i), value[i])
        return known
    if any(isinstance(x, Distribution) for x in value):
        return _of_vector(name, ("start", "attitude"), value)
    return {f"{name}.{k + 1}": lambda k=k: list(_of_component(value, k)) for k in range(4)}  # type: ignore[misc]


def _own_rotations(name: str, model: Model) -> dict[str, Given]:
    """Return the own parameters of an attitude that is drawn as a whole: rotations about the body
    axes."""
    names = [f"{name}.{i + 1}" for i in range(3)]
    if model.start.attitude == "ensemble" and model.body.is_turned:
        rule = "is drawn in the principal axes of each member, not in the axes of the scene"
        return dict.fromkeys(names, rule)
    path = "start", "sample_attitude"
    return {one: one_seed(path, _own_rotation(i)) for i, one in enumerate(names)}


def _own_rotation(i: int) -> Rate:
    """Return the derivatives q (0, e_i)/2 of attitudes (4, n) by a rotation about body axis i."""
    half = tuple(0.5 * float(i == k) for k in range(3))
    return lambda drawn: np.stack(multiply(tuple(drawn.values), (0.0, *half)))


def _of_component(value: Any, k: int) -> Iterator[Seed]:
    """Seed component k of a quaternion p: the part of its change that is orthogonal to p.

    The rest changes only the norm. Normalising would remove it, but p may already be normalised,
    and is then used as it is.
    """

    def rate_of(i: int) -> Rate:
        def rate(drawn: Drawn) -> Any:
            p = draw(value, 0, "", drawn.first, drawn.values.size)
            return float(i == k) - p[i] * p[k] / (p * p).sum(0)

        return rate

    for i in range(4):
        yield Seed(("start", "attitude", i), rate_of(i))


def _refused_by_rejection(model: Model, known: dict[str, Given]) -> dict[str, Given]:
    """Return the parameters on which the attitudes of an ensemble depend, with the reason why they
    have no derivative."""
    if model.start.attitude != "ensemble":
        return {}
    rule = (
        'changes which attitudes are accepted: attitude = "ensemble" is drawn by rejection, which'
        " jumps from one attitude to another"
    )
    acting = [one for one in label_effects(model.effects) if implements(one[1], "energy")]
    if not acting:
        return {}
    parts = ("body.", *(f"effects.{label}." for label, _ in acting))
    parts += tuple(f"start.momentum.{field}" for field in model.start.momentum.names())
    # the energies of the effects shipped depend on the body by its mass and centre alone
    shipped = all(name_of(effect) in EFFECTS for _, effect in acting)
    free = ("body.moments.",) if shipped else ()
    return {name: rule for name in known if name.startswith(parts) and not name.startswith(free)}

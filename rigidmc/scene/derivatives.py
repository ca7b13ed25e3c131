"""The derivatives that a run saves: their parameters, names and units.

`run.wrt` names parameters. Each saved observable NAME then has its derivatives by these parameters
in the variable d_NAME, with the dimension `parameter`.
"""

from collections.abc import Mapping, Sequence

from rigidmc.errors import SceneError, unknown
from rigidmc.inputs.units import powers_of, units_of_powers
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import Parameter, Seed
from rigidmc.scene.parameters import parameters_of

EACH = "per parameter_unit"  # end of units that differ between the parameters
_SYMMETRIC = (".tensor", ".mean", ".covariance")  # names before the indices of symmetric matrices


def parameter_names_of_derivatives(model: Model) -> list[str]:
    """Return the names of all parameters by which a model has derivatives.

    Examples
    --------
    >>> from rigidmc.scene.derivatives import parameter_names_of_derivatives
    >>> start = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 0.0))
    >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=start)
    >>> names = parameter_names_of_derivatives(scene.model)
    >>> [name for name in names if name.startswith("start.omega.1")]
    ['start.omega.1', 'start.omega.1.mean', 'start.omega.1.standard_deviation']
    """
    return _able(parameters_of(model))


def _able(parameters: Mapping[str, Parameter]) -> list[str]:
    """Return the names that have a derivative."""
    each = {name: p.seeds for name, p in parameters.items()}
    return [name for name, of in each.items() if callable(of) and not isinstance(of(), str)]


def seeds_of(model: Model, names: Sequence[str]) -> list[list[Seed]]:
    """Return the Seeds of each name; SceneError for a name that is unknown, given twice, or without
    a derivative, with the nearest name or the reason."""
    parameters, each, at = parameters_of(model), list[list[Seed]](), "run.wrt"
    names = [_upper_element(name) for name in names]
    for i, name in enumerate(names):
        stated = parameters[name].seeds if name in parameters else None
        if stated is None:
            raise unknown("parameter with a derivative", _able(parameters), at=at, value=name)
        seeds = stated() if callable(stated) else stated
        if isinstance(seeds, str):
            raise SceneError(f"has no derivative: it {seeds}", at=at, value=name)
        if name in names[:i]:
            raise SceneError("is given twice", at=at, value=name)
        each.append(seeds)
    return each


def _upper_element(name: str) -> str:
    """Return the name of an element of a symmetric matrix with its smaller index first."""
    matrix, *pair = name.rsplit(".", 2)
    if not matrix.endswith(_SYMMETRIC) or not all(map(str.isdecimal, pair)):
        return name
    return ".".join([matrix, *sorted(pair, key=int)])


def parameters_of_run(model: Model, names: Sequence[str] | None) -> tuple[str, ...]:
    """Return the parameters by which a run differentiates, each once, () if there are none.

    names : the setting `wrt`; a vector such as "start.omega" stands for its components

    Raises SceneError with the nearest name for a parameter that the model lacks.
    """
    if not names:
        return ()
    single = [p for p in parameters_of(model).values() if p.seeds is not None]
    chosen: dict[str, None] = {}
    for name in names:
        components = [p.name for p in single if p.vector == name]
        chosen |= dict.fromkeys(components or [name])
    seeds_of(model, tuple(chosen))
    return tuple(chosen)


def derivative_name(name: str) -> str:
    """Return the name of the variable with the derivatives of a variable."""
    return f"d_{name}"


def derivative_units(units: str, parameter_units: Sequence[str]) -> str:
    """Return the units of the derivatives of a variable in `units` by several parameters.

    If the parameters differ in units, these are words that end with EACH: the unit of each is in
    the coordinate `parameter_unit` of the result.
    """
    if len(set(parameter_units)) == 1:
        return quotient(units, parameter_units[0])
    return f"{units} {EACH}"


def quotient(units: str, by: str) -> str:
    """Return the quotient of two units: "m s-2 kg-1" of "m s-2" by "kg".

    Units of custom code that are not products of powers are joined by "per".
    """
    above, below = powers_of(units), powers_of(by)
    if above is None or below is None:
        return f"{units} per {by}"
    return units_of_powers({k: above.get(k, 0) - below.get(k, 0) for k in {**above, **below}})

"""The derivatives that a run saves: their parameters, names and units.

`run.wrt` names parameters. Each saved observable NAME then has its derivatives by these parameters
in the variable d_NAME, with the dimension `parameter`.
"""

from collections.abc import Sequence

from rigidmc.scene.derivative_names import check_derivative_names, parameters_of
from rigidmc.scene.scene import Scene
from rigidmc.scene.varied import vector_of

EACH = "per parameter_unit"  # end of units that differ between the parameters


def parameters_of_run(scene: Scene) -> tuple[str, ...]:
    """Return the parameters by which a run differentiates, each once, () if there are none.

    A vector such as "start.omega" stands for its components. Raises SceneError with the nearest
    name for a parameter that the scene lacks.
    """
    if not scene.run.wrt:
        return ()
    single = list(parameters_of(scene.model))
    found: dict[str, None] = {}
    for name in scene.run.wrt:
        components = [one for one in single if vector_of(one) == name]
        found |= dict.fromkeys(components or [name])
    check_derivative_names(scene, tuple(found))
    return tuple(found)


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
    powers: dict[str, int] = {}
    for text, sign in ((units, 1), (by, -1)):
        for word in text.split():
            symbol = word.rstrip("-0123456789")
            power = word[len(symbol) :]
            if word == "1":
                continue
            if not symbol.isalpha() or not (power.removeprefix("-") or "1").isdecimal():
                return f"{units} per {by}"
            powers[symbol] = powers.get(symbol, 0) + sign * int(power or 1)
    words = [f"{symbol}{power if power != 1 else ''}" for symbol, power in powers.items() if power]
    return " ".join(words) or "1"

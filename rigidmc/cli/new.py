"""rigidmc new: write a first scene file, from options or from answers at the terminal."""

import math
import os
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from rigidmc.cli.app import INTERRUPTED, fail
from rigidmc.cli.options import Force, count_option, gather_options, time_option
from rigidmc.cli.reporting import refuse_outputs, report_errors
from rigidmc.errors import OptionError, RigidmcError, SceneError, unknown
from rigidmc.inputs.amounts import read_count_text
from rigidmc.inputs.measured import as_measured, quantity_text
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.scene.units import in_si, size_units

Vector = tuple[float, ...]
Given = dict[str, Any]  # {option: its text, number or None}


# SI units of the options
UNITS = {"moments": "kg m2", "mass": "kg", "centre": "m", "pivot": "m", "spin": "rad s-1",
         "gravity": "m s-2"}  # fmt: skip


def read_numbers(text: str, key: str, count: int | None = None, units: str | None = None) -> Vector:
    """Read numbers separated by commas; OptionError.

    units : SI units, by default of the option. A unit after the last number alone, as in
        "10,0,0 deg/s", is the unit of all
    """
    parts: list[Any] = text.split(",")
    if (last := as_measured(parts[-1])) is not parts[-1] and not any(
        map(quantity_text, parts[:-1])
    ):
        parts = [*(f"{part} {last.unit}" for part in parts[:-1]), parts[-1]]
    try:
        values = tuple(float(in_si(part, units or UNITS.get(key, "1"), key)) for part in parts)
    except SceneError as error:
        raise OptionError(error.rule, at=key, value=text, nearest=error.nearest) from None
    except ValueError:
        values = ()
    if not values or count not in (None, len(values)) or not all(map(math.isfinite, values)):
        many = "numbers" if count is None else "a number" if count == 1 else f"{count} numbers"
        commas = "" if count == 1 else " separated by commas"
        hint = ", such as 0,0,150" if key == "spin" else ""
        raise OptionError(f"expected {many}{commas}, all finite{hint}", at=key, value=text)
    return values


def read_sizes(text: str, key: str = "size") -> dict[str, Any]:
    """Read {name: number, or list of numbers}: "radius=0.03,height=0.008" or "size=1,2,3"."""
    values: dict[str, Any] = {}
    for part in text.replace(" ", "").split(","):
        name, equals, value = part.rpartition("=")
        if equals:
            last = name
        if not values and not equals:
            rule = "expected NAME=NUMBER, as in radius=0.03,height=0.008 or size=0.02,0.05,0.1"
            raise OptionError(rule, at=key, value=text)
        values.setdefault(last, []).extend(read_numbers(value, key, 1, size_units(last)))
    return {name: numbers[0] if len(numbers) == 1 else numbers for name, numbers in values.items()}


def lean_of(text: str, key: str = "lean") -> float | str:
    """Read an angle in rad or as 20deg, or "uniform"; return rad; OptionError."""
    if text == "uniform":
        return text
    angle = read_numbers(text, key, 1, "rad")[0]
    if not -math.pi <= angle <= math.pi:
        raise OptionError(
            "an angle in rad is at most pi; write degrees as 20deg", at=key, value=text
        )
    return angle


def gravity_of(text: str, key: str = "gravity") -> float:
    """Read a number [m/s2]; 0 for "none"; OptionError."""
    return 0.0 if text == "none" else read_numbers(text, key, 1)[0]


def mass_of(answers: Given, default: float) -> float:
    """Return the mass [kg] of the options."""
    return default if answers["mass"] is None else read_numbers(answers["mass"], "mass", 1)[0]


def body_table(answers: Given) -> Given:
    """Return the table [body] for the body options; without any, the table of a heavy top."""
    from rigidmc.views.new_scene import SIZES, TOP, body_in

    table: Given = {}
    shaped = any(answers[key] is not None for key in ("solid", "size", "mass"))
    if answers["moments"] is not None:
        for key in ("solid", "size"):
            if answers[key] is not None:
                rule = "cannot be combined with --moments, which describe the whole body"
                raise OptionError(rule, at=key, value=answers[key])
        table["moments"] = list(read_numbers(answers["moments"], "moments", 3))
        table["mass"] = mass_of(answers, 1.0)
        if answers["centre"] is not None:
            table["centre"] = list(read_numbers(answers["centre"], "centre", 3))
    elif answers["centre"] is not None:
        rule = "requires --moments; for a solid, give the fixed point as --pivot"
        raise OptionError(rule, at="centre", value=answers["centre"])
    elif not shaped and answers["pivot"] is None:
        table |= TOP
    else:
        solid = answers["solid"] or "cylinder"
        if solid not in SOLIDS:
            raise unknown("solid", SOLIDS, at="solid", value=solid, error=OptionError)
        table[solid] = SIZES[solid] if answers["size"] is None else read_sizes(answers["size"])
        mass = {} if answers["mass"] is None else {"mass": mass_of(answers, 0.2)}
        table[solid] = ({} if solid == "t_handle" else {"mass": 0.2}) | table[solid] | mass
    if answers["pivot"] is not None:
        table["pivot"] = list(read_numbers(answers["pivot"], "pivot", 3))
    _refuse_body(lambda: body_in(table))
    return table


def _refuse_body(make: Callable[[], object]) -> None:
    """Turn an error about the body into an error about its option."""
    try:
        make()
    except RigidmcError as error:
        is_option = error.key in ("moments", "mass", "centre", "pivot")
        key = error.key if is_option else f"size {error.key}"
        raise OptionError(error.rule, at=key, value=error.value, nearest=error.nearest) from None


def motion_of(answers: Given, table: Given) -> Any:
    """Return the FirstMotion of the options, with defaults that suit the body."""
    from rigidmc.views.new_scene import FirstMotion, body_in, default_gravity, default_spin

    body, text = body_in(table), answers["gravity"]
    gravity = default_gravity(body) if text is None else gravity_of(text)
    if gravity and not default_gravity(body):
        rule = "exerts no torque on a body held at its centre of mass: give a --pivot"
        raise OptionError(rule, at="gravity", value=text)
    spread = 0.01 if answers["spread"] is None else answers["spread"]
    if not 0.0 <= spread < 1.0:
        raise OptionError(
            "expected a fraction of the spin, from 0 to below 1", at="spread", value=spread
        )
    auto, given_spin = default_spin(body, gravity), answers["spin"]
    spin = auto if given_spin is None else read_numbers(given_spin, "spin", 3)
    lean: float | str | None = 0.4 if gravity else None
    lean = lean if answers["lean"] is None else lean_of(answers["lean"])
    return FirstMotion(spin, spread, lean, gravity)


def ask(question: str, default: str | None, read: Callable[[str], Any]) -> str | None:
    """Prompt for an answer that `read` accepts, and reprompt until it is valid. Without a default,
    an empty answer is None."""

    def checked(text: str) -> str | None:
        try:
            if text:
                read(text)
        except RigidmcError as error:
            raise typer.BadParameter(error.text(f"--{error.key}")) from None
        return text or None

    answer = typer.prompt(question, default or "", value_proc=checked, show_default=bool(default))
    return str(answer) if answer else None


def ask_options(answers: Given) -> Given:
    """Return the options from answers at the terminal."""
    from rigidmc.views.new_scene import SIZES, TOP

    def body(key: str) -> Callable[[str], object]:
        return lambda text: body_table({**answers, key: text})

    answers = dict(answers)
    answers["solid"] = ask(f"Solid: {', '.join(SOLIDS)}", "cylinder", body("solid"))
    example = SIZES[answers["solid"] or "cylinder"]
    text = ",".join(f"{k}={str(v).strip('[]')}" for k, v in example.items()).replace(" ", "")
    answers["size"] = ask("Mass and sizes [kg, m]", text, body("size"))
    top = ",".join(map(str, TOP["pivot"])) if answers["solid"] == "cylinder" else None
    where = "Fixed point relative to the origin of the solid [m]; 0,0,0 is the origin"
    answers["pivot"] = ask(where, top or "0,0,0", body("pivot"))
    table = body_table(answers)
    auto = motion_of(answers, table)
    if auto.gravity:
        answers["gravity"] = ask("Gravity [m/s2], or none", f"{auto.gravity:g}", gravity_of)
        auto = motion_of(answers, table)
    spin = ",".join(f"{w:g}" for w in auto.spin)
    answers["spin"] = ask(
        "Spin about the body axes [rad/s]", spin, lambda text: read_numbers(text, "spin", 3)
    )
    if auto.gravity:
        question = "Angle between axis 3 and the vertical [rad], or uniform"
        answers["lean"] = ask(question, f"{auto.lean:g}", lean_of)
    members = ask("Number of members", "1000", lambda text: read_count_text(text, "members"))
    return {**answers, "members": read_count_text(members or "1000", "members")}


def at_terminal() -> bool:
    """Whether standard input is a terminal, so that a user can answer."""
    return sys.stdin.isatty()


def _text(metavar: str, text: str) -> Any:
    return typer.Option(metavar=metavar, help=text)


OPTIONS = {
    "solid": Annotated[str | None, _text("SOLID", f"Body: {', '.join(SOLIDS)}.")],
    "size": Annotated[
        str | None,
        _text("SIZES", "Sizes of the solid \\[m]: radius=0.03,height=0.008 or size=1,2,3."),
    ],
    "mass": Annotated[str | None, _text("FLOAT", "Mass \\[kg].")],
    "moments": Annotated[
        str | None, _text("I1,I2,I3", "Principal moments \\[kg m2], instead of a solid.")
    ],
    "centre": Annotated[
        str | None, _text("X,Y,Z", "With --moments: centre of mass from the fixed point \\[m].")
    ],
    "pivot": Annotated[
        str | None, _text("X,Y,Z", "Fixed point relative to the origin of the solid \\[m].")
    ],
    "spin": Annotated[
        str | None,
        _text("W1,W2,W3", "Spin about the body axes \\[rad/s]; by default suits the body."),
    ],
    "spread": Annotated[
        float | None,
        typer.Option(help="Standard deviation of the spin, relative to it; by default 0.01."),
    ],
    "lean": Annotated[
        str | None, _text("ANGLE", "Angle between axis 3 and the vertical: rad, 20deg, or uniform.")
    ],
    "gravity": Annotated[
        str | None,
        _text(
            "G",
            "Gravity \\[m/s2], or none; by default 9.81 if the body is not held at its centre of"
            " mass.",
        ),
    ],
    "members": Annotated[
        int | None, count_option("--members", help="Number of members; by default 1000.")
    ],
    "t_end": Annotated[
        float | None, time_option("--t-end", help="End time; by default tens of turns.")
    ],
    "title": Annotated[str | None, _text("TEXT", "Title; by default the name of the file.")],
}


@gather_options("given", {**OPTIONS, "force": (Force, False)}, dict)
def new_command(
    file: Annotated[str, typer.Argument(metavar="FILE", help="Scene file to write (.toml).")],
    given: Given,
) -> None:
    with report_errors():
        from rigidmc.files.outputs import write_bytes
        from rigidmc.views.new_scene import new_scene

        force = given.pop("force")
        refuse_outputs(force, scene=file)
        if at_terminal() and all(value is None for value in given.values()):
            try:
                given = ask_options(given)
            except typer.Abort:
                fail("interrupted; nothing was written", INTERRUPTED)
        table = body_table(given)
        name = os.path.basename(file).removesuffix(".toml")
        text = new_scene(
            given["title"] or name,
            table,
            motion_of(given, table),
            given["members"] or 1000,
            given["t_end"],
        )
        write_bytes(file, text.encode(), force)
        print(f"  wrote {file}")
        print(f"  rigidmc show {file}\n  rigidmc run {file} -o {name}.nc --plot {name}.png")

"""Custom effects, observables, integrators and distributions: their classes, and placeholders.

A table gives the class by its own name, as in [effects.Wind], and the file by module = "wind.py".
"""

import uuid
from collections import namedtuple
from collections.abc import Iterable
from dataclasses import make_dataclass
from typing import Any, TypedDict, cast

from rigidmc.engine.compiler.contents import contents_of
from rigidmc.errors import SceneError
from rigidmc.files.user_code import class_named, class_of, source_of
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

Classes = tuple[type[Any], ...]
Code = str | bool | Classes | None
_made_here: dict[str, Classes] = {}  # custom classes of the scenes that this process has run
# attributes needed to open a result without running the code of a class: none of it is compiled
_FACTS: dict[str, dict[str, Any]] = {
    "effects": {"torque": lambda self: 0.0, "energy": lambda self: 0.0},
    "observables": {"check": lambda self: None, "units": "", "long_name": "", "dims": ()},
    "integrators": {
        "step": lambda self: 0.0,
        "order": 1,
        "evaluations": 1,
        "is_reversible": False,
        "conserves": (),
        "accepts": "any torque",
        "compensated": True,
    },
}


class Origin(TypedDict, total=False):
    """What this process knows of a result, in its encoding; no file has it."""

    run_seconds: float
    compile_seconds: float
    predicted_seconds: float
    steps: float
    flagged: dict[str, int]  # members by status
    classes: str  # key of `remember_classes`
    allow_code: bool


def origin_of(dataset: Any) -> Origin:
    """Return what this process knows of a result, to be read and to be added to."""
    return cast(Origin, dataset.encoding.setdefault("rigidmc", {}))


def load_user_class(name: str, module: Any, at: str, code: Code) -> type[Any] | None:
    """Return a class from the Python file that defines it; SceneError.

    at : the table, such as effects.Wind
    code : folder of the Python files that may be run; False if none may be run; None to return None
        for the class, which a placeholder without physics then replaces; or the classes themselves,
        of a result of this process
    """
    if isinstance(code, tuple) and (loaded := class_named(name, code)):
        return loaded
    if not isinstance(module, str):
        raise SceneError("expected the name of a Python file", at=f"{at}.module", value=module)
    if code is None:
        return None
    if not isinstance(code, str):
        rule = (
            "is code, and scene files execute nothing; inspect it, then allow it with --allow-code"
            " (in Python allow_code=True)"
        )
        raise SceneError(rule, at=f"{at}.module", value=module)
    return class_of(code, module, name, at)


def remember_classes(parts: Iterable[Any]) -> str:
    """Keep the classes of the custom parts of a scene, and return the key by which a result of this
    process has them; "" if there are none."""
    classes = tuple(dict.fromkeys(map(type, parts)))
    key = next((key for key, made in _made_here.items() if made == classes), uuid.uuid4().hex)
    if classes:
        _made_here[key] = classes
    return key if classes else ""


def code_of(dataset: Any) -> bool | Classes:
    """Return the custom classes of a result of this process, else whether its code may run."""
    origin = origin_of(dataset)
    return _made_here.get(origin.get("classes", ""), ()) or origin.get("allow_code", False)


def make_stand_in(kind: str, name: str, table: dict[str, Any]) -> type[Any]:
    """Make a placeholder for a class whose code is not run: the parameters of a table [kind.name],
    without physics."""
    fields = [key for key in table if key != "module"]
    make: Any = namedtuple  # its fields are known at run time
    try:
        made = make(name, fields)
    except ValueError as error:
        rule = f"cannot be a class with these parameters: {error}"
        raise SceneError(rule, at=f"{kind}.{name}") from None
    made.shapes = {key: len(value) for key, value in table.items() if isinstance(value, list)}
    for fact, value in {**_FACTS[kind], "stand_in": True}.items():
        setattr(made, fact, value)
    stand_in: type[Any] = made
    return stand_in


def make_distribution_stand_in(name: str, table: Any, at: str) -> type[VectorDistribution]:
    """Make a placeholder for a distribution of a key such as start.omega."""
    if not isinstance(table, dict) or not all(map(str.isidentifier, (name, *table))):
        raise SceneError("expected the parameters of a distribution", at=at, value=table)
    key = at.rpartition(".")[2]
    facts = {"variables": (key,), "check": lambda self, at: self, "stand_in": True}
    made: type[VectorDistribution] = make_dataclass(
        name, list(table), bases=(VectorDistribution,), namespace=facts, frozen=True
    )
    return made


def contents_of_parts(parts: Iterable[Any]) -> dict[str, str]:
    """Return what the classes of the custom parts of a scene read, see `contents_of`."""
    return contents_of(dict.fromkeys(map(type, parts)))


def module_of(part: Any) -> dict[str, str]:
    """Return {"module": file} of a custom class's instance; {} if the class has no file."""
    file = source_of(type(part))
    return {} if file is None else {"module": file}

"""Writing of a scene as TOML text, from which `rigidmc.scene.scene.loads` makes the same scene."""

from collections.abc import Iterable, Mapping
from typing import Any

import tomli_w

from rigidmc.physics.dynamics.methods import word_of
from rigidmc.physics.effects import EFFECTS, label_effects, name_of
from rigidmc.physics.effects.protocol import user_parameters
from rigidmc.physics.observables import is_own, word_of_observable
from rigidmc.scene.body import IDENTITY, Body
from rigidmc.scene.model import Model
from rigidmc.scene.settings import Run
from rigidmc.scene.start import Start
from rigidmc.scene.start_tables import attitude_as_table, omega_as_table
from rigidmc.scene.stated import ORIGIN, Stated
from rigidmc.scene.toml.values import as_toml
from rigidmc.scene.user_parts.registry import module_of


def dumps(
    texts: Mapping[str, str],
    model: Model,
    observables: Iterable[Any],
    integrators: Iterable[Any],
    run: Run,
) -> str:
    """Return a scene as TOML text; arrays with one row per member become references to variables
    of the result.

    texts : title, summary and source
    """
    tables: dict[str, Any] = {key: text for key, text in texts.items() if text != ""}
    tables |= {"body": _body(model.body), "effects": _effects(model.effects)}
    if observables:
        pairs = [
            (word_of_observable(x), {**(module_of(x) if is_own(x) else {}), **x._asdict()})
            for x in observables
        ]
        tables["observables"] = _grouped(pairs)
    if integrators:
        tables["integrators"] = {
            word_of(type(part)): {**module_of(part), **part._asdict()} for part in integrators
        }
    tables |= {"start": _start(model.start), "run": _run(run)}
    return tomli_w.dumps(tables)


def _body(body: Body) -> dict[str, Any]:
    back = ORIGIN
    if isinstance(body.stated, Stated):
        table, back = body.stated.as_table(), body.stated.origin_to_pivot()
    else:
        table = {body.inertia_key: as_toml(body.moments, body.inertia_key)}
        table |= {key: as_toml(getattr(body, key), key) for key in ("mass", "centre")}
        if body.inertia_key == "moments" and body.axes != IDENTITY:
            table["principal_axes"] = [list(row) for row in body.axes]
    if body.frame != "described" or body.inertia_key == "tensor":
        table["axes"] = body.frame
    if body.shape:
        table["shape"] = [part.placed(back).as_table() for part in body.shape]
    return table


def _effects(effects: Iterable[Any]) -> dict[str, Any]:
    pairs = []
    for label, effect in label_effects(effects):
        table = {} if type(effect) in EFFECTS.values() else module_of(effect)
        table |= {k: as_toml(getattr(effect, k), f"{label}_{k}") for k in user_parameters(effect)}
        pairs.append((name_of(effect), table))
    return _grouped(pairs)


def _start(start: Start) -> dict[str, Any]:
    which = start.spin_name
    relative = {key: key in start.relative_to_orbit for key in (which, "attitude")}
    names = {key: f"start_{'relative_' if relative[key] else ''}{key}" for key in relative}
    names["attitude"] = "start_euler" if start.has_euler_angles else names["attitude"]
    written = {key: as_toml(getattr(start, key), names[key]) for key in relative}
    return {
        which: omega_as_table(written[which], relative[which]),
        "attitude": attitude_as_table(
            start.attitude, written["attitude"], start.sequence, relative["attitude"]
        ),
    }


def _run(run: Run) -> dict[str, Any]:
    settings = run.model_dump(exclude={"dt"} if run.turn else None)
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in settings.items()
        if value is not None
    }


def _grouped(pairs: list[tuple[str, dict[str, Any]]]) -> dict[str, Any]:
    """Return {name: table}, or {name: [table, ...]} for several tables of one name."""
    tables: dict[str, list[dict[str, Any]]] = {}
    for name, table in pairs:
        tables.setdefault(name, []).append(table)
    return {name: many if len(many) > 1 else many[0] for name, many in tables.items()}

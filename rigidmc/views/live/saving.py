"""The scene file that a live page saves: a text with marks in the place of what the page sets."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import tomli_w

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.euler_angles import TEXTBOOK
from rigidmc.physics.effects import name_of
from rigidmc.physics.integrators.protocol import follows_turns
from rigidmc.planning.initial import initial_block
from rigidmc.scene.body import Body
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import Parameter
from rigidmc.scene.parameters import with_parameters
from rigidmc.scene.quantities import Grid
from rigidmc.scene.scene import Scene
from rigidmc.scene.toml.values import as_toml
from rigidmc.views.live.engine import LiveRun, doubles
from rigidmc.views.live.sliders import Slider

LIST = re.compile(r"\[\n((?:\s+[^\[\]\n]+,\n)+)\s*\]")  # as tomli_w writes it: an item a line
OF_BODY = ("moments", "mass", "centre")


def texts(scene: Scene, sliders: Sequence[Slider]) -> dict[str, str]:
    """Return the scene as TOML, "as_given" and "with_moments", the latter for a page that moves the
    body: a solid then becomes moments, mass and centre.

    Marks are "@dt@", "@members@", "@turn_rate@" and "@K@", where slider K moves a number.
    """
    rows = enumerate(sliders)
    return {
        "as_given": _marked(scene, {k: slider for k, slider in rows if slider.kind not in OF_BODY}),
        "with_moments": _marked(_with_moments(scene), dict(enumerate(sliders))),
    }


def _with_moments(scene: Scene) -> Scene:
    """Return a scene whose body is given by moments, mass and centre."""
    body = scene.body
    if not body.shape or body.is_turned:
        return scene
    plain = Body(body.moments, mass=body.mass, centre=body.to_principal(body.centre))
    return scene.with_model(scene.model._replace(body=plain))


def _marked(scene: Scene, sliders: Mapping[int, Slider]) -> str:
    tables = tomllib.loads(scene.dumps())
    tables["run"] |= {"dt": "@dt@", "members": "@members@"}
    if follows_turns(scene.integrator):
        tables["run"]["turn_rate"] = "@turn_rate@"
    for k, slider in sliders.items():
        table, *path = _path(scene.model, slider.parameter)
        place: Any = tables[table]
        for part in path[:-1]:
            place = place[part]
        # a distribution of a whole vector is a table, in which no component has a place
        if isinstance(place, list) or isinstance(path[-1], str):
            place[path[-1]] = f"@{k}@"
    return LIST.sub(_in_a_line, tomli_w.dumps(tables))


def _in_a_line(rows: re.Match[str]) -> str:
    return f"[{' '.join(row.strip() for row in rows[1].splitlines()).removesuffix(',')}]"


def _path(model: Model, parameter: Parameter) -> tuple[Any, ...]:
    """Return the keys and indices of a number in the tables of a scene file."""
    table, first, *rest = parameter.path
    if first == "attitude" and model.start.sequence != TEXTBOOK:
        rest = ["angles", *rest]
    if table != "effects":
        return (table, first, *rest)
    word = name_of(model.effects[int(first)])
    same = [i for i, effect in enumerate(model.effects) if name_of(effect) == word]
    return (table, word, *([same.index(int(first))] if len(same) > 1 else []), *rest)


def locations(source: Any) -> list[tuple[str, Any]]:
    """Return the keys, in its table, of the numbers by which a distribution moves; none if no shift
    of these moves all its numbers alike."""
    if isinstance(source, Grid) and not source.log:
        return [("grid", 0), ("grid", 1)]
    if type(source) is not Distribution:
        return []
    if source.uses_scipy:
        return [(source.name, "loc")]
    return [(source.name, 0)] if source.name == "normal" else [(source.name, 0), (source.name, 1)]


def _from_zero(source: Any) -> Any:
    """Return a distribution at location 0, or from 0 to 1 if two numbers locate it."""
    if isinstance(source, Grid):
        return replace(source, low=0.0, high=1.0)
    if source.uses_scipy:
        parameters = tuple((dict(source.parameters) | {"loc": 0.0}).items())
        return Distribution(source.name, parameters)
    last = source.parameters[1] if source.name == "normal" else 1.0
    return Distribution(source.name, (0.0, last))


def saving_data(live: LiveRun, slider: Slider) -> dict[str, Any]:
    """Return what a page needs to move the numbers of all members, and to write them.

    source : the quantity as a value of TOML, None for rows of a table;  locations : see `locations`
    spread : the numbers z of members if these are low + z, or low + z (high - low) with two
    locations: a page then has the bits of the distribution that it writes
    """
    source = slider.source
    if isinstance(source, np.ndarray):
        return {"source": None, "locations": []}
    facts = {"source": as_toml(source, slider.name), "locations": locations(source)}
    if facts["locations"] and (spread := _spread(live, slider)) is not None:
        return facts | {"spread": doubles(spread)}
    return facts | {"locations": []}


def _spread(live: LiveRun, slider: Slider) -> Array | None:
    try:
        values = {slider.name: _from_zero(slider.source)}
        model = with_parameters(live.run.scene.model, values)
    except SceneError:  # the number has no name of its own in this scene
        return None
    first, count = live.run.members.first, live.block.shape[1]
    _, start = initial_block(model, live.run.sampler, first, count)
    return slider.numbers(start)

"""Write a new scene file: a body, gravity and a spin become TOML with a comment on each line, and
with a step and an end that suit the motion."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from rigidmc.errors import OptionError
from rigidmc.mechanics.lagrange_steady import least_spin
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.planning.initial import make_pilot
from rigidmc.planning.saves import turning_at_start
from rigidmc.planning.scheme import largest_rates
from rigidmc.runs.prepare import prepare_scene
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.toml.bodies import read_body
from rigidmc.scene.toml.read import read_start
from rigidmc.scene.toml.values import DataSources

# one example of each solid, hand-sized [m, kg, kg/m3]
SIZES: dict[str, dict[str, Any]] = {
    "box": {"mass": 0.2, "size": [0.02, 0.05, 0.1]},
    "ball": {"mass": 0.2, "radius": 0.03},
    "shell": {"mass": 0.05, "radius": 0.03},
    "cylinder": {"mass": 0.2, "radius": 0.03, "height": 0.008},
    "hollow_cylinder": {"mass": 0.2, "inner": 0.02, "outer": 0.03, "height": 0.05},
    "cone": {"mass": 0.2, "radius": 0.03, "height": 0.06},
    "ellipsoid": {"mass": 0.2, "semiaxes": [0.02, 0.03, 0.05]},
    "rod": {"mass": 0.05, "length": 0.1, "radius": 0.004},
    "plate": {"mass": 0.1, "size": [0.05, 0.1]},
    "disc": {"mass": 0.1, "radius": 0.05},
    "ring": {"mass": 0.1, "radius": 0.05},
    "t_handle": {"density": 8500.0, "radius": 0.005, "bar": 0.08, "stem": 0.04},
}
TOP = {"cylinder": SIZES["cylinder"], "pivot": [0.0, 0.0, -0.04]}  # a disc on a massless pin
STEP = 0.4  # rad per step of rk8: 1e-8 after 10 s, see the table in README.md
TURNS = 50  # minimum from the start to the end
FINE = 1.0  # rad at most between two saves: half the limit for drawing lines
SAVES = 100, 2000  # minimum and maximum: 1,000 members of 8 numbers then take 128 MB
SOLID = "SI units: kg, m; `rigidmc body FILE` shows its moments and principal axes"
WORDS = {  # the comment on a key
    "title": "heads pictures and results",
    "moments": "kg m2, principal moments about the fixed point",
    "mass": "kg",
    "centre": "m, centre of mass relative to the fixed point",
    "pivot": "m, fixed point relative to the origin of the solid",
    "g": "m/s2, along -z",
    "omega": "rad/s, about the body axes; normal = [mean, standard deviation]",
    "attitude": 'rad, Euler angles z-x-z (phi, theta, psi), or "uniform": any attitude',
    "integrator": "order 8; `rigidmc integrators` lists others",
    "dt": f"s, step: no member moves by more than {STEP:g} rad per step",
    "members": "number of tops to integrate",
    "seed": "of all random draws: another seed gives another ensemble",
    "every": "s between saves",
    "save": "`rigidmc observables` lists more",
    **dict.fromkeys(SIZES, SOLID),
}
NO_COLUMNS = DataSources(None, "")


class FirstMotion(NamedTuple):
    """Start of the members of a new scene, and gravity.

    spin : (3,) about the body axes [rad/s];  spread : of the spin, relative to it
    lean : angle of axis 3 from the vertical [rad], or "uniform", or None if the attitude is
        irrelevant
    gravity : [m/s2], 0 for none
    """

    spin: tuple[float, ...]
    spread: float
    lean: float | str | None
    gravity: float


def body_in(table: Mapping[str, Any]) -> Body:
    """Read the body of a table [body] of plain numbers; SceneError."""
    return read_body(dict(table), NO_COLUMNS)


def default_gravity(body: Body) -> float:
    """Return the gravity of the Earth if the fixed point is not the centre of mass, else 0
    [m/s2]."""
    return 9.81 if np.linalg.norm(body.centre) > 0.0 else 0.0


def default_spin(body: Body, gravity: float) -> tuple[float, float, float]:
    """Return twice the spin about axis 3 above which an upright top sleeps, see `least_spin`;
    without gravity, one turn per second about the middle axis, which flips [rad/s]."""
    moments = np.array(body.moments)
    if gravity:
        weight = body.mass * abs(gravity) * float(np.linalg.norm(body.centre))
        sleeping = least_spin((moments.max(), moments.max(), moments[2]), weight)
        return 0.0, 0.0, float(f"{2.0 * sleeping:.1g}")
    middle = int(np.argsort(moments, kind="stable")[1])
    first, second, third = (6.28 if k == middle else 0.0 for k in range(3))
    return first, second, third


def new_scene(
    title: str,
    table: Mapping[str, Any],
    motion: FirstMotion,
    members: int = 1000,
    t_end: float | None = None,
) -> str:
    """Return the text of a scene with a body, gravity and a spin.

    table : [body], as in a scene file;  t_end : [s], by default tens of turns

    Raises OptionError if nothing moves, and SceneError if the scene cannot be run.
    """
    body = body_in(table)
    end, every, dt = _times(body, motion, t_end)
    turns = end * math.hypot(*motion.spin) / (2.0 * math.pi)
    save = ["omega", "energy"] if motion.lean is None else ["omega", "attitude", "energy"]
    if motion.lean is None and len(set(body.moments)) == 3:
        save.append("flips")  # `rigidmc summary` then reports the time between flips
    run = {
        "integrator": "rk8",
        "dt": dt,
        "t_end": end,
        "members": members,
        "seed": 1,
        "every": every,
        "save": save,
    }
    words = WORDS | {"t_end": f"s, end: {turns:.3g} turns of the spin"}
    if every == end:
        words["every"] = "s between saves: first and last state only; to see the motion, save more"
    tables = {"[body]": table, "[effects.gravity]": {"g": motion.gravity}}
    tables |= {"[start]": _start(motion), "[run]": run}
    if not motion.gravity:
        del tables["[effects.gravity]"]
    parts = [_lines({"title": title}, words)]
    parts += [f"{head}\n{_lines(content, words)}" for head, content in tables.items()]
    text = "\n".join(parts)
    prepare_scene(Scene.loads(text))
    return text


def _times(body: Body, motion: FirstMotion, t_end: float | None) -> tuple[float, float, float]:
    """Return (t_end, every, dt) [s], round numbers; OptionError if nothing moves."""
    effects = (Gravity(motion.gravity),) if motion.gravity else ()
    scene = Scene(body, effects, read_start(_start(motion), NO_COLUMNS))
    at_rest = replace(scene, start=replace(scene.start, omega=(0.0, 0.0, 0.0)))
    (spin, rate), (_, swing) = (
        largest_rates(effects, make_pilot(start.model, start.run.seed, True).block)
        for start in (scene, at_rest)
    )
    if not rate > 0.0:
        rule = "nothing moves: give a spin, or --gravity and a --pivot"
        raise OptionError(rule, at="spin", value=",".join(f"{w:g}" for w in motion.spin))
    end = _round(TURNS * 2.0 * math.pi / max(spin, swing)) if t_end is None else t_end
    every = _decimal(end / _saves(end, scene))
    # the steps between two saves are a whole, round number
    return end, every, _decimal(every / _round(max(1.0, every * rate / STEP)))


def _saves(end: float, scene: Scene) -> int:
    """Return the number of saves until `end` [s] that resolves all rotations in a scene: a round
    number, at least SAVES[0]. If it exceeds SAVES[1], return 1, for the last state only."""
    fastest = max(float(np.max(rate)) for rate in turning_at_start(scene.model, scene.run))
    wanted = _round(max(SAVES[0], end * fastest / FINE))
    return round(wanted) if wanted <= SAVES[1] else 1


def _round(value: float) -> float:
    """Round up to 1, 2, 5 or 10 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return _decimal(next(k * power for k in (1, 2, 5, 10) if k * power >= value * (1.0 - 1e-9)))


def _decimal(value: float) -> float:
    return float(f"{value:.12g}")


def _start(motion: FirstMotion) -> dict[str, Any]:
    """Return the table [start]."""
    spread = _decimal(motion.spread * math.hypot(*motion.spin))
    # a heavy top spins about its own axis when released; a free body flips only if disturbed
    spin = [
        {"normal": [w, spread]} if spread and (w or not motion.gravity) else w for w in motion.spin
    ]
    if motion.lean is None:
        return {"omega": spin}
    lean = motion.lean if isinstance(motion.lean, str) else [0.0, motion.lean, 0.0]
    return {"omega": spin, "attitude": lean}


def _value(value: Any) -> str:
    """Write a value as TOML on one line."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_value(entry)}' for key, entry in value.items())} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    return tomli_w.dumps({"value": value}).removeprefix("value = ").rstrip("\n")


def _lines(table: Mapping[str, Any], words: Mapping[str, str]) -> str:
    """Return the lines of a table, with aligned comments."""
    lines = {key: f"{key} = {_value(value)}" for key, value in table.items()}
    width = max(map(len, lines.values()))
    return "".join(f"{line:{width}s}   # {words[key]}\n" for key, line in lines.items())

"""What must be refused with a reason, not run."""

import math
from collections.abc import Callable, Iterator
from typing import Any

from rigidmc.physics.effects.damping import ViscousDamping
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.runs.simulate import simulate
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stress.case import Case, makes_steps, only
from rigidmc.studies.stress.motions import tops
from rigidmc.studies.stress.truths import refused

TITLE = "refused"

Refusal = tuple[Callable[[str], object], str, Callable[[str], bool]]  # call, text, claims


def scene(*effects: Any) -> Scene:
    body = Body.from_moments((1.0, 1.4, 2.0), centre=(0.0, 0.0, 1.0))
    start = Start(momentum=(1.0, 0.0, 0.0))
    one: Scene = Scene(body, effects, start).with_run(members=1, t_end=1.0)
    return one


def steps_backwards(name: str) -> bool:
    """Splittings of order above 2: they have steps backwards."""
    return INTEGRATORS[name].splitting and INTEGRATORS[name].order > 2


CALLS: dict[str, Refusal] = {
    "backward steps and damping": (
        lambda name: simulate(scene(Gravity(1.0), ViscousDamping(0.1)), integrator=name),
        "depends on L",
        steps_backwards,
    ),
    "a torque on free motion": (
        lambda name: simulate(scene(Gravity(1.0)), integrator=name),
        "takes no torque",
        only("exact"),
    ),
    "h = 0": (lambda name: simulate(scene(), integrator=name, dt=0.0), "dt", makes_steps),
    "a start that is no number": (
        lambda name: tops((1.0, 1.4, 2.0), (math.nan, 0.0, 0.0)),
        "finite",
        makes_steps,
    ),
    "the triangle inequality": (
        lambda name: Body.from_moments((1.0, 1.0, 2.1)),
        "triangle",
        makes_steps,
    ),
    "a moment of zero": (
        lambda name: Body.from_moments((0.0, 1.0, 1.0)),
        "positive",
        makes_steps,
    ),
    "a quaternion of norm 0": (
        lambda name: tops((1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
        "norm 0",
        makes_steps,
    ),
}


def cases() -> Iterator[Case]:
    for word, (call, rule, claims) in CALLS.items():
        yield Case(
            word,
            "must be refused with the reason, not run",
            "an error that says so",
            refused(call, rule),
            asked=0.0,
            claims=claims,
        )

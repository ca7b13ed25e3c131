"""Hard cases of numerics: groups H8, H9 and H12 to H15.

A group is a function with `@group` that yields its `HardCase`s.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.physics.effects.damping import ViscousDamping
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.runs.simulate import simulate
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stress.case import (
    Claim,
    Comparison,
    HardCase,
    claims_all,
    group,
    keeps_free_invariants,
    loses_free_invariants,
    makes_steps,
    only,
)
from rigidmc.studies.stress.motions import (
    direction,
    invariants,
    largest_change,
    lean_by,
    random_tops,
    tops,
    walk,
)
from rigidmc.studies.stress.problems import PROBLEMS
from rigidmc.studies.stress.truths import (
    against_end,
    against_turn,
    distance_in_units,
    distance_to_closed_form,
    is_refused,
    there_and_back,
)

MOMENTS, MOMENTUM = np.array((1.0, 1.4, 2.0)), np.array((0.3, 0.9, 0.7))
CENTRE = (0.1, 0.2, 0.3)
# moments [kg m2], momentum [kg m2/s], why
SCALED_BODIES = {
    "a molecule": (
        np.array((1.0, 1.9, 2.9)) * 1e-47,
        np.array((1.0, 2.0, -1.0)) * 1e-34,
        "water: moments 1e-47 kg m2, 1e13 rad/s",
    ),
    "a dust grain": (
        np.array((1.0, 1.4, 2.0)) * 1e-28,
        np.array((0.3, 0.9, 0.7)) * 1e-24,
        "a tenth of a micrometre: 1e-28 kg m2",
    ),
    "the Earth": (
        np.array((8.008, 8.010, 8.036)) * 1e37,
        np.array((1e27, 0.0, 5.86e33)),
        "8e37 kg m2, moments equal to 3e-4, almost on its axis",
    ),
}


@group("H8", "scale")
def scale() -> Iterator[HardCase]:
    """Yield very large and small numbers, other units, zeros, denormal numbers, backward steps."""
    yield from _sizes()
    yield from _zeros()
    yield from _backwards()
    yield from _units()


def _sizes() -> Iterator[HardCase]:
    for exponent in (-300, -150, 150, 300):
        size = 10.0**exponent
        yield HardCase(
            f"|L| = 1e{exponent}",
            "squares of the momentum overflow or vanish",
            distance_to_closed_form(tops(MOMENTS, MOMENTUM * size), 10.0 / size),
            quick=exponent == -300,
        )
    for word, (i, l, why) in SCALED_BODIES.items():
        end = 100.0 * float(np.min(i) / np.linalg.norm(l))
        error = distance_to_closed_form(tops(i, l), end)
        yield HardCase(word, why, error, quick=word == "a molecule")
    i, l, _ = SCALED_BODIES["a molecule"]
    end = 100.0 * float(np.min(i) / np.linalg.norm(l))
    yield HardCase(
        "a molecule in float32",
        "moments of 1e-47 kg m2 are 0 in single precision",
        distance_to_closed_form(tops(i, l), end, turn=0.05, dtype="float32"),
        claims=only("rk4", "exact", "strang", "rotations"),
    )


def _zeros() -> Iterator[HardCase]:
    signs = np.array([(a, 1.0, b) for a in (1.0, -1.0) for b in (1.0, -1.0)])
    yield HardCase(
        "1e-165 off the middle axis",
        "the squares that decide about which axis L circles are 0: if each step decided again, the"
        " body would flip",
        against_turn(tops((0.3, 1.0, 1.3), signs * (1e-165, 1.0, 1e-175)), 20.0, 1.0),
        quick=True,
    )
    yield HardCase(
        "at rest",
        "L = 0: formulas must not divide by |L|",
        largest_change(tops(MOMENTS, (0.0, 0.0, 0.0)), 10.0, direction),
        claims=claims_all,
        truth="L = 0 to the bit",
        asked=0.0,
    )
    body = Body.from_moments(tuple(MOMENTS), mass=1.0, centre=CENTRE)
    weightless = Scene(body, (Gravity(0.0),), Start(momentum=tuple(MOMENTUM)))
    yield HardCase(
        "g = 0",
        "gravity is compiled in but must change nothing",
        distance_to_closed_form(weightless, 10.0),
    )


def _backwards() -> Iterator[HardCase]:
    free = tops(tuple(MOMENTS), tuple(MOMENTUM))
    yield HardCase(
        "there and back",
        "the same steps with h < 0",
        there_and_back(free, 20.0),
        asked=1e-13,
        quick=True,
    )
    yield HardCase(
        "there and back, heavy",
        "the same steps with h < 0",
        there_and_back(_leaning_top(), 20.0),
        asked=1e-12,
    )
    half = math.sqrt(0.5)
    attitude = (0.0, -half, 1e-311, half)
    swinging = tops((0.3, 1.0, 1.3), (0.0, 0.0, 0.0), attitude, (0.0, 0.0, 1.0))
    yield HardCase(
        "a pendulum 1e-311 off its plane",
        "components of the attitude are denormal numbers",
        there_and_back(swinging, 20.0),
    )


def _units() -> Iterator[HardCase]:
    for power_of_two, word in ((True, "powers of 2"), (False, "powers of 10")):
        mass, length, time = (2.0**-90, 2.0**-30, 2.0**-20) if power_of_two else (1e-27, 1e-9, 1e-6)
        unit = mass * length**2
        centre = (0.1 * length, 0.2 * length, 0.3 * length)
        small = Scene(
            Body.from_moments(tuple(MOMENTS * unit), mass=mass, centre=centre),
            (Gravity(1.0 * length / time**2),),
            Start(momentum=tuple(MOMENTUM * unit / time), attitude=lean_by(1.0)),
        )
        yield HardCase(
            f"units by {word}",
            "mass, length and time in other units: a dust grain moves like a wheel",
            distance_in_units(_leaning_top(), small, 10.0, time, unit / time, power_of_two),
            asked=0.0 if power_of_two else 1e-12,
        )


def _leaning_top() -> Scene:
    return tops(tuple(MOMENTS), tuple(MOMENTUM), lean_by(1.0), CENTRE)


STEPS = 1_000_000


@group("H9", "very many steps")
def many_steps() -> Iterator[HardCase]:
    """Yield drifts of invariants over a million steps and more: growth of rounding errors."""
    scene = tops(*random_tops())
    yield HardCase(
        "free invariants, 1e6 steps",
        "rounding alone: a bias of 1e-17 per step would show",
        largest_change(scene, 0.1 * 1e6, invariants, saves=16, steps=STEPS),
        claims=keeps_free_invariants,
    )
    yield HardCase(
        "free invariants, 1e6 steps, compensated",
        "compensated sums remove the rounding of the state, but not that of the increments",
        largest_change(scene, 0.1 * 1e6, invariants, saves=16, steps=STEPS, compensated=True),
        claims=only("exact", "midpoint", "strang", "srkn6"),
    )
    yield HardCase(
        "rounding walks, it does not march",
        "32 tops over 1e6 steps: the rms drift grows as sqrt(n), not as n",
        walk(scene, 0.1, STEPS),
        asked=3.0,
        claims=only("exact", "midpoint", "strang"),
    )
    yield HardCase(
        "rounding over 1e7 steps",
        "ten times as long",
        walk(scene, 0.1, 10 * STEPS),
        asked=3.0,
        claims=only("exact"),
    )
    yield HardCase(
        "drift of Runge-Kutta methods, 1e6 steps",
        "1e6 steps of 0.02 rad: energy and |L|^2 drift as h^(order + 1) t",
        largest_change(scene, 0.02 * 1e6 / 3.0, invariants, saves=16, steps=STEPS),
        claims=loses_free_invariants,
    )


def _heavy_scene(*effects: Any) -> Scene:
    body = Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.0, 0.0, 1.0))
    start = Start(momentum=(1.0, 0.0, 0.0))
    return Scene(body, effects, start).with_run(members=1, t_end=1.0)


def _refused(
    name: str, call: Callable[[str], object], rule: str, claims: Claim = makes_steps
) -> HardCase:
    why = "must not run, but be refused with the reason"
    return HardCase(name, why, is_refused(call, rule, claims), asked=0.0)


@group("H12", "refused")
def refusals() -> Iterator[HardCase]:
    """Yield calls that must be refused with a reason."""
    yield _refused(
        "backward steps and damping",
        lambda name: simulate(_heavy_scene(Gravity(1.0), ViscousDamping(0.1)), integrator=name),
        "depends on L",
        # splittings of order above 2 have backward substeps
        lambda name: INTEGRATORS[name].is_splitting and INTEGRATORS[name].order > 2,
    )
    yield _refused(
        "a torque on free motion",
        lambda name: simulate(_heavy_scene(Gravity(1.0)), integrator=name),
        "takes no torque",
        only("exact"),
    )
    moments, spin = (1.0, 1.4, 2.0), (1.0, 0.0, 0.0)
    yield _refused("h = 0", lambda name: simulate(_heavy_scene(), name, dt=0.0), "dt")
    yield _refused(
        "a start that is not a number", lambda _: tops(moments, (math.nan, 0.0, 0.0)), "finite"
    )
    yield _refused(
        "the triangle inequality", lambda _: Body.from_moments((1.0, 1.0, 2.1)), "triangle"
    )
    yield _refused("a moment of zero", lambda _: Body.from_moments((0.0, 1.0, 1.0)), "positive")
    yield _refused("a quaternion of norm 0", lambda _: tops(moments, spin, (0.0,) * 4), "nonzero")


def _error_of_small_angles(integrator: str, share: float) -> float:
    """Return the largest error of the angle between q and q rotated by 0.1 to 1e-15 rad, with
    either sign."""
    q, angles = np.array((0.1, -0.5, 0.7, 0.5)), 10.0 ** -np.arange(1.0, 16.0)
    q /= np.linalg.norm(q)
    half = [(math.cos(0.5 * a), 0.0, math.sin(0.5 * a), 0.0) for a in angles]
    rotated = np.array([multiply(tuple(q), step) for step in half])
    measured = attitude_error(np.concatenate([rotated, -rotated]), q)
    return float(np.abs(measured - np.tile(angles, 2)).max())


@group("H13", "attitude errors")
def attitude_errors() -> Iterator[HardCase]:
    """Yield the test of the attitude error itself, at very small angles."""
    yield HardCase(
        "angles of 0.1 to 1e-15 rad",
        "2 arccos |p.q| is 0 for all angles below 1e-8; q and -q are the same attitude",
        Comparison(_error_of_small_angles, "the angle of the rotation"),
        asked=1e-15,
        claims=only("exact"),
        quick=True,
    )


@group("H14", "damping")
def damping_cases() -> Iterator[HardCase]:
    """Yield damped free bodies, whose closed form is the undamped motion at another time."""
    slow = tops((1.0, 1.4, 2.0), (0.3, 0.9, 0.7), damping=0.2)
    yield HardCase(
        "damped asymmetric body",
        "L' = L x omega - rate L: every integrator must apply the damping correctly within a step",
        distance_to_closed_form(slow, 20.0),
        truth="closed form at another time",
    )
    fast = tops((1.0, 1.4, 2.0), (3.0, 9.0, 7.0), damping=5.0)
    yield HardCase(
        "to rest in 30 e-foldings",
        "the step is short compared to the first spin and long compared to the last",
        distance_to_closed_form(fast, 6.0),
        truth="closed form at another time",
    )


@group("H15", "published ends")
def published_cases() -> Iterator[HardCase]:
    """Yield published ends of named problems, see `rigidmc.studies.stress.problems`."""
    for word in ("nasa_brick", "toms903_step", "hairer_free", "hairer_heavy", "cardona_top"):
        problem = PROBLEMS[word]
        yield HardCase(
            word.replace("_", " "),
            "a published result, with 34 digits where sources agree",
            against_end(problem),
            quick=word in ("hairer_heavy", "nasa_brick"),
        )

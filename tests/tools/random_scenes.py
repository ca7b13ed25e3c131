"""Random scenes, a function of a number.

Every law, effect, repeated effect, sign, option and integrator occurs. A Kind is what is compiled;
its scenes differ in numbers, laws and options.
"""

import math
from typing import Any, NamedTuple

import numpy as np

import rigidmc as rm
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import EFFECTS, name_of
from rigidmc.physics.effects.protocol import facts, from_numbers, numbers, user_parameters
from rigidmc.physics.integrators import INTEGRATORS, integrators_for
from tests.physics.effects.laws import REFERENCE
from tests.physics.effects.test_effects import EXAMPLES

END = 2.0
# steps of at most 0.1 rad, by order; few bodies turn by more than 10 rad
STEPS = {1: 800, 2: 400, 4: 120, 6: 40, 8: 40, 12: 40, math.inf: 8}
DAMPING = tuple(name for name, kind in EFFECTS.items() if facts(kind).is_damping)


class Kind(NamedTuple):
    """integrator, names of effects, whether members have steps of their own, compensated, dtype"""

    integrator: str
    effects: tuple = ()
    turn: bool = False
    compensated: bool = False
    dtype: str = "float64"


# for the quick tests: each compiles a kernel; closed forms and the choices of a tolerance compile
# none that others do not
QUICK = (
    Kind("closed", ("gravity", "gravity")),
    Kind("closed", ("viscous_damping", "viscous_damping")),
    Kind("closed"),
    Kind("rk8", ("gravity", "gravity", "viscous_damping")),
    Kind(  # by rk8 its steps take 3 s more to compile
        "rk4", ("gravity_gradient", "rotating_field", "matrix_damping", "dry_friction"), turn=True
    ),
    Kind("strang", ("spring", "rotor", "axial_damping", "energy_dissipation")),
    Kind("srkn11", ("uniform_field", "potential", "moving_pivot")),
    Kind(
        "cf4",
        ("body_torque", "space_torque", "periodic_torque", "quadratic_drag"),
        compensated=True,
    ),
    Kind("exact", turn=True),
    Kind("chin4", ("gravity", "space_torque"), dtype="float32"),
)


def kinds(count, seed=0):
    """Kinds of any integrator with none to three effects that it takes, perhaps one twice."""
    some, found = np.random.default_rng(seed), []
    every = [name for name in EFFECTS if name in REFERENCE]
    while len(found) < count:
        names = tuple(sorted(some.choice(every, some.integers(0, 4)), key=list(EFFECTS).index))
        if names and some.random() < 0.3:
            names += names[:1]
        compensated = bool(some.random() < 0.2)
        able = integrators_for(tuple(EXAMPLES[name] for name in names), compensated)
        turn, single = some.random() < 0.3, some.random() < 0.15 and not compensated
        name = str(some.choice(able))
        found.append(
            Kind(
                name,
                names,
                bool(turn) and name != "closed",
                compensated and name != "closed",
                "float32" if single and name != "closed" else "float64",
            )
        )
    return found


def scene(kind, seed, members=2):
    """A scene of a Kind; a function of the seed."""
    some = np.random.default_rng([seed, 7])
    body, arrays = _body(kind, some), bool(some.random() < 0.2)
    effects = tuple(_effect(name, some, kind.integrator) for name in kind.effects)
    # for laws of energy, and attitudes by them, the energies in play are those of conserving
    # effects
    start = _start(some, effects, members if arrays else None)
    order = INTEGRATORS[kind.integrator].order
    steps = STEPS[order]
    step: dict[str, Any] = {"turn": 10.0 / steps} if kind.turn else {"dt": END / steps}
    drawn = (
        start.attitude == "uniform"
        or hasattr(start.attitude, "_fields")
        or start.momentum is not None
    )
    points = (
        str(some.choice(("independent", "sobol", "latin_hypercube", "antithetic")))
        if drawn and start.attitude != "ensemble"
        else "independent"
    )
    run = rm.Run(
        integrator=kind.integrator, t_end=END, members=members, seed=int(some.integers(2**31)),
        anti_damping=True, save=("omega", "attitude"),
        compensated=kind.compensated, dtype=kind.dtype, points=points,
        strata=1024 if points == "latin_hypercube" else None, **step,
    )  # fmt: skip
    return rm.Scene(body, effects, start, run)


def covered(scene):
    """Whether a closed form covers a scene."""
    names = {name_of(e) for e in scene.effects}
    return names <= {"gravity"} or names <= {"viscous_damping"}


def finer(scene):
    """The same scene with half the step."""
    run = scene.run
    return scene.with_run(turn=0.5 * run.turn) if run.turn else scene.with_run(dt=0.5 * run.dt)


def _law(some, middle, width):
    """A number, or a law of numbers about `middle` with a width of about `width`."""
    choice = some.integers(5)
    if choice == 0:
        return rm.normal(middle, width)
    if choice == 1:
        return rm.uniform(middle - width, middle + width)
    if choice == 2:
        return rm.distribution("beta", a=2.0, b=3.0, loc=middle - width, scale=2.0 * width)
    if choice == 3:
        return rm.grid(middle - width, middle + width, 5)
    return middle


def _body(kind, some):
    if (
        kind.integrator == "closed" and "gravity" in kind.effects
    ):  # a Lagrange top, its axis any of the three
        one, axis = some.uniform(0.8, 1.5), int(some.integers(3))
        moments, centre = [one] * 3, [0.0] * 3
        moments[axis], centre[axis] = one * some.uniform(0.3, 1.7), some.uniform(-0.3, 0.3)
        return rm.Body.from_moments(tuple(moments), _law(some, 1.0, 0.1), tuple(centre))
    second = tuple(float(x) for x in some.uniform(0.3, 0.9, 3))
    moments = second[1] + second[2], second[2] + second[0], second[0] + second[1]
    if some.random() < 0.4:
        moments = rm.SecondMoments(tuple(_law(some, x, 0.1 * x) for x in second))
    return rm.Body.from_moments(
        moments,
        _law(some, 1.0, 0.1),
        # on an orbit a body turns about its centre of mass
        tuple(_law(some, x, 0.05) for x in some.uniform(-0.3, 0.3, 3))
        if "gravity_gradient" not in kind.effects
        else (0.0, 0.0, 0.0),
    )


def _effect(name, some, integrator):
    example = EXAMPLES[name]
    if name == "gravity":
        return rm.Gravity(_law(some, float(some.choice((-5.0, 3.0, 9.81))), 0.5))
    if name == "matrix_damping":  # any other number may drive a spin
        return example
    factor = float(some.uniform(0.5, 1.2)) * (
        -1.0 if name in DAMPING and some.random() < 0.3 else 1.0
    )
    kept = {
        "gravity_gradient": ("eccentricity", "distance"),
        "dry_friction": ("rest",),
        "spring": ("stiffness", "length"),
    }.get(name, ())
    places = [field in kept for field, _, _ in numbers(example)]
    values = [v * abs(factor) if still else _law(some, v * factor,
        0.05 * abs(v) + 1e-3) if field in user_parameters(example) else v
              for (field, _, v), still in zip(numbers(example), places, strict=True)]  # fmt: skip
    return from_numbers(type(example), values)


def _start(some, effects, rows):
    attitude: Any = (
        "uniform",
        (1.0, 0.0, 0.0, 0.0),
        (0.3, 0.7, -0.4),
        rm.Fisher((0.5, 0.5, -0.5, 0.5), 3.0),
        rm.Pointing((0.1, 0.2, 1.0), 4.0),
    )[some.integers(5)]
    if rows is not None:
        return rm.Start(omega=some.normal(size=(rows, 3)) * 1.5, attitude=attitude)
    choice, bounded = some.integers(7), all(implements(e, "energy") for e in effects)
    size = float(some.uniform(0.5, 2.0))
    if choice == 0:
        return rm.Start(
            omega=tuple(_law(some, x, 0.2) for x in some.normal(size=3)), attitude=attitude
        )
    if choice == 1:
        return rm.Start(
            omega=rm.Cone(int(some.choice((1, 2, 3, -1, -2, -3))), _law(some, size, 0.1), 0.3),
            attitude=attitude,
        )
    if choice == 2:
        return rm.Start(omega=rm.Sphere(size), attitude=attitude)
    if choice == 3:
        return rm.Start(momentum=rm.Sphere(size), attitude=attitude)
    if choice == 4:
        root = some.normal(size=(3, 3))
        return rm.Start(
            momentum=rm.Correlated(
                tuple(some.normal(size=3)), root @ root.T * 0.1 + 0.05 * np.eye(3)
            ),
            attitude=attitude,
        )
    if choice == 5:
        warm = bool(some.random() < 0.5) and bounded and bool(effects)
        return rm.Start(
            momentum=rm.GibbsMomentum(20.0 if warm else size),
            attitude="ensemble" if warm else attitude,
        )
    return (
        rm.Start(momentum=rm.Shell(60.0 if effects else size), attitude=attitude)
        if bounded
        else rm.Start(momentum=rm.GibbsMomentum(size))
    )

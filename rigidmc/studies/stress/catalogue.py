"""The catalogue of hard cases, group by group."""

import math

import numpy as np

from rigidmc.dynamics.so3 import multiply, up
from rigidmc.effects import Gravity, ViscousDamping
from rigidmc.integrators import INTEGRATORS
from rigidmc.mechanics.rotation import attitude_error, from_euler, matrix, omega_from_euler_rates
from rigidmc.runs.simulate import simulate
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.problems import HARD, PROBLEMS
from rigidmc.studies.stress.case import (
    Case,
    against_closed,
    against_end,
    against_turn,
    conserved,
    constant,
    direction,
    distance,
    flagged_or_close,
    flips,
    refused,
    run,
    same_bits,
    scaled_alike,
    there_and_back,
    tops,
    walk,
    worst,
)

GROUPS = {
    "H1": "principal axes", "H2": "Dzhanibekov", "H3": "separatrix", "H4": "symmetric limits", "H5": "plates and needles", "H6": "fast spin",
    "H7": "heavy symmetric tops", "H8": "scale", "H9": "very many steps", "H10": "integrable and steady heavy tops", "H11": "chaos",
    "H12": "refused", "H13": "attitude errors", "H14": "damping", "H15": "published ends",
}  # fmt: skip
GRAVITY = (Gravity(1.0),)
UPRIGHT, HANGING = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)


def leaning(theta):
    """The attitude whose third axis leans by theta from the vertical."""
    return math.cos(0.5 * theta), math.sin(0.5 * theta), 0.0, 0.0


def steps_made(name):
    """Integrators that make steps."""
    return name != "closed"


def keeps_free_invariants(name):
    """Those that keep energy and |L|^2 of a free body to rounding."""
    return steps_made(name) and {"T", "|L|^2"} <= set(INTEGRATORS[name].conserves)


def sharp(bound):
    """A bound that is asked of methods of order 6 and more."""
    return lambda name: bound if INTEGRATORS[name].order >= 6 else None


def drifting(name):
    """Those that do not."""
    return steps_made(name) and not keeps_free_invariants(name)


def some_tops(count=32, seed=1):
    """(moments, momenta) of random bodies, one row for each, all of unit size and spin."""
    some = np.random.default_rng(seed)
    second = some.uniform(0.1, 1.0, (count, 3))
    moments = (second.sum(1, keepdims=True) - second) / second.sum(1, keepdims=True)
    momentum = some.normal(size=(count, 3))
    return moments, momentum / np.linalg.norm(momentum, axis=1, keepdims=True) * 0.5


def principal_axes():
    """H1."""
    bodies = {
        "generic": (1.0, 2.0, 2.5), "needle": (1e-6, 1.0, 1.0000005), "nearly symmetric": (1.0, 1.0 + 1e-12, 2.0), "flat plate": (1.0, 2.0, 3.0),
    }  # fmt: skip
    for word, moments in bodies.items():
        spins = np.array([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
        scene, steps = (
            tops(np.tile(moments, (6, 1)), spins),
            1_000_000 if word == "generic" else 100_000,
        )
        end = steps * 0.05 / (1.0 / min(moments))
        yield Case(
            "H1", f"axis spins of a {word} body", f"spin about each axis, both ways, also the unstable one, for {steps:,} steps: any rounding across it would grow",
            "L stands still in the body", constant(scene, end, direction, steps=steps), 1e-15, claims=steps_made, quick=word == "needle",
        )  # fmt: skip
    heavy = tops((1.0, 1.0, 0.7), (0.0, 0.0, 3.0), UPRIGHT, (0.0, 0.0, 1.3))
    yield Case(
        "H1", "sleeping top, 1e5 steps", "fast and exactly upright: gravity's torque must vanish to the bit, whatever the attitude about the vertical",
        "L and the vertical stand still in the body", constant(heavy, 1e3, direction, steps=100_000), None, GRAVITY, steps_made,
    )  # fmt: skip


def dzhanibekov():
    """H2."""
    for eps in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13, 1e-15):
        yield Case(
            "H2", f"first flip, eps = {eps:g}", f"the time of the first flip from a disturbance of {eps:g}, which grows by as much: an absolute error of 1e-16 would be {1e-16 / eps:.0e} of it",
            "K(m)/lambda, Jacobi", flips((1.0, 2.0, 3.0), (eps, 2.0, 0.0), 1), sharp(1e-10), quick=eps in (1e-4, 1e-13),
        )  # fmt: skip
    for eps in (1e-2, 1e-3, 1e-4):
        yield Case(
            "H2", f"ten flips, eps = {eps:g}", "each passage by the unstable axis comes down from components of size 1: rounding of 1e-16 is 1e-16/eps^2 of the modulus, and of the time",
            "(2 k + 1) K(m)/lambda, Jacobi", flips((1.0, 2.0, 3.0), (eps, 2.0, 0.0), 10), None,
        )  # fmt: skip
    scene, interval = tops((1.0, 2.0, 3.0), (1e-4, 2.0, 0.0)), 36.707819410833642463
    yield Case(
        "H2", "invariants over 1e3 flips", "4e4 s by the unstable axis a thousand times: energy and |L|^2 must not follow the flips",
        "invariants", constant(scene, 1e3 * interval, conserved, saves=100, steps=600_000), None, claims=steps_made,
    )  # fmt: skip


def separatrix():
    """H3."""
    for word in ("separatrix", "separatrix_below", "separatrix_above", "near_middle_axis_13"):
        moments, momentum = HARD[word]
        yield Case(
            "H3", word.replace("_", " "), "the modulus is 1 to rounding, where formulas by m, K(m) and inverse sines lose all digits; errors grow by exp(0.6 t)",
            "closed form", against_closed(tops(moments, momentum), 12.0), None, quick=word == "separatrix",
        )  # fmt: skip
    near = tops((1.0, 2.0, 3.0), (1.0 - 1e-15, 1.0, math.sqrt(3.0)))
    yield Case("H3", "invariants on the separatrix", "1e5 steps along it and back by the middle axis, wherever rounding takes them", "invariants", constant(near, 1e4, conserved, steps=100_000), None, claims=steps_made)  # fmt: skip


def symmetric_limits():
    """H4."""
    bodies = {
        "sphere": (1.0, 1.0, 1.0),
        "oblate": (1.0, 1.0, 2.0),
        "prolate": (1.0, 2.0, 2.0),
        "symmetric about 2": (1.0, 0.6, 1.0),
    }
    for word, moments in bodies.items():
        yield Case(
            "H4", word, "two equal moments: a coefficient of Euler's equations vanishes, and with it what formulas divide by", "closed form",
            against_closed(tops(moments, (0.3, 0.2, 0.1)), 50.0), None,
        )  # fmt: skip
    for split in (1e-4, 1e-8, 1e-12, 1e-15):
        for word, moments in (
            ("I1 = I2", (1.0, 1.0 + split, 2.0)),
            ("I2 = I3", (1.0, 2.0, 2.0 * (1.0 + split))),
        ):
            yield Case(
                "H4", f"{word} to {split:g}", "between the two regimes: neither may jump where the other begins", "closed form",
                against_closed(tops(moments, (0.3, 0.2, 0.1)), 50.0), None,
            )  # fmt: skip
    splits = (0.0, 1e-15, 3e-15, 1e-14)
    for word, at in (("I1 = I2", 1), ("I2 = I3", 2)):
        base = (1.0, 1.0, 2.0) if at == 1 else (1.0, 2.0, 2.0)
        rows = np.array([[x * (1.0 + s * (i == at)) for i, x in enumerate(base)] for s in splits])
        yield Case(
            "H4", f"continuous across {word}", "bodies that differ by a rounding must move alike: a formula that switches at equality shows here",
            "the symmetric body", constant_over_members(tops(rows, (0.3, 0.2, 0.1)), 20.0), 1e-12, claims=steps_made,
        )  # fmt: skip


def constant_over_members(scene, t_end):
    """Largest difference of members from the first."""

    def error(integrator, share):
        ds = run(scene, integrator, t_end, 4)
        q, l = ds.attitude.values, ds.momentum.values
        return worst(
            ds,
            distance(
                q, l, np.repeat(q[..., :1], q.shape[-1], -1), np.repeat(l[..., :1], l.shape[-1], -1)
            ).max(0),
        )

    return error


def plates_and_needles():
    """H5."""
    why = {
        "flat_plate": "I3 = I1 + I2 to rounding, the edge of what a body may be", "flat_disc": "flat and symmetric at once",
        "needle": "moments 1e6 apart: a step is short for one axis and long for the others", "needle_on_edge": "spin across a needle, 1e-7 along it",
        "rod": "moments 1e9 apart",
    }  # fmt: skip
    for word, text in why.items():
        moments, momentum = HARD[word]
        yield Case("H5", word.replace("_", " "), text, "closed form", against_closed(tops(moments, momentum), 10.0), None, quick=word == "needle")  # fmt: skip


def fast_spin():
    """H6."""
    too_long = {
        name: "1 rad is too long a step for it: one digit is left after 32 turns"
        for name in ("rk4", "rkmk4", "cf4", "rotations")
    }
    too_long["midpoint"] = "of order 2: 0.1 rad is too long a step for it over 32 turns"
    for angle in (0.1, 1.0, 3.0):
        scene = tops((1.0, 1.4, 2.0), (3.0, 0.2, 1.0))
        yield Case(
            "H6", f"|omega| h = {angle:g}", "a step as long as a turn: aliased motion looks like slow motion, so it must be right or flagged", "closed form, or a flag",
            flagged_or_close(scene, 200.0 / 3.05, steps=max(8, round(200.0 / angle))), 0.5,
            weak={name: why for name, why in too_long.items() if angle == (0.1 if name == "midpoint" else 1.0)},
        )  # fmt: skip


def heavy_tops():
    """H7."""
    a, c, k = 1.0, 0.7, 1.3
    moments, weight, rate = (a, a, c), (0.0, 0.0, k), math.sqrt(k / a)
    critical = 2.0 * math.sqrt(a * k)
    turning = np.array(moments) * omega_from_euler_rates(
        (0.0, math.pi / 3, 0.0),
        (2 * rate / math.sqrt(3), 0.0, (3 * a - c) * rate / (c * math.sqrt(3))),
    )
    starts = {
        "inverted, at rest": (UPRIGHT, (0.0, 0.0, 0.0), "an unstable equilibrium: any rounding falls"),
        "hanging, at rest": (HANGING, (0.0, 0.0, 0.0), "an equilibrium where |L| = 0: nothing may be divided by it"),
        "sleeping, just stable": (leaning(1e-3), (0.0, 0.0, critical * math.sqrt(1.001)), "C^2 n^2 = 4 A k (1 + 1e-3), leaning by 1e-3: it nutates slowly and far"),
        "sleeping, just unstable": (leaning(1e-3), (0.0, 0.0, critical * math.sqrt(0.999)), "C^2 n^2 = 4 A k (1 - 1e-3), leaning by 1e-3"),
        "homoclinic": (tuple(from_euler((0.0, math.pi / 3, 0.0))), tuple(turning), "it takes for ever to reach the vertical; errors grow as the inverse of its approach"),
        "cusps": (leaning(0.9), (0.0, 0.0, 3.0), "the axis stops at every turn"),
        "loops": (leaning(0.9), (0.0, -0.35, 3.0), "the precession reverses"),
        "through the vertical": (leaning(1.0), (5.0, 0.0, 0.0), "Euler angles are singular there"),
        "close by the vertical": (leaning(1.0), (5.0, 1e-9, 1e-9), "Euler angles turn by pi within 1e-9 s"),
        "pendulum from inverted": (leaning(1e-6), (0.0, 0.0, 0.0), "it falls from 1e-6 of the unstable equilibrium, and comes back to it"),
        "fast": (leaning(1.0), (0.0, 0.0, 100.0), "a thousand turns for one nutation"),
    }  # fmt: skip
    for word, (attitude, momentum, why) in starts.items():
        scene = tops(moments, momentum, attitude, weight)
        yield Case("H7", word, why, "closed form", against_closed(scene, 4.0 if word == "fast" else 12.0), None, GRAVITY)  # fmt: skip
    rest = tops(np.tile(moments, (2, 1)), np.zeros((2, 3)), np.array([UPRIGHT, HANGING]), weight)
    yield Case("H7", "equilibria stay, 1e5 steps", "torques of 1e-17 would make the upright one fall within 30 s", "L = 0 stays to the bit", constant(rest, 1e3, direction, steps=100_000), 1e-15, GRAVITY, steps_made)  # fmt: skip
    mixed = tops((1.0, 1.0, 0.7), (0.4, 0.3, 2.0), leaning(0.8), weight)
    yield Case("H7", "energy and L_z, 1e5 steps", "a thousand nutations: a splitting's energy error must stay bounded, L_z to rounding", "invariants", constant(mixed, 5e3, conserved, saves=50, steps=100_000), None, GRAVITY, steps_made)  # fmt: skip


def scale():
    """H8."""
    moments, momentum = np.array((1.0, 1.4, 2.0)), np.array((0.3, 0.9, 0.7))
    for exponent in (-300, -150, 150, 300):
        size = 10.0**exponent
        yield Case("H8", f"|L| = 1e{exponent}", "squares of the momentum leave the range of numbers", "closed form", against_closed(tops(moments, momentum * size), 10.0 / size), None, quick=exponent == -300)  # fmt: skip
    real = {
        "a molecule": (np.array((1.0, 1.9, 2.9)) * 1e-47, np.array((1.0, 2.0, -1.0)) * 1e-34, "water: moments 1e-47 kg m2, 1e13 rad/s"),
        "a dust grain": (np.array((1.0, 1.4, 2.0)) * 1e-28, np.array((0.3, 0.9, 0.7)) * 1e-24, "a tenth of a micrometre: 1e-28 kg m2"),
        "the Earth": (np.array((8.008, 8.010, 8.036)) * 1e37, np.array((1e27, 0.0, 5.86e33)), "8e37 kg m2, moments equal to 3e-4, almost on its axis"),
    }  # fmt: skip
    for word, (i, l, why) in real.items():
        yield Case("H8", word, why, "closed form", against_closed(tops(i, l), 100.0 * float(np.min(i) / np.linalg.norm(l))), None, quick=word == "a molecule")  # fmt: skip
    i, l, _ = real["a molecule"]
    single = against_closed(
        tops(i, l), 100.0 * float(np.min(i) / np.linalg.norm(l)), turn=0.05, dtype="float32"
    )
    yield Case("H8", "a molecule in float32", "moments of 1e-47 are 0 in single precision", "closed form", single, None, claims=lambda name: name in ("rk4", "exact", "strang", "rotations"))  # fmt: skip
    signs = np.array([(a, 1.0, b) for a in (1.0, -1.0) for b in (1.0, -1.0)])
    yield Case("H8", "1e-165 off the middle axis", "squares of what decides about which axis L circles are 0; taken anew at each end of a step, its side turned the body over", "a plain turn", against_turn(tops((0.3, 1.0, 1.3), signs * (1e-165, 1.0, 1e-175)), 20.0, 1.0), None, quick=True)  # fmt: skip
    yield Case("H8", "at rest", "L = 0: nothing may be divided by it", "L = 0 stays to the bit", constant(tops(moments, (0.0, 0.0, 0.0)), 10.0, direction), 0.0)  # fmt: skip
    none = Scene(
        Body.from_moments(tuple(moments), centre=(0.1, 0.2, 0.3)),
        (Gravity(0.0),),
        Start(momentum=tuple(momentum)),
    )
    yield Case("H8", "g = 0", "gravity is compiled, and must change nothing", "closed form", against_closed(none, 10.0), None, GRAVITY)  # fmt: skip
    heavy = tops(tuple(moments), tuple(momentum), leaning(1.0), (0.1, 0.2, 0.3))
    reversible = lambda name: INTEGRATORS[name].reversible and steps_made(name)  # noqa: E731
    yield Case("H8", "there and back", "the same steps with h < 0", "its own start", there_and_back(tops(tuple(moments), tuple(momentum)), 20.0), 1e-13, claims=reversible, quick=True)  # fmt: skip
    yield Case("H8", "there and back, heavy", "the same steps with h < 0", "its own start", there_and_back(heavy, 20.0), 1e-12, GRAVITY, reversible)  # fmt: skip
    swinging = tops(
        (0.3, 1.0, 1.3),
        (0.0, 0.0, 0.0),
        (0.0, -math.sqrt(0.5), 1e-311, math.sqrt(0.5)),
        (0.0, 0.0, 1.0),
    )
    yield Case("H8", "a pendulum 1e-311 off its plane", "parts of the attitude that are denormal numbers", "its own start", there_and_back(swinging, 20.0), None, GRAVITY, reversible)  # fmt: skip
    for power, word in ((True, "powers of 2"), (False, "powers of 10")):
        mass, length, time = (2.0**-90, 2.0**-30, 2.0**-20) if power else (1e-27, 1e-9, 1e-6)
        unit = mass * length**2
        small = Scene(
            Body.from_moments(tuple(moments * unit), mass=mass, centre=(0.1 * length, 0.2 * length, 0.3 * length)), (Gravity(1.0 * length / time**2),),
            Start(momentum=tuple(momentum * unit / time), attitude=leaning(1.0)),
        )  # fmt: skip
        yield Case("H8", f"units by {word}", "mass, length and time in other units: a dust grain moves as a wheel does", "itself", scaled_alike(heavy, small, 10.0, time, unit / time, power), 0.0 if power else 1e-12, GRAVITY, steps_made)  # fmt: skip


def many_steps():
    """H9."""
    moments, momentum = some_tops()
    scene = tops(moments, momentum)
    yield Case("H9", "free invariants, 1e6 steps", "rounding alone: a bias of 1e-17 a step would show", "invariants", constant(scene, 0.1 * 1e6, conserved, saves=16, steps=1_000_000), None, claims=keeps_free_invariants)  # fmt: skip
    yield Case("H9", "free invariants, 1e6 steps, compensated", "with the remainders of all sums kept, rounding of the state is gone, that of the increments is left", "invariants", constant(scene, 0.1 * 1e6, conserved, saves=16, steps=1_000_000, compensated=True), None, claims=lambda name: name in ("exact", "midpoint", "strang", "srkn6"))  # fmt: skip
    yield Case("H9", "rounding walks, it does not march", "32 tops over 1e6 steps: the rms drift grows as sqrt(n), not as n", "random walk", walk(scene, 0.1, 1_000_000), 3.0, claims=lambda name: name in ("exact", "midpoint", "strang"))  # fmt: skip
    yield Case("H9", "rounding over 1e7 steps", "ten times as long", "random walk", walk(scene, 0.1, 10_000_000), 3.0, claims=lambda name: name == "exact")  # fmt: skip
    yield Case("H9", "drift of Runge-Kutta methods, 1e6 steps", "1e6 steps of 0.02 rad: energy and |L|^2 drift as h^order t", "invariants", constant(scene, 0.02 * 1e6 / 3.0, conserved, saves=16, steps=1_000_000), None, claims=drifting)  # fmt: skip


def steady_heavy_tops():
    """H10."""
    c = 1.0
    lean = tuple(from_euler((0.3, 1.1, 0.4)))
    kovalevskaya = tops((2.0 * c, 2.0 * c, c), (0.5, 1.3, 0.7), lean, (1.0, 0.0, 0.0))

    def kovalevskaya_constant(body, effects, q, l):
        u, p, s = up(q), l[0] * body.i1, l[1] * body.i2
        real, imaginary = (
            p * p - s * s - body.p1 * body.i3 * u[0],
            2 * p * s - body.p1 * body.i3 * u[1],
        )
        value = real * real + imaginary * imaginary
        return [*conserved(body, effects, q, l), (value, np.abs(value[0]))]

    yield Case("H10", "Kovalevskaya's constant", "|(w1 + i w2)^2 - (k/C)(u1 + i u2)|^2, of degree 4: no method keeps it by construction", "invariant (Kovalevskaya 1889)", constant(kovalevskaya, 40.0, kovalevskaya_constant), None, GRAVITY, steps_made, quick=True)  # fmt: skip
    leans = tuple(from_euler((0.2, 1.0, 0.6)))
    u = np.array(up(leans))
    flat = np.array((1.6, 0.9, 0.5))
    flat = flat - np.dot(flat, u) * u  # L_z = 0
    goryachev = tops((4.0 * c, 4.0 * c, c), tuple(flat), leans, (1.0, 0.0, 0.0))

    def goryachev_constant(body, effects, q, l):
        u = up(q)
        value = l[2] * (l[0] * l[0] + l[1] * l[1]) - 4.0 * body.p1 / body.i3 * l[0] * u[2]
        return [*conserved(body, effects, q, l), (value, np.maximum(np.abs(value[0]), 1.0))]

    yield Case("H10", "Goryachev-Chaplygin's constant", "kept only while L_z = 0: a drift of L_z destroys it", "invariant (Goryachev 1900)", constant(goryachev, 40.0, goryachev_constant), None, GRAVITY, steps_made)  # fmt: skip
    i, vertical, spin = np.array((1.0, 1.4, 2.0)), np.array((0.2, 0.3, 1.0)), 2.0
    vertical /= np.linalg.norm(vertical)
    weight = spin**2 * i * vertical - 2.0 * vertical
    axis = np.cross(vertical, (0.0, 0.0, 1.0))
    angle = math.acos(vertical[2])
    q = np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axis / np.linalg.norm(axis))])
    staude = tops(tuple(i), tuple(spin * i * vertical), tuple(q), tuple(weight))
    yield Case("H10", "Staude's permanent rotation", "an asymmetric top spins steadily about the vertical through no principal axis: two large torques cancel", "L and the vertical stand still in the body (Staude 1894)", constant(staude, 3.0, direction), None, GRAVITY, steps_made)  # fmt: skip
    yield Case("H10", "Grioli's regular precession", "an asymmetric top precesses evenly about a leaning axis", "closed form (Grioli 1947)", grioli(), None, GRAVITY, steps_made, quick=True)  # fmt: skip


def grioli():
    """Error of L and of the vertical in the body against Grioli's precession of the moments 1, 1.4, 2."""
    a, b, c, k = 1.0, 1.4, 2.0, 1.0
    e = np.array((math.sqrt((b - a) / (c - a)), 0.0, math.sqrt((c - b) / (c - a))))
    j, d = a + c - b, e[0] * e[2] * (a - c)
    nu = math.sqrt(k / math.hypot(j, d))
    alpha, beta = nu**2 * j / k, -(nu**2) * d / k
    x1, x2 = np.array((e[2], 0.0, -e[0])), np.array((0.0, 1.0, 0.0))

    def motion(t):
        p = -nu * t
        omega = nu * (np.cos(p) * x1[:, None] + np.sin(p) * x2[:, None] + e[:, None])
        up = (alpha * np.cos(p) + beta * np.sin(p) ** 2) * x1[:, None] + (
            alpha * np.sin(p) - beta * np.sin(p) * np.cos(p)
        ) * x2[:, None]
        return np.array((a, b, c))[:, None] * omega, up + beta * np.cos(p) * e[:, None]

    l, u = (x[:, 0] for x in motion(np.zeros(1)))
    axis = np.cross(u, (0.0, 0.0, 1.0))
    angle = math.atan2(np.linalg.norm(axis), u[2])
    q = np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axis / np.linalg.norm(axis))])
    scene = tops((a, b, c), tuple(l), tuple(q), tuple(k * e))

    def error(integrator, share):
        ds = run(scene, integrator, 20.0)
        true_l, true_u = motion(ds.time.values)
        off = np.linalg.norm(ds.momentum.values[..., 0].T - true_l, axis=0) / np.linalg.norm(
            true_l, axis=0
        )
        lean = np.linalg.norm(matrix(ds.attitude.values[..., 0])[:, 2].T - true_u, axis=0)
        return worst(ds, np.array([np.maximum(off, lean).max()]))

    return error


def chaos():
    """H11."""
    moments, momentum = some_tops(64, 2)
    some = np.random.default_rng(3)
    q = some.normal(size=(64, 4))
    heavy = tops(
        moments,
        momentum,
        q / np.linalg.norm(q, axis=1, keepdims=True),
        some.normal(0.0, 0.3, (64, 3)),
    )
    yield Case("H11", "same bits in any blocks, heavy", "errors grow exponentially: one bit would be seen", "itself", same_bits(heavy, 20.0), 0.0, GRAVITY, steps_made, quick=True)  # fmt: skip
    yield Case("H11", "same bits in any blocks, by the separatrix", "errors grow exponentially: one bit would be seen", "itself", same_bits(tops(np.tile((1.0, 2.0, 3.0), (64, 1)), np.array([(1e-9, 2.0, 1e-9 * i) for i in range(64)])), 40.0), 0.0, claims=steps_made)  # fmt: skip
    yield Case("H11", "energy and L_z of 64 chaotic tops", "positions are lost, invariants must not be", "invariants", constant(heavy, 100.0, conserved), None, GRAVITY, steps_made)  # fmt: skip


def refusals():
    """H12."""
    body, start = (
        Body.from_moments((1.0, 1.4, 2.0), centre=(0.0, 0.0, 1.0)),
        Start(momentum=(1.0, 0.0, 0.0)),
    )

    def scene(*effects):
        return Scene(body, effects, start).with_run(members=1, t_end=1.0)

    damped = lambda name: INTEGRATORS[name].order > 2 and INTEGRATORS[name].splitting  # noqa: E731
    calls = {
        "backward steps and damping": (lambda name: simulate(scene(Gravity(1.0), ViscousDamping(0.1)), integrator=name), "depends on L", damped),
        "a torque on free motion": (lambda name: simulate(scene(Gravity(1.0)), integrator=name), "takes no torque", lambda name: name == "exact"),
        "h = 0": (lambda name: simulate(scene(), integrator=name, dt=0.0), "dt", steps_made),
        "a start that is no number": (lambda name: tops((1.0, 1.4, 2.0), (math.nan, 0.0, 0.0)), "finite", steps_made),
        "the triangle inequality": (lambda name: Body.from_moments((1.0, 1.0, 2.1)), "triangle", steps_made),
        "a moment of zero": (lambda name: Body.from_moments((0.0, 1.0, 1.0)), "positive", steps_made),
        "a quaternion of norm 0": (lambda name: tops((1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), "norm 0", steps_made),
    }  # fmt: skip
    for word, (call, says, claims) in calls.items():
        yield Case(
            "H12",
            word,
            "must be refused with the reason, not run",
            "an error that says so",
            refused(call, says),
            0.0,
            claims=claims,
        )


def published():
    """H15."""
    for word in ("nasa_brick", "toms903_step", "hairer_free", "hairer_heavy", "cardona_top"):
        problem = PROBLEMS[word]
        yield Case("H15", word.replace("_", " "), "what others have published, at 34 digits where they agree", problem.source.split(";")[0], against_end(problem), None, problem.effects, quick=word in ("hairer_heavy", "nasa_brick"))  # fmt: skip


def attitude_errors():
    """H13."""

    def error(integrator, share):
        q, angles = np.array((0.1, -0.5, 0.7, 0.5)), 10.0 ** -np.arange(1.0, 16.0)
        q /= np.linalg.norm(q)
        turned = np.array(
            [multiply(tuple(q), (math.cos(0.5 * a), 0.0, math.sin(0.5 * a), 0.0)) for a in angles]
        )
        return float(
            np.abs(attitude_error(np.concatenate([turned, -turned]), q) - np.tile(angles, 2)).max()
        )

    yield Case("H13", "angles of 0.1 to 1e-15 rad", "2 arccos |p.q| says 0 for all below 1e-8; q and -q are one attitude", "the angle turned by", error, 1e-15, claims=lambda name: name == "exact", quick=True)  # fmt: skip


def damped():
    """H14."""
    scene = tops((1.0, 1.4, 2.0), (0.3, 0.9, 0.7), damping=0.2)
    yield Case("H14", "damped asymmetric body", "L' = L x omega - rate L: every method has to place the damping right within its step", "closed form at another time", against_closed(scene, 20.0), None, scene.effects)  # fmt: skip
    fast = tops((1.0, 1.4, 2.0), (3.0, 9.0, 7.0), damping=5.0)
    yield Case("H14", "to rest in 30 e-foldings", "the step is short against the spin and long against what is left of it", "closed form at another time", against_closed(fast, 6.0), None, fast.effects)  # fmt: skip


def catalogue():
    """All cases, in order."""
    made = (
        principal_axes,
        dzhanibekov,
        separatrix,
        symmetric_limits,
        plates_and_needles,
        fast_spin,
        heavy_tops,
        scale,
        many_steps,
    )
    return [
        case
        for make in (*made, steady_heavy_tops, chaos, refusals, attitude_errors, damped, published)
        for case in make()
    ]

"""What a hard case is, and how its error is found: against a closed form, a published end, an invariant, a mirror image, or itself."""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rigidmc.dynamics.euler import kinetic_energy
from rigidmc.dynamics.so3 import dot, up
from rigidmc.effects import Gravity, ViscousDamping
from rigidmc.effects.protocol import total_energy_scale
from rigidmc.engine.forces import energies
from rigidmc.errors import RigidmcError, SceneWarning
from rigidmc.integrators import INTEGRATORS, accepting
from rigidmc.mechanics.free_top import free_motion
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.planning.closed_form import closed_form
from rigidmc.planning.rates import physics, rates
from rigidmc.planning.stage import stage
from rigidmc.planning.units import Internal, internal, scaled
from rigidmc.runs.simulate import simulate
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import is_shared, rows
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start

TURNS = {
    2: 0.01,
    4: 0.05,
    6: 0.12,
    8: 0.25,
    math.inf: 0.12,
}  # of the fastest member in a step [rad], by order


def turn_of(order):
    """The turn of the fastest member in a step [rad] for a method of an order: that of the highest order in TURNS which is not higher."""
    return TURNS[max((known for known in TURNS if known <= order), default=min(TURNS))]


@dataclass(frozen=True)
class Case:
    """One hard case.

    error : function of (integrator, share) -> error; share < 1 shortens what is long
    asked : the bound, or a function of the integrator's name, where mathematics or the user sets it; else `bounds.csv` has one for each
    effects : those that take them claim the case, where claims(name) holds too
    weak : {integrator: why it is not up to the case, though it claims it}
    quick : whether `--quick` runs it
    """

    group: str
    name: str
    why: str
    truth: str
    error: Callable
    asked: float | Callable | None = None
    effects: tuple = ()
    claims: Callable = lambda name: True
    weak: dict = field(default_factory=dict)
    quick: bool = False

    def integrators(self):
        """The names of those that claim it."""
        return [name for name in accepting(self.effects) if self.claims(name)]

    def asked_of(self, integrator):
        """The bound that does not come from measurements, or None."""
        return self.asked(integrator) if callable(self.asked) else self.asked


def tops(
    moments, momentum, attitude=(1.0, 0.0, 0.0, 0.0), weight=(0.0, 0.0, 0.0), damping=0.0, g=1.0
):
    """A Scene of tops: each argument a tuple of numbers, or an array with one row for each member; weight = m g r [N m]."""
    columns = [np.asarray(x, dtype=float) for x in (moments, momentum, attitude, weight)]
    several = max(len(c) if c.ndim == 2 else 0 for c in columns)
    if several:
        columns = [np.array(np.broadcast_to(c, (several, c.shape[-1]))) for c in columns]
    given: list[Any] = [c if several else tuple(c.tolist()) for c in columns]
    effects: tuple = (Gravity(g),) if np.any(columns[3]) else ()
    effects += (ViscousDamping(damping),) if damping else ()
    return Scene(
        Body.from_moments(given[0], centre=given[3]),
        effects,
        Start(momentum=given[1], attitude=given[2]),
    )


def run(scene, integrator, t_end, saves=8, turn=None, steps=None, **settings):
    """The Dataset of a scene to t_end at `saves` equal times, in `steps` or else in steps that turn the fastest member by `turn`, or TURNS."""
    alike, units = is_shared(*scene.quantities()), internal(scene)
    inner = scene if units is None else scaled(scene, units.mass, 1.0, units.time)
    rate = (1.0 if units is None else units.time) * float(
        np.max(
            rates(
                inner.effects, stage(inner, 0, 1 if alike else rows(*scene.quantities()), True)[0]
            )
        )
    )
    turn = turn_of(INTEGRATORS[integrator].order) if turn is None else turn
    dt = t_end / steps if steps else turn / rate if rate > 0.0 else t_end / 100.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return simulate(
            scene, integrator=integrator, dt=min(dt, t_end / saves), t_end=t_end, every=t_end / saves, members=1 if alike else None,
            save=("momentum", "attitude"), threads=1, **settings,
        )  # fmt: skip


def worst(ds, values):
    """The largest of a value for each member; inf where one is flagged or nan."""
    return float(
        np.max(np.where(ds.status.values == 0, np.nan_to_num(values, nan=math.inf), math.inf))
    )


def distance(q, l, true_q, true_l):
    """Larger of the errors of momentum [of its size] and attitude [rad], (times, n), of (times, 4, n) and (times, 3, n)."""
    unit = np.max(np.abs(true_l)) or 1.0  # whose square is a number
    size = np.linalg.norm(true_l / unit, axis=1)
    off = np.linalg.norm((l - true_l) / unit, axis=1) / np.where(size > 0.0, size, 1.0)
    return np.maximum(off, attitude_error(np.moveaxis(q, 1, -1), np.moveaxis(true_q, 1, -1)))


def closed_states(scene, ds):
    """The closed form of a Dataset at its times."""
    units = internal(scene) or Internal(1.0, 1.0)
    motion = closed_form(scaled(scene, units.mass, 1.0, units.time), ds.sizes["member"], 0).motion(
        ds.time.values * units.time
    )
    return np.moveaxis(motion.attitude, -1, 1), np.moveaxis(motion.momentum, -1, 1) * units.factor(
        "kg m2 s-1"
    )


def against_closed(scene, t_end, saves=8, **options):
    """Error of the state against the closed form; of that itself against the best integrator."""

    def error(integrator, share):
        ds = run(scene, integrator, t_end, saves, **options)
        if integrator == "closed":
            best = next(
                name for name in ("exact", "srkn11", "rk8") if name in accepting(scene.effects)
            )
            other = run(scene, best, t_end, saves, **options)
            true = other.attitude.values, other.momentum.values
        else:
            true = closed_states(scene, ds)
        return worst(ds, distance(ds.attitude.values, ds.momentum.values, *true)[1:].max(0))

    return error


def against_turn(scene, t_end, omega):
    """Error of the state against a plain turn by omega [rad/s] about axis 2, from the attitude 1."""

    def error(integrator, share):
        ds = run(scene, integrator, t_end)
        half = 0.5 * omega * ds.time.values[:, None] * np.ones(ds.sizes["member"])
        turned = np.stack([np.cos(half), 0.0 * half, np.sin(half), 0.0 * half], axis=1)
        l = ds.momentum.values
        return worst(ds, distance(ds.attitude.values, l, turned, l[:1] + 0.0 * l).max(0))

    return error


def flagged_or_close(scene, t_end, **options):
    """Error of the state against the closed form; nothing where a member is flagged: nonsense must not look like a result."""

    def error(integrator, share):
        try:
            ds = run(scene, integrator, t_end, 8, **options)
        except RigidmcError as refused:  # midpoint, which cannot be solved there
            return 0.0 if "can be solved" in str(refused) else math.inf
        off = distance(ds.attitude.values, ds.momentum.values, *closed_states(scene, ds)).max(0)
        return float(np.max(np.where(ds.status.values == 0, np.nan_to_num(off, nan=math.inf), 0.0)))

    return error


def against_end(problem, turn=None):
    """Error at the published end of a problem."""
    scene = tops(
        problem.moments,
        problem.momentum,
        problem.attitude,
        tuple(problem.gravity * p for p in problem.static_moment),
    )

    def error(integrator, share):
        ds = run(scene, integrator, problem.time, 1, turn)
        q, l, end = ds.attitude.values[-1, :, 0], ds.momentum.values[-1, :, 0], problem.end_momentum
        off = 0.0 if end is None else np.linalg.norm(l - end) / np.linalg.norm(end)
        turned = 0.0 if problem.end_attitude is None else attitude_error(q, problem.end_attitude)
        return worst(ds, np.array([max(float(off), float(turned))]))

    return error


def constant(scene, t_end, quantities, saves=8, steps=None, **options):
    """Largest change of quantities(body, effects, q, l) = [(values (..., times, n), scale (n))], each of its scale (where that is not 0)."""

    def error(integrator, share):
        n = max(saves, round(steps * share / saves) * saves) if steps else None
        ds = run(
            scene, integrator, t_end * (n / steps if steps else 1.0), saves, steps=n, **options
        )
        body, effects = physics(scene.effects, stage(scene, 0, ds.sizes["member"], True)[0])
        found = np.zeros(ds.sizes["member"])
        for values, scale in quantities(
            body,
            effects,
            np.moveaxis(ds.attitude.values, 1, 0),
            np.moveaxis(ds.momentum.values, 1, 0),
        ):
            values = np.reshape(values, (-1, *np.shape(values)[-2:]))
            change = np.abs(values - values[:, :1]).max((0, 1))
            found = np.maximum(
                found, np.nan_to_num(change / np.where(scale > 0.0, scale, 1.0), nan=math.inf)
            )
        return worst(ds, found)

    return error


def conserved(body, effects, q, l):
    """Energy and |L|^2 of a free body; energy and L_z under gravity."""
    play = kinetic_energy(body, l[:, 0]) + total_energy_scale(effects, body)
    energy = kinetic_energy(body, l) + energies(effects, body, q)
    if not effects:
        return [(energy, play), (dot(l, l), dot(l[:, 0], l[:, 0]))]
    largest = np.sqrt(2.0 * play / np.min([body.i1, body.i2, body.i3], axis=0))
    return [(energy, play), (dot(l, up(q)), largest)]


def energy_alone(body, effects, q, l):
    """The energy."""
    return conserved(body, effects, q, l)[:1]


def direction(body, effects, q, l):
    """The momentum in the body, and the vertical in it where there is gravity: what a permanent rotation keeps."""
    return [
        (np.array(l), np.sqrt(dot(l[:, 0], l[:, 0]))),
        *([(np.array(up(q)), np.ones(l.shape[-1]))] if effects else []),
    ]


def flips(moments, momentum, count, first=False):
    """Largest error of the first `count` zeros of L2, relative to their times (2 k + 1) K/lambda; between saves L2 is a cubic with its slopes.

    The motion must start where L3 = 0.
    """
    kind = free_motion(moments, momentum)
    interval, rate = float(kind.flip_interval), float(kind.rate)
    scene, saves = (
        tops(moments, momentum),
        math.ceil(count * float(kind.flip_interval) * float(kind.rate) / 0.01),
    )

    def error(integrator, share):
        ds = run(scene, integrator, count * interval, saves)
        t, (one, two, three) = ds.time.values, ds.momentum.values[:, :, 0].T
        slope = (1.0 / moments[0] - 1.0 / moments[2]) * one * three  # L2' = L3 omega1 - L1 omega3
        at = np.flatnonzero((two[:-1] > 0.0) != (two[1:] > 0.0))
        if len(at) < count or ds.status.values[0]:
            return math.inf
        found = [
            _root(t[i], t[i + 1], two[i], two[i + 1], slope[i], slope[i + 1]) for i in at[:count]
        ]
        true = interval * (np.arange(count) + 0.5)
        return float(np.max(np.abs(np.array(found) - true) / true))

    assert rate > 0.0
    return error


def _root(a, b, f, g, df, dg):
    """The zero between a and b of the cubic with values f, g and slopes df, dg there."""
    h = b - a
    cubic = np.polynomial.Polynomial(
        [f, h * df, 3 * (g - f) - h * (2 * df + dg), 2 * (f - g) + h * (df + dg)]
    )
    x = f / (f - g)
    for _ in range(6):
        x -= cubic(x) / cubic.deriv()(x)
    return a + h * x


def there_and_back(scene, t_end, **options):
    """How far from its start a motion is that is run to t_end, its momentum reversed, and run as long again: steps h < 0."""

    def error(integrator, share):
        ds = run(scene, integrator, t_end, 1, **options)
        q, l = ds.attitude.values[-1], ds.momentum.values[-1]
        back = Scene(scene.body, scene.effects, Start(momentum=tuple(-l), attitude=tuple(q)))
        again = run(back, integrator, t_end, 1, **options)
        start = ds.attitude.values[:1], ds.momentum.values[:1]
        return max(
            worst(ds, 0.0),
            worst(
                again, distance(again.attitude.values[-1:], -again.momentum.values[-1:], *start)[0]
            ),
        )

    return error


def same_bits(scene, t_end, **options):
    """How many numbers differ between one run and others in other blocks, threads, orders and spans of members."""
    names = ("momentum", "attitude", "energy_drift_max", "status")

    def error(integrator, share):
        one = run(scene, integrator, t_end, 4, **options)
        others = [run(scene, integrator, t_end, 4, block=block, **options) for block in (32, 96)]
        count = sum(
            int(np.count_nonzero(one[name].values != other[name].values))
            for other in others
            for name in names
        )
        return float(count) if not one.status.values.any() else math.inf

    return error


def scaled_alike(scene, other, t_end, time, mass_length, power_of_two, **options):
    """How far two scenes are apart that differ by units alone: times by `time`, momenta by `mass_length`."""

    def error(integrator, share):
        one, two = (
            run(scene, integrator, t_end, 4, **options),
            run(other, integrator, t_end * time, 4, **options),
        )
        q, l = two.attitude.values, two.momentum.values / mass_length
        if power_of_two:
            same = np.array_equal(q, one.attitude.values) and np.array_equal(l, one.momentum.values)
            return 0.0 if same and worst(two, 0.0) == 0.0 else 1.0
        return max(
            worst(one, 0.0),
            worst(two, distance(q, l, one.attitude.values, one.momentum.values).max(0)),
        )

    return error


def refused(call, word):
    """0 where a call raises an error whose text has `word`, 1 where it runs or says something else."""

    def error(integrator, share):
        try:
            call(integrator)
        except RigidmcError as error:
            return 0.0 if word in str(error) else 1.0
        return 1.0

    return error


def walk(scene, dt_turn, steps):
    """How much worse than sqrt(n) the drift of energy and |L|^2 grows: the largest of rms(n)/rms(n0) / sqrt(n/n0) over n = 2^k n0."""

    def error(integrator, share):
        saves = 64
        n = saves * round(steps * share / saves)
        rate = float(
            np.max(rates(scene.effects, stage(scene, 0, rows(*scene.quantities()), True)[0]))
        )
        ds = run(scene, integrator, n * dt_turn / rate, saves, steps=n)
        body, effects = physics(scene.effects, stage(scene, 0, ds.sizes["member"], True)[0])
        q, l = np.moveaxis(ds.attitude.values, 1, 0), np.moveaxis(ds.momentum.values, 1, 0)
        ratios = []
        for values, scale in conserved(body, effects, q, l):
            rms = np.sqrt((((values - values[:1]) / scale) ** 2).mean(1))[[1, 4, 16, 64]]
            rms = np.maximum(rms, 1.1e-16)
            ratios.append(np.max(rms[1:] / rms[0] / np.sqrt([4, 16, 64])))
        return max(worst(ds, 0.0), float(np.max(ratios)))

    return error

"""The problem that benches share: tops that are all different, and functions that run them."""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import StepRange
from rigidmc.engine.program import NO_NOISE, Program
from rigidmc.engine.program_spec import ProgramSpec
from rigidmc.engine.threads import run_block
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.effects.protocol import blank, numbers, parameter_count
from rigidmc.planning.steps import count_member_steps, order_by_steps, rate_bounds
from rigidmc.runs.blocks import BlockJob

GRAVITY = 9.81  # m/s^2
BLOCK = 4096  # members of a block, as in rigidmc.planning.plan


class Tops(NamedTuple):
    """Different bodies in different states, one column per member, in SI units."""

    moments: np.ndarray  # (3, n)
    static: np.ndarray  # (3, n) mass times centre of mass
    attitude: np.ndarray  # (4, n)
    omega: np.ndarray  # (3, n)

    @property
    def momentum(self):
        return self.moments * self.omega

    @property
    def body(self):
        return np.array(MassProperties.of(self.moments, self.static)[:BODY_NUMBERS])


def random_tops(members, seed=7):
    """Return random tops: second moments uniform in (0.2, 1), I = sums of two, so that all bodies
    are possible; omega and attitude in any direction.
    """
    random = np.random.default_rng(seed)
    second = random.uniform(0.2, 1.0, (3, members))
    attitude = random.normal(size=(4, members))
    return Tops(
        second.sum(0) - second,
        random.normal(0.0, 0.1, (3, members)),
        attitude / np.sqrt((attitude * attitude).sum(0)),
        random.normal(size=(3, members)),
    )


def blocks(tops, effects, size=BLOCK):
    """Return the blocks of rows on which a Program works, at their start."""
    n = tops.omega.shape[1]
    rows = np.zeros((layout.EFFECTS + parameter_count(*effects), n))
    rows[layout.ATTITUDE : layout.MOMENTUM] = tops.attitude
    rows[layout.MOMENTUM : layout.EXTRA] = tops.momentum
    rows[layout.BODY : layout.EFFECTS], rows[layout.STEPS] = tops.body, 1.0
    for row, (_, _, value) in enumerate(
        (n for effect in effects for n in numbers(effect)), layout.EFFECTS
    ):
        rows[row] = value
    return [np.ascontiguousarray(rows[:, low : low + size]) for low in range(0, n, size)]


def advance(
    parts, steps_form, effects, attitude, h, steps, pool, dtype="float64", limits=(),
    compensated=False,
):  # fmt: skip
    """Move blocks by `steps` steps h of a scheme on the threads of a pool, final state only."""
    spec = ProgramSpec(steps_form, blank(effects), (), attitude, compensated, dtype, limits)
    program = Program(spec)

    def move(block):
        program.advance(block, StepRange(h, 1, steps, steps, 0, 0, steps))

    for _ in pool.map(move, parts):
        pass


def advance_own(parts, steps_form, effects, turn, t_end, pool, dtype="float64"):
    """Move blocks to t_end, each member in its own steps, as `simulate` plans and sorts them."""
    program = Program(ProgramSpec(steps_form, blank(effects), dtype=dtype))

    def move(block):
        block[layout.STEPS] = count_member_steps(rate_bounds(effects, block), t_end, turn)
        slots = int(block[layout.STEPS].max())
        order = order_by_steps(block)
        given = np.take(block, order, axis=1)
        run_block(
            BlockJob(
                0,
                0,
                np.empty(0, np.int64),
                {},
                program,
                NO_NOISE,
                given,
                order,
                np.empty(0),
                0,
                0,
                StepRange(t_end, slots, slots, slots, 1, 0, slots, slots, t_end),
            )
        )
        block[: layout.EXTRA, order] = given[: layout.EXTRA]

    for _ in pool.map(move, parts):
        pass


def state(parts):
    """Return (attitude (4, n), momentum (3, n)) of blocks."""
    rows = np.concatenate([block[: layout.EXTRA] for block in parts], axis=1)
    return rows[: layout.MOMENTUM], rows[layout.MOMENTUM :]


def columns(tops):
    """Return the rows of bench/baselines/tops.c: q, l, reciprocal moments, (I2 - I3)/(I2 I3),
    weight times centre of mass.
    """
    return np.concatenate([tops.attitude, tops.momentum, tops.body[:6], GRAVITY * tops.static])


class Pool:
    """Threads that include the caller. Two threads that wake together may share a core for their
    first 10 ms, which OpenMP's never do.
    """

    def __init__(self, threads):
        self.others = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self.threads = threads

    def map(self, function, items):
        """Return the results of a function of each item, in order."""
        items = list(items)
        # next() of a range iterator is atomic
        results, left = ([None] * len(items), iter(range(len(items))))

        def work():
            for i in left:
                results[i] = function(items[i])

        started = (
            [self.others.submit(work) for _ in range(min(self.threads, len(items)) - 1)]
            if self.others
            else []
        )
        work()
        for one in started:
            one.result()
        return results


def pool(threads):
    """Return a pool of `threads` threads."""
    return Pool(threads)


def omega_error(tops, momentum, reference):
    """Return |omega - reference| / |reference| of each member, from momenta."""
    difference = (momentum - reference) / tops.moments
    return np.sqrt((difference**2).sum(0) / ((reference / tops.moments) ** 2).sum(0))


def attitude_error(q, p):
    """Return the angle between attitudes [rad]: 4 asin(d/2), where d is the distance of q from p or
    -p, whichever is nearer.
    """
    distance = np.sqrt(np.minimum(((q - p) ** 2).sum(0), ((q + p) ** 2).sum(0)))
    return 4.0 * np.arcsin(np.minimum(0.5 * distance, 1.0))

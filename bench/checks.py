"""The cost of health checks: the same tops with all limits and with none, interleaved.

Also a test that the checks change no bit of a good member.
"""

import math

import numpy as np

from bench import harness
from bench.problems import tops
from rigidmc.engine.kernel import layout
from rigidmc.engine.machine import threads_available
from rigidmc.physics.effects import Gravity
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, scheme_of
from rigidmc.planning.scheme import Limits

MEMBERS, STEPS, H = 65536, 1000, 0.01
FREE, HEAVY = (), (Gravity(tops.GRAVITY),)
CASES = (
    ("rk4", FREE, True),
    ("rk4", FREE, False),
    ("rk4", HEAVY, True),
    ("exact", FREE, True),
    ("rk8", HEAVY, True),
    ("strang", HEAVY, True),
)


def shifted(pool, seed=0):
    """Return a function that moves the kernel's workspace to another address.

    The position of the workspace relative to the stack changes the time of rk8 by 8 % either way.
    """
    some, held = np.random.default_rng(seed), []

    def hold(sizes):  # in the threads of the pool, each with its own heap
        return [np.empty(size) for size in sizes]

    def shift():
        held[:] = pool.map(
            hold, [some.integers(1, 600, some.integers(1, 64)).tolist() for _ in range(8)]
        )

    return shift


def run(quick):
    ensemble, pool, rows = tops.random_tops(MEMBERS), tops.pool(threads_available()), []
    shift = shifted(pool)
    for name, effects, attitude in CASES:
        steps_form = scheme_of(INTEGRATORS[name], TurnBounds(0.1), effects)
        with_all = tuple(
            Limits(
                0.05,
                math.inf if effects else 0.05,
                0.05 if effects and attitude else math.inf,
                math.pi,
                1e-9,
            )
        )
        ends = {}

        def advance(
            word, limits, steps_form=steps_form, effects=effects, attitude=attitude, ends=ends
        ):
            def move(parts):
                tops.advance(parts, steps_form, effects, attitude, H, STEPS, pool, limits=limits)
                ends[word] = parts

            return lambda: (shift(), tops.blocks(ensemble, effects))[1], move

        cpu = {}
        field = {"with": advance("with", with_all), "without": advance("without", ())}
        seconds = harness.interleaved(field, 5 if quick else 21, cpu)
        rest = [
            np.concatenate([part[: layout.EXTRA] for part in ends[word]], axis=1) for word in field
        ]
        flagged = sum(int(part[layout.STATUS].any()) for part in ends["with"])
        assert not flagged, f"{name}: members of the bench are flagged"
        assert np.array_equal(*rest), f"{name}: the checks changed bits"
        what = f"{name} {'heavy' if effects else 'free'}{'' if attitude else ', momentum only'}"
        wall, busy = (
            100.0 * (harness.ratio(s["with"], s["without"]) - 1.0) for s in (seconds, cpu)
        )
        rows.append(
            harness.row(
                "cost",
                what=what,
                wall_percent=wall,
                cpu_percent=busy,
                seconds=seconds,
                cpu_seconds=cpu,
            )
        )
    worst = max(rows, key=lambda row: row["cpu_percent"])
    return [
        *rows,
        harness.at_most(
            f"cost of the status checks, worst ({worst['what']}), CPU seconds",
            2.0,
            worst["cpu_percent"],
            "%",
        ),
    ]


def report(rows):
    columns = "tops {what} | CPU seconds {cpu_percent:+.2f} % | wall {wall_percent:+.2f} %"
    costs = harness.of_kind(rows, "cost")
    harness.show("health checks, with against without", costs, columns)
    harness.report_targets(rows)

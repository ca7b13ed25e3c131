"""The candidates of the throughput bench: kernels, C, naive Numba and simulate()."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import rigidmc
from bench import baselines
from bench.baselines import naive
from bench.problems import tops
from rigidmc.engine.machine import threads_available
from rigidmc.physics.effects import Gravity
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, scheme_of

MEMBERS, STEPS, H, EACH = 65536, 1000, 0.01, 100
SAVES = ("omega", "attitude", "energy", "l2")
GRAVITY = (Gravity(tops.GRAVITY),)


class Candidate(NamedTuple):
    """One candidate: run(prepare()) is timed without prepare(), and read(result of run) returns
    (attitude or None, momentum).
    """

    prepare: Callable
    run: Callable
    read: Callable | None
    same_as: str = ""  # the candidate with which it must agree
    work: float = MEMBERS * STEPS  # member-steps, or floating-point operations for the peak


def warmed():
    """Return memory pages for 100 saves, already touched.

    Hypervisors reclaim free pages after 2 s. Touching 480 MB then costs 1 s, a moment later 0.04 s.
    The page faults of the run itself stay in its time.
    """
    np.empty(MEMBERS * (EACH + 1) * 9).fill(0.0)


def kernels(ensemble):
    """Return the kernels of rigidmc, with blocks on threads, as simulate() runs them."""
    all_cores = tops.pool(threads_available())

    def candidate(name, effects, attitude=True, pool=all_cores, same_as="kernel rk4 free"):
        steps_form = scheme_of(INTEGRATORS[name], TurnBounds(0.1), effects)

        def run(parts):
            tops.advance(parts, steps_form, effects, attitude, H, STEPS, pool)
            return parts

        def read(parts):
            q, l = tops.state(parts)
            return q if attitude else None, l

        return Candidate(lambda: tops.blocks(ensemble, effects), run, read, same_as)

    return {
        "kernel rk4 free": candidate("rk4", ()),
        "kernel rk4 free, one thread": candidate("rk4", (), pool=tops.pool(1)),
        "kernel rk4 heavy": candidate("rk4", GRAVITY, same_as="kernel rk4 heavy"),
        "kernel exact": candidate("exact", ()),
        "kernel exact, momentum only": candidate("exact", (), attitude=False),
        "kernel strang heavy": candidate("strang", GRAVITY, same_as="kernel rk4 heavy"),
    }


def compiled(ensemble, notes):
    """Return C and the FMA peak: nothing without gcc, less (with a note) without 512-bit
    vectors."""
    try:
        plain, aim, peak = (baselines.build(name) for name in ("tops.c", "tops512.c", "peak.c"))
    except OSError as error:
        notes["C"] = str(error)
        return {}

    def candidate(function, same_as, steps=STEPS):
        def run(rows):
            function(rows.ctypes.data, MEMBERS, steps, H)
            return rows

        read = (lambda rows: (rows[:4], rows[4:7])) if same_as else None
        return Candidate(lambda: tops.columns(ensemble), run, read, same_as, MEMBERS * steps)

    def saving(rows):
        # untouched memory, as for a new result
        out = np.empty((EACH + 1, 9, MEMBERS))
        plain.rk4_free_saves(rows.ctypes.data, MEMBERS, STEPS, H, STEPS // EACH, out.ctypes.data)
        return out

    def ready():
        warmed()
        return tops.columns(ensemble)

    of_c = {
        "C structure of arrays, free": candidate(plain.rk4_free, "kernel rk4 free"),
        "C structure of arrays, free, 100 saves": Candidate(
            ready,
            saving,
            lambda out: (out[-1, 3:7], out[-1, :3] * ensemble.moments),
            "kernel rk4 free",
        ),
        "C structure of arrays, heavy": candidate(plain.rk4_heavy, "kernel rk4 heavy"),
    }
    if hasattr(aim, "rk4_free_512"):
        of_c["C 512-bit intrinsics, free"] = candidate(aim.rk4_free_512, "kernel rk4 free")
        of_c["C 512-bit intrinsics, free, 4,000 steps"] = candidate(aim.rk4_free_512, "", 4000)
        of_c["C 512-bit intrinsics, heavy"] = candidate(aim.rk4_heavy_512, "kernel rk4 heavy")
    else:
        notes["C 512-bit intrinsics"] = "left out: this CPU has no AVX-512"
    count = 50_000_000  # 0.16 s at 58 GFLOP/s a thread

    def summit(threads):
        return Candidate(
            lambda: threads,
            lambda number: peak.fma_peak(count, number),
            None,
            work=count * peak.fma_peak(1, threads),
        )

    return {**of_c, "peak": summit(threads_available()), "peak, one thread": summit(1)}


def numba(ensemble):
    """Return naive Numba: prange over tops, from the main thread."""

    def prepare():
        rows = tops.columns(ensemble)
        return [
            np.ascontiguousarray(part.T) for part in (rows[:7], rows[7:10], rows[10:13], rows[13:])
        ]

    def free(arrays):
        naive.rk4_free(*arrays[:3], STEPS, H)
        return arrays[0]

    def heavy(arrays):
        naive.rk4_heavy(*arrays, STEPS, H)
        return arrays[0]

    def read(state):
        return state.T[:4], state.T[4:]

    return {
        "naive prange, free": Candidate(prepare, free, read, "kernel rk4 free"),
        "naive prange, heavy": Candidate(prepare, heavy, read, "kernel rk4 heavy"),
    }


def simulate(ensemble):
    """Return the whole call, from scene to Dataset. It saves the attitude, which is then integrated
    as in the kernels above.
    """
    body = rigidmc.Body.from_moments(
        ensemble.moments.T.copy(), mass=1.0, centre=ensemble.static.T.copy()
    )
    start = rigidmc.Start(omega=ensemble.omega.T.copy(), attitude=ensemble.attitude.T.copy())

    def candidate(effects, every, save, same_as, steps=STEPS):
        def run(scene):
            options: dict[str, Any] = {
                "members": MEMBERS,
                "seed": 7,
                "every": every,
                "save": save,
                "progress": False,
            }
            return rigidmc.simulate(scene, integrator="rk4", dt=H, t_end=H * steps, **options)

        def read(data):
            last = data.isel(time=-1)
            return last.attitude.transpose("quat", "member").values, last.omega.transpose(
                "axis", "member"
            ).values * ensemble.moments

        def prepare():
            if every:
                warmed()
            return rigidmc.Scene(body, effects=effects, start=start)

        return Candidate(prepare, run, read if same_as else None, same_as, MEMBERS * steps)

    values = {
        "body.moments": ensemble.moments.T.copy(),
        "start.omega": ensemble.omega.T.copy(),
        "start.attitude": ensemble.attitude.T.copy(),
    }

    def prepared(effects, values, same_as):
        scene = rigidmc.Scene(body, effects=effects, start=start)
        # the medians of the tops plan the run; their limits on drifts are too close for all tops
        limits = {"energy_limit": 1e-2, "momentum_limit": 1e-2, "turn_limit": 3.0}
        run = {"dt": H, "t_end": H * STEPS, "seed": 7, "save": ("omega", "attitude")}
        ready = rigidmc.prepare(scene, "rk4", **run, **limits, varied=values)
        _, _, read, *_ = candidate(effects, None, (), same_as)
        return Candidate(lambda: values, lambda values: ready.run(values=values), read, same_as)

    of_bodies = {**values, "body.centre": ensemble.static.T.copy()}
    return {
        "prepared rk4 free, final state": prepared((), values, "kernel rk4 free"),
        "prepared rk4 heavy, final state": prepared(GRAVITY, of_bodies, "kernel rk4 heavy"),
        "simulate rk4 free, final state": candidate(
            (), None, ("omega", "attitude"), "kernel rk4 free"
        ),
        "simulate rk4 free, 4,000 steps": candidate((), None, ("omega", "attitude"), "", 4000),
        "simulate rk4 free, 100 saves": candidate((), H * STEPS / EACH, SAVES, "kernel rk4 free"),
        "simulate rk4 heavy, final state": candidate(
            GRAVITY, None, ("omega", "attitude"), "kernel rk4 heavy"
        ),
    }

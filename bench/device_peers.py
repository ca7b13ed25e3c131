"""CUDA C and JAX on a GPU: the steps that `bench.device` times, as they make them.

Bodies by classical Runge-Kutta in float64: 7 numbers, the quaternion normalised after each step. In
JAX bodies are free and share their moments; in CUDA C each has its own. Compiling and copying are
not timed.
"""

import importlib.util
import statistics
import time

import numpy as np

import rigidmc as rm
from bench import baselines
from bench.problems import tops
from rigidmc.physics.effects import Gravity

MOMENTS = 1.0, 1.4, 2.0
INVERSE = tuple(1.0 / moment for moment in MOMENTS)
START = 1.0, 0.0, 0.0, 0.0, 0.1, 1.4, 0.2  # quaternion, and L in the body's frame
H, STEPS, ROUNDS = 0.01, 1000, 3
STATE = len(START)
CHECKED = 256  # different tops, compared with rigidmc; a launch repeats them


def rates(rows):
    """Return the rates of the 7 numbers, as arrays: q' = q (0, omega) / 2, L' = L x omega."""
    a, b, c, d, x, y, z = rows
    u, v, w = (one * inverse for one, inverse in zip((x, y, z), INVERSE, strict=True))
    return (
        0.5 * (-b * u - c * v - d * w), 0.5 * (a * u + c * w - d * v),
        0.5 * (a * v + d * u - b * w), 0.5 * (a * w + b * v - c * u),
        y * w - z * v, z * u - x * w, x * v - y * u,
    )  # fmt: skip


def step_of_rows(rows, root):
    """Make a step of classical Runge-Kutta on 7 rows;  root : the square root of an array."""

    def stage(k, h):
        return tuple(one + h * rate for one, rate in zip(rows, k, strict=True))

    k1 = rates(rows)
    k2 = rates(stage(k1, H / 2))
    k3 = rates(stage(k2, H / 2))
    k4 = rates(stage(k3, H))
    sums = zip(rows, k1, k2, k3, k4, strict=True)
    *q, x, y, z = (one + H / 6 * (p + 2 * r + 2 * s + t) for one, p, r, s, t in sums)
    norm = 1 / root(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    return *(one * norm for one in q), x, y, z


def step_of_member(y, jnp):
    """Make a step of a member's 7 numbers, written as linear algebra."""

    def rates(y):
        q, l = y[:4], y[4:]
        u, v, w = omega = jnp.array(INVERSE) * l
        dq = jnp.array([
            -q[1] * u - q[2] * v - q[3] * w, q[0] * u + q[2] * w - q[3] * v,
            q[0] * v + q[3] * u - q[1] * w, q[0] * w + q[1] * v - q[2] * u,
        ])  # fmt: skip
        return jnp.concatenate([0.5 * dq, jnp.cross(l, omega)])

    k1 = rates(y)
    k2 = rates(y + H / 2 * k1)
    k3 = rates(y + H / 2 * k2)
    k4 = rates(y + H * k3)
    y = y + H / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return jnp.concatenate([y[:4] / jnp.sqrt(jnp.sum(y[:4] ** 2)), y[4:]])


def candidates(members):
    """Return {name: (function, its argument, function that converts its result to 7 rows)}."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    def one_member(start):
        def following(y, _):
            return step_of_member(y, jnp), None

        return jax.lax.scan(following, start, None, length=STEPS)[0]

    def all_rows(rows):
        return jax.lax.fori_loop(0, STEPS, lambda _, rows: step_of_rows(rows, jnp.sqrt), rows)

    wide = jnp.tile(jnp.array(START), (members, 1))
    rows = tuple(jnp.full(members, value) for value in START)
    return {
        "JAX, vmap and scan": (jax.jit(jax.vmap(one_member)), wide, np.transpose),
        "JAX, rows by hand in fori_loop": (jax.jit(all_rows), rows, np.asarray),
    }


def expected():
    """Return the 7 numbers at the end, by rigidmc on the CPU."""
    body = rm.Body.from_moments(MOMENTS)
    start = rm.Start(attitude=START[:4], momentum=START[4:])
    return end_of(rm.Scene(body, (), start))[:, 0]


def end_of(scene):
    """Return the 7 numbers of each member at the end, by rigidmc on the CPU."""
    scene = scene.with_run(
        integrator="rk4", dt=H, t_end=H * STEPS, every=H * STEPS, checks=False,
        save=("attitude", "momentum"),
    )  # fmt: skip
    end = rm.simulate(scene).isel(time=-1)
    return np.concatenate([end.attitude.values, end.momentum.values])


def cuda_c(quick):
    """Return the rows of CUDA C, free and heavy, [] without nvcc."""
    try:
        library = baselines.build_cuda()
    except OSError as missing:
        print(missing)
        return []
    rows = []
    for heavy in (False, True):
        few = tops.random_tops(CHECKED)
        body = rm.Body.from_moments(few.moments.T, mass=1.0, centre=few.static.T)
        start = rm.Start(attitude=few.attitude.T, omega=few.omega.T)
        effects = (Gravity(tops.GRAVITY),) if heavy else ()
        truth = end_of(rm.Scene(body, effects, start).with_run(members=CHECKED))
        for members in (2**10,) if quick else (2**19, 2**22):
            columns = np.tile(tops.columns(few), members // CHECKED)
            seconds = []
            for _ in range(ROUNDS):
                end = columns.copy()
                took = library.rk4_cuda(end.ctypes.data, members, STEPS, H, heavy)
                if took <= 0.0:
                    print(f"CUDA error {-took:.0f}: the baseline in CUDA C is left out")
                    return rows
                seconds.append(took)
            took = statistics.median(seconds)
            what = "CUDA C by hand, heavy" if heavy else "CUDA C by hand"
            rows.append({"kind": "peer", "name": what, "members": members, "steps": STEPS,
                         "seconds": took, "speed": members * STEPS / took,
                         "error": float(np.abs(end[:STATE, -CHECKED:] - truth).max())})  # fmt: skip
    return rows


def peers(quick):
    """Return the rows of all peers; `error` is the largest difference from rigidmc."""
    return [*cuda_c(quick), *jax(quick)]


def jax(quick):
    """Return the rows of JAX, [] if it is missing."""
    if importlib.util.find_spec("jax") is None:
        print("JAX is not installed")
        return []
    import jax

    rows, truth = [], expected()
    for members in (2**10,) if quick else (2**19, 2**22):
        for name, (function, start, read) in candidates(members).items():
            end = read(jax.block_until_ready(function(start)))  # compiles
            seconds = []
            for _ in range(ROUNDS):
                began = time.perf_counter()
                jax.block_until_ready(function(start))
                seconds.append(time.perf_counter() - began)
            took = statistics.median(seconds)
            rows.append({"kind": "peer", "name": name, "version": jax.__version__,
                         "on": jax.devices()[0].device_kind, "members": members, "steps": STEPS,
                         "seconds": took, "speed": members * STEPS / took,
                         "error": float(np.abs(end[:, 0] - truth).max())})  # fmt: skip
    return rows

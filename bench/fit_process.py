"""A fit of one record by other programs, as a process: PYTHON fit_process.py RECORD.npz NAME.

Writes a line of JSON: the seconds of the fit without imports and compilation, and the moments. The
interpreter needs the other program only. The record has the times t, the rates y (samples, 3), the
first guess of the moments and of the start, and the true start.
"""

import json
import os
import sys
import time

import numpy as np

PAIRS = np.ones((3, 3)) - np.eye(3)
XML = """<mujoco><option timestep="{h}" integrator="RK4" gravity="0 0 0">
<flag contact="disable"/></option><worldbody><body name="b">
<inertial pos="0 0 0" mass="1" diaginertia="{i[0]} {i[1]} {i[2]}"/><joint name="j" type="ball"/>
<geom type="sphere" size=".01" mass="0"/><site name="s"/></body></worldbody>
<sensor><gyro name="g" site="s"/></sensor></mujoco>"""


def rates(w, moments):
    """Euler's equations."""
    i1, i2, i3 = moments
    return (
        (i2 - i3) / i1 * w[1] * w[2],
        (i3 - i1) / i2 * w[2] * w[0],
        (i1 - i2) / i3 * w[0] * w[1],
    )


def scipy(record):
    """solve_ivp (DOP853 at 1e-9) and least_squares by differences; the start is fitted, too."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import least_squares

    t, y = record["t"], record["y"]

    def residuals(x):
        moments = PAIRS @ np.exp(x[:3])
        motion = solve_ivp(
            lambda _, w: rates(w, moments), (0.0, t[-1]), x[3:], method="DOP853", t_eval=t,
            rtol=1e-9, atol=1e-12,
        )  # fmt: skip
        return (motion.y.T - y).ravel()

    x = np.concatenate([np.log(np.linalg.solve(PAIRS, record["guess"])), y[0]])
    began = time.perf_counter()
    found = least_squares(residuals, x)
    return time.perf_counter() - began, PAIRS @ np.exp(found.x[:3])


def mujoco_sysid(record):
    """mujoco.sysid with its own optimiser, from the true start: it fits no start.

    Its sensors lag by a step: times are shifted by one.
    """
    import mujoco
    from mujoco import sysid

    t, h = record["t"], float(record["t"][1])
    spec = mujoco.MjSpec.from_string(XML.format(h=h, i=record["guess"]))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[:] = record["start"]
    state = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)

    def change(spec, parameter):
        spec.body("b").inertia = PAIRS @ np.exp(parameter.value)

    x = np.log(np.linalg.solve(PAIRS, record["guess"]))
    parameters = sysid.ParameterDict()
    parameters.add(sysid.Parameter("J", x, x - 3.0, x + 3.0, modifier=change))
    controls = sysid.TimeSeries(t, np.zeros((t.size, 0)))
    readings = sysid.TimeSeries.from_names(t + h, record["y"], model)
    sequences = sysid.ModelSequences("top", spec, "record", state, controls, readings)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    began = time.perf_counter()
    _, found = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)
    return time.perf_counter() - began, PAIRS @ np.exp(found.x)


def gradsolve(record):
    """gradsolve: a run to each sample, as it returns final states, and BFGS by its gradient."""
    import gradsolve as gs
    import jax
    import jax.numpy as jnp
    from scipy.optimize import minimize

    t, y = record["t"][1:], jnp.asarray(record["y"][1:])

    class Body:
        name, dim, t0, t1, is_stiff = "free_body", 3, 0.0, 1.0, False

        def f_jax(self, _, w, p):
            moments = PAIRS @ jnp.exp(p[:3])
            return p[3] * jnp.stack(rates(w, moments))

    body = Body()
    x = np.log(np.linalg.solve(PAIRS, record["guess"]))

    def parameters(x):
        return jnp.concatenate([jnp.tile(x, (t.size, 1)), t[:, None]], axis=1)

    y0 = np.tile(record["start"], (t.size, 1))
    final = gs.grad_closure(body, y0, parameters(x), device="cpu")
    cost = jax.jit(jax.value_and_grad(lambda x: jnp.sum((final(parameters(x)) - y) ** 2)))
    cost(x)  # compiles
    began = time.perf_counter()
    found = minimize(lambda x: tuple(map(np.asarray, cost(x))), x, jac=True, method="BFGS")
    return time.perf_counter() - began, PAIRS @ np.exp(found.x)


def main(file, name):
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # programs may print
    record = dict(np.load(file))
    try:
        seconds, moments = {f.__name__: f for f in (scipy, mujoco_sysid, gradsolve)}[name](record)
        answer = {"seconds": seconds, "moments": list(map(float, moments))}
    except ImportError as error:
        answer = {"missing": str(error)}
    print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

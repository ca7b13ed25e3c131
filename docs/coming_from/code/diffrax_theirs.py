"""4,096 satellites with uncertain spin, tumbling freely for 60 s: diffrax."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

MOMENTS, T_END = jnp.array([0.061, 0.144, 0.149]), 60.0  # kg m^2, s


def rates(t, state, args):
    """Attitude q (body to space, scalar first) and angular velocity w in body axes."""
    q, w = state
    dq = 0.5 * jnp.concatenate([jnp.array([-q[1:] @ w]), q[0] * w + jnp.cross(q[1:], w)])
    return dq, jnp.cross(MOMENTS * w, w) / MOMENTS


def solve(omega):
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rates),
        diffrax.Dopri8(),
        t0=0.0,
        t1=T_END,
        dt0=0.05,
        y0=(jnp.array([1.0, 0.0, 0.0, 0.0]), omega),
        stepsize_controller=diffrax.PIDController(rtol=1e-10, atol=1e-10),
        max_steps=10_000,
    )
    q, w = solution.ys
    return q[-1], w[-1]


solve_all = jax.jit(jax.vmap(solve))


def ensemble():
    """Attitudes (members, 4) and angular velocities (members, 3) at T_END."""
    omega = np.random.default_rng(1).normal((0.02, 0.5, 0.0), (0.01, 0.01, 0.01), (4096, 3))
    q, w = solve_all(omega)
    return np.asarray(q), np.asarray(w)


if __name__ == "__main__":
    attitude, omega = ensemble()
    print("ensemble", attitude.shape, omega.mean(axis=0))

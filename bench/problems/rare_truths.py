"""Rare events whose probability is known independently."""

import math

import numpy as np
from scipy import stats

import rigidmc as rm

TURN = 2.25  # s: before it the free body of `turning` turns over with p near 1e-6

# omega_3 of a disc in a bath, an Ornstein-Uhlenbeck process that steps sample as a chain
GAMMA, STEP, STEPS, INERTIA = 0.7, 0.1, 40, 2.0
SPREAD = (1.0 / INERTIA) ** 0.5  # of omega_3 at rest with a bath of kT = 1
LEVEL = 4.9 * SPREAD

# wells about +-e_3, passes over +-e_1 that are DEPTH higher, and summits about +-e_2
MOMENTS, DEPTH, SUMMIT, FRICTION = (1.0, 1.2, 1.5), 1.0, 1.5, 1.5
FAR = 2.4  # rad: beyond the pass, 5 to 8 kT below it
TIMES = 10.0, 30.0  # s


def spun(deviation=1.0):
    """Return a disc thrown with a normal spin about its axis."""
    start = rm.Start(omega=(0.0, 0.0, rm.normal(0.0, deviation)))
    return rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start).with_run(dt=0.1, t_end=0.1)


def bathed(steps=STEPS):
    """Return a disc in a bath: omega_3 is an Ornstein-Uhlenbeck process, which the splitting
    integrates exactly."""
    scene = rm.Scene(
        rm.Body((1.0, 1.0, INERTIA)), rm.Bath(GAMMA, 1.0), rm.Start(omega=(0.0, 0.0, 0.0))
    )
    return scene.with_run(integrator="strang", dt=STEP, t_end=STEP * steps, checks=False)


def passed(level=LEVEL, steps=STEPS, start=0.0):
    """Return the probability that omega_3 has passed a level after a step, by quadrature over the
    density of members that have not passed."""
    x, weight = np.polynomial.legendre.leggauss(400)
    low = -8.0 * SPREAD
    x, weight = (x + 1.0) / 2.0 * (level - low) + low, weight * (level - low) / 2.0
    kept = np.exp(-GAMMA * STEP)
    width = SPREAD * np.sqrt(1.0 - kept * kept)
    moves = stats.norm.pdf(x[:, None], kept * x[None, :], width)
    mean = kept * start
    density, p = stats.norm.pdf(x, mean, width), stats.norm.sf((level - mean) / width)
    for _ in range(steps - 1):
        p += (weight * density * stats.norm.sf((level - kept * x) / width)).sum()
        density = moves @ (weight * density)
    return p


def turning():
    """Return a free body that spins nearly about its middle axis and seldom turns over soon."""
    start = rm.Start(omega=(rm.normal(0.0, 0.1), rm.normal(1.0, 0.1), rm.normal(0.0, 0.1)))
    scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=start)
    return scene.with_run(integrator="rk4", dt=0.15, t_end=TURN)


def escaping(depth):
    """Return a body in a bath of temperature DEPTH / depth that starts in a well."""
    wells = rm.Potential((0.0, 0.0, 0.0), (0.0, 2.0 * SUMMIT, -2.0 * DEPTH, 0.0, 0.0, 0.0))
    bath, start = rm.Bath(FRICTION, DEPTH / depth), rm.GibbsMomentum(DEPTH / depth)
    scene = rm.Scene(rm.Body.from_moments(MOMENTS), (wells, bath), rm.Start(momentum=start))
    return scene.with_run(integrator="strang", dt=0.1, checks=False)


def escape_rate(depth):
    """Return (rate of transition-state theory, Kramers's factor) of `escaping` [1/s].

    The rate is the flux of thermal equilibrium through the circle u_3 = 0, where du_3/dt =
    u_1 omega_2 - u_2 omega_1, over the weight of the well; u is the vertical in the body frame::

        k = (kT/2 pi)^(1/2) oint (u_1^2/I_2 + u_2^2/I_1)^(1/2) e^(-U/kT) d alpha / int e^(-U/kT) du
        factor = ((gamma^2/4 + w^2)^(1/2) - gamma/2) / w,   w^2 = 2 DEPTH/I_2 at the passes

    Source: Kramers, Physica 7 (1940) 284, eq. (25); Haenggi, Talkner & Borkovec, Rev. Mod. Phys.
    62 (1990) 251, eq. (4.33).
    """
    kT = DEPTH / depth
    angle = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    speed = np.sqrt(np.cos(angle) ** 2 / MOMENTS[1] + np.sin(angle) ** 2 / MOMENTS[0])
    flux = (
        math.sqrt(kT / (2.0 * np.pi)) * (speed * np.exp(-SUMMIT * np.sin(angle) ** 2 / kT)).mean()
    )
    height, weight = np.polynomial.legendre.leggauss(400)
    up = 0.5 * (height + 1.0)[:, None]  # u_3 from 0 to 1
    energy = SUMMIT * (1.0 - up * up) * np.sin(angle) ** 2 - DEPTH * up * up
    well = 0.5 * (weight * np.exp(-energy / kT).mean(axis=1)).sum()
    w = math.sqrt(2.0 * DEPTH / MOMENTS[1])
    return flux / well, (math.sqrt(FRICTION**2 / 4.0 + w * w) - FRICTION / 2.0) / w

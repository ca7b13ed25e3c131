"""Derivatives against an integration that shares no code with the package: complex steps.

Euler's equations with the full tensor, in complex numbers, by scipy: the imaginary part of the end
for a number x + 1e-30 i is its derivative, without differences. Quantiles come from scipy and
mpmath. Widths, bounds and mixtures of distributions; and event times that graze, come at a save, or
never come.
"""

import math

import mpmath as mp
import numpy as np
import pytest
from scipy import optimize
from scipy.integrate import solve_ivp

import rigidmc as rm
from rigidmc.engine.kernel import layout
from tests.planning.test_tangents import rows_of, tangents

STEP = 1e-30  # of the imaginary part: its square is below rounding
RUN = {"integrator": "rk8", "dt": 0.005, "t_end": 1.0}
OMEGA, ANGLES, G = (1.0, 2.0, 3.0), (0.1, 0.7, 0.3), 9.81
TENSOR = ((2.0, 0.2, -0.1), (0.2, 3.0, 0.3), (-0.1, 0.3, 4.0))
CENTRE = (0.11, -0.21, 0.34)
HEAVY = {"tensor": TENSOR, "mass": 1.5, "centre": CENTRE, "omega": OMEGA, "angles": ANGLES, "g": G}


def about(axis, angle):
    """The matrix of a turn about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3, dtype=complex)
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
    return turn


def cross(a, b):
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def motion(tensor, mass, centre, omega, angles, g, t_end=1.0):
    """The solution of a heavy body, angular velocity (3,) and rows of the attitude matrix (9,)."""
    inertia, c = np.array(tensor, dtype=complex), np.array(centre, dtype=complex)
    inverse = np.linalg.inv(inertia)
    phi, theta, psi = angles
    start = about(2, phi) @ about(0, theta) @ about(2, psi)

    def rate(t, y):
        w, turn = y[:3], y[3:].reshape(3, 3)
        torque = cross(c, -mass * g * turn[2])  # the weight in body axes
        spin = inverse @ (torque - cross(w, inertia @ w))
        return np.concatenate([spin, np.stack([cross(row, w) for row in turn]).ravel()])

    y = np.concatenate([np.array(omega, dtype=complex), start.ravel()])
    return solve_ivp(rate, (0.0, t_end), y, "DOP853", rtol=1e-13, atol=1e-14)


def marked(name, i=None, j=None):
    """HEAVY with an imaginary part in one number; a tensor stays symmetric."""
    values = dict(HEAVY)
    whole = np.array(values[name], dtype=complex)
    if j is not None:
        whole[i, j] += 1j * STEP
        if i != j:
            whole[j, i] += 1j * STEP
    elif whole.ndim:
        whole[i] += 1j * STEP
    else:
        whole = whole + 1j * STEP
    return values | {name: whole}


def off(found, expected):
    """The relative error of derivatives; of those that are 0, the error over 0.01."""
    return float(np.abs(found - expected).max() / max(np.abs(expected).max(), 0.01))


def moved_quantile(quantile, u, p, key):
    """dx/dp at the fixed probability u, by a difference of 40 digits."""
    with mp.workdps(40):
        h = mp.mpf(10) ** -14
        at = [quantile(u, p | {key: mp.mpf(p[key]) + sign * h}) for sign in (1, -1)]
        return float((at[0] - at[1]) / (2 * h))


def normal_probability(x, p):
    return mp.ncdf((mp.mpf(x) - p["mean"]) / p["sd"])


def normal_quantile(u, p):
    return p["mean"] + p["sd"] * mp.sqrt(2) * mp.erfinv(2 * u - 1)


def part(p, i):
    """The numbers of a part of the mixture, by which a member is drawn alone."""
    return {"mean": p[f"{i}.mean"], "sd": p[f"{i}.sd"]}


def mixture_probability(x, p):
    i = "1" if x < 1.5 else "2"
    return i, normal_probability(x, part(p, i))


def mixture_quantile(u, p):
    return normal_quantile(u[1], part(p, u[0]))


def truncated_quantile(u, p):
    low, high = (normal_probability(p[key], p) for key in ("low", "high"))
    return normal_quantile(low + u * (high - low), p)


LAWS = {
    # {name: (distribution, its numbers, quantile, probability, {name in wrt: key})}
    "normal": (
        rm.normal(1.0, 0.3), {"mean": 1.0, "sd": 0.3}, normal_quantile, normal_probability,
        {"mean": "mean", "standard_deviation": "sd"},
    ),
    "uniform": (
        rm.uniform(0.5, 1.5), {"low": 0.5, "high": 1.5},
        lambda u, p: p["low"] + u * (p["high"] - p["low"]),
        lambda x, p: (mp.mpf(x) - p["low"]) / (p["high"] - p["low"]),
        {"low": "low", "high": "high"},
    ),
    "truncated": (
        rm.normal(1.0, 0.3).between(0.8, 1.9),
        {"mean": 1.0, "sd": 0.3, "low": 0.8, "high": 1.9}, truncated_quantile,
        lambda x, p: (normal_probability(x, p) - normal_probability(p["low"], p))
        / (normal_probability(p["high"], p) - normal_probability(p["low"], p)),
        {"mean": "mean", "standard_deviation": "sd", "between.1": "low", "between.2": "high"},
    ),
    "one side": (
        rm.normal(1.0, 0.3).between(1.2, math.inf),
        {"mean": 1.0, "sd": 0.3, "low": 1.2, "high": mp.inf}, truncated_quantile,
        lambda x, p: (normal_probability(x, p) - normal_probability(p["low"], p))
        / (1 - normal_probability(p["low"], p)),
        {"mean": "mean", "standard_deviation": "sd", "between.1": "low"},
    ),
    "far tail": (
        rm.normal(1.0, 0.1).between(1.5, 1.6),
        {"mean": 1.0, "sd": 0.1, "low": 1.5, "high": 1.6}, truncated_quantile,
        lambda x, p: (normal_probability(x, p) - normal_probability(p["low"], p))
        / (normal_probability(p["high"], p) - normal_probability(p["low"], p)),
        {"mean": "mean", "standard_deviation": "sd", "between.1": "low", "between.2": "high"},
    ),
    "exponential": (
        rm.distribution("expon", loc=0.5, scale=0.4), {"loc": 0.5, "scale": 0.4},
        lambda u, p: p["loc"] - p["scale"] * mp.log1p(-u),
        lambda x, p: 1 - mp.exp(-(mp.mpf(x) - p["loc"]) / p["scale"]),
        {"loc": "loc", "scale": "scale"},
    ),
    "truncated exponential": (
        rm.distribution("expon", loc=0.5, scale=0.4).between(0.7, 1.3),
        {"loc": 0.5, "scale": 0.4, "low": 0.7, "high": 1.3},
        lambda u, p: p["loc"] - p["scale"] * mp.log(
            (1 - u) * mp.exp(-(p["low"] - p["loc"]) / p["scale"])
            + u * mp.exp(-(p["high"] - p["loc"]) / p["scale"])),
        lambda x, p: (mp.exp(-(p["low"] - p["loc"]) / p["scale"])
                      - mp.exp(-(mp.mpf(x) - p["loc"]) / p["scale"]))
        / (mp.exp(-(p["low"] - p["loc"]) / p["scale"])
           - mp.exp(-(p["high"] - p["loc"]) / p["scale"])),
        {"loc": "loc", "scale": "scale", "between.1": "low", "between.2": "high"},
    ),
    "mixture": (
        rm.mixture((0.4, rm.normal(1.0, 0.05)), (0.6, rm.normal(2.0, 0.1))),
        {"1.mean": 1.0, "1.sd": 0.05, "2.mean": 2.0, "2.sd": 0.1},
        mixture_quantile, mixture_probability,
        {f"{i}.{word}": f"{i}.{key}" for i in "12"
         for word, key in (("mean", "mean"), ("standard_deviation", "sd"))},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
def test_parameters_of_distributions(name):
    """At the start, by which tests/runs/test_derivatives_of_effects.py differentiates runs."""
    law, numbers, quantile, probability, words = LAWS[name]
    scene = rm.Scene(rm.Body.from_moments((2.0, 3.0, 4.0)), start=rm.Start(omega=(law, 2.0, 3.0)))
    names, row = [f"start.omega.1.{word}" for word in words], layout.MOMENTUM
    most = 3e-12 if name == "far tail" else 1e-13  # measured 2.1e-12, and 3.3e-14
    found = 0.5 * tangents(scene, names, 8)[:, row]
    for k, x in enumerate((0.5 * rows_of(scene, 8)[row]).tolist()):
        with mp.workdps(40):
            u = probability(x, numbers)
        for one, key in zip(found, words.values(), strict=True):
            by = moved_quantile(quantile, u, numbers, key)
            assert off(one[k], by) < most, (name, key, x)


WRT = {
    "start.omega.1": ("omega", 0), "start.attitude.theta": ("angles", 1),
    "effects.gravity.g": ("g",), "body.mass": ("mass",), "body.tensor.1.2": ("tensor", 0, 1),
}  # fmt: skip


def height(values, t):
    """The cosine of the lean of axis 3 at a time, with its imaginary part, and its rate."""
    y = motion(**values, t_end=t).y[:, -1]
    w, turn = y[:3], y[3:].reshape(3, 3)
    return turn[2, 2], cross(turn[2], w)[2].real


def passage(angle, t_end=2.0, **more):
    """The time of passage, and its derivatives by WRT."""
    body = rm.Body.from_tensor(np.array(TENSOR), 1.5, CENTRE)
    start, cone = rm.Start(omega=OMEGA, attitude=ANGLES), rm.Passage(3, angle, **more)
    scene = rm.Scene(body, rm.Gravity(G), start, observables=(cone,))
    run = RUN | {"t_end": t_end, "every": min(0.25, t_end), "members": 1}
    ds = rm.simulate(scene, wrt=tuple(WRT), save=("omega", "passage"), **run)
    return float(ds.passage_first[0]), ds.d_passage_first.values[:, 0]


def expected_at(t):
    """The derivatives by WRT of the time at which the lean passes its value at t."""
    at = [height(marked(field, *place), t) for field, *place in WRT.values()]
    return np.array([-value.imag / STEP / rate for value, rate in at])


@pytest.mark.slow
@pytest.mark.parametrize("t", [0.004, 0.005, 0.1, 0.25, 0.3333, 0.5, 0.75, 1.0, 1.1])
@pytest.mark.parametrize("t_end", [2.0, None])
def test_times_of_events_at_and_between_saves(t, t_end):
    """Times at steps, at saves, at the end of the run (None), and between."""
    angle = math.acos(height(HEAVY, t)[0].real)
    found, derivatives = passage(angle, t_end or math.ceil(t / 0.005 - 1e-9) * 0.005)
    if t_end is None and math.isnan(found):  # rounding puts it after the end
        assert np.isnan(derivatives).all()
        return
    assert abs(found - t) < 1e-11
    assert off(derivatives, expected_at(t)) < 1e-12, t  # measured 9.6e-14


def turning_point():
    """(time, lean) of the largest lean."""
    t = optimize.brentq(lambda t: height(HEAVY, t)[1], 1.1, 1.4, xtol=1e-14)
    return t, math.acos(height(HEAVY, t)[0].real)


@pytest.mark.slow
def test_times_of_events_that_graze():
    """The lean exceeds the angle by less and less: derivatives grow as the root of it.

    Below 5e-8 rad the eight steps back to an event do not converge: at 1e-8 rad its time is off by
    5e-8 s, and the derivatives by 6e-4.
    """
    top, lean = turning_point()
    for short in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        angle = lean - short
        level = math.cos(angle)

        def beyond(t, level=level):
            return height(HEAVY, t)[0].real - level

        t = optimize.brentq(beyond, top - 0.25, top, xtol=1e-15)
        found, derivatives = passage(angle)
        assert abs(found - t) < 1e-10, short  # measured 6.4e-12
        # the rate of the lean at the passage loses digits: measured 2.1e-15/short
        assert off(derivatives, expected_at(t)) < 1e-12 + 1e-14 / short, short


@pytest.mark.slow
def test_events_that_never_come_and_that_are_there_at_the_start():
    _, lean = turning_point()
    for more in (1e-9, 1e-4, 0.5):
        found, derivatives = passage(lean + more)
        assert math.isnan(found) and np.isnan(derivatives).all()
    for less in (1e-9, 0.1):
        found, derivatives = passage(ANGLES[1] - less)
        assert found == 0.0 and not derivatives.any()

"""Public closed forms at their limits, in tiny and huge units, against mpmath; and their errors."""

import itertools

import mpmath as mp
import numpy as np
import pytest

import rigidmc as rm
from tests.mechanics import oracles
from tests.tools.reference import apart

POLE = 4e-16  # of a level or vertical axis: the rounding of pi/2 and pi
ANGLES = (0.0, 1e-12, 1e-5, 0.4, 0.5 * np.pi, 2.0, np.pi - 1e-7, np.pi)


def tops(seeds):
    """Yield (I1, I3, k, omega3, theta, p_phi, p_psi) of tops in units from 1e-40 to 1e40."""
    for seed in seeds:
        some = np.random.default_rng(seed)
        unit, time = 10.0 ** some.integers(-40, 41), 10.0 ** some.integers(-20, 21)
        first, third = some.uniform(0.5, 1.0, 2) * unit
        third = some.choice([third, first])
        k = some.choice([0.0, 1.0, -1.0, 1e-9]) * some.uniform(0.5, 2.0) * unit / time**2
        theta = float(some.choice([*ANGLES, some.uniform(0.0, np.pi)]))
        least = rm.least_spin((first, first, third), k, theta) or some.choice([0.0, 1.0]) / time
        spin = some.choice([0.0, 0.999, 1.0, 1.001, 30.0, 1e7]) * some.choice([-1.0, 1.0]) * least
        p_psi, p_phi = some.normal(size=2) * unit / time
        p_phi = some.choice([p_phi, p_psi, -p_psi, p_psi * np.cos(theta), 0.0])
        yield tuple(map(float, (first, third, k, spin, theta, p_phi, p_psi)))


def cosine(theta):
    """Return the cosine of an angle that is pi/2 or pi to rounding."""
    c = mp.cos(theta)
    return mp.mpf(0) if abs(c) <= 2.0 * POLE else c


def worst_of_tops(seeds):
    """Return the largest backward errors of steady precession, least spin, growth, potential."""
    worst = np.zeros(4)
    for first, third, k, spin, theta, p_phi, p_psi in tops(seeds):
        moments, case = (first, first, third), (first, third, k, spin, theta, p_phi, p_psi)
        with mp.workdps(60):
            a, s, w, c = mp.mpf(first), mp.mpf(third) * spin, mp.mpf(k), cosine(theta)
            square, limit = s * s, 4 * a * w * c
            exists = square - limit >= -4e-15 * square and not (c == 0 and s == 0 and w != 0)
            least = mp.sqrt(max(limit, 0)) / third
            growth = mp.sqrt(max(4 * a * w - square, 0)) / (2 * a)
            if exists:
                roots = rm.steady_precession(moments, k, spin, theta)
                assert np.isfinite(roots.slow) and abs(roots.slow) <= abs(roots.fast) * (1 + 1e-7)
                assert np.isinf(roots.fast) == (c == 0), case
            else:
                with pytest.warns(rm.SceneWarning, match="needs a spin above"):
                    roots = rm.steady_precession(moments, k, spin, theta)
                assert np.isnan(roots).all()
            for root in roots if exists else ():
                if np.isfinite(root):
                    terms = a * c * mp.mpf(root) ** 2, -s * root, w
                    size = sum(map(abs, terms))
                    worst[0] = max(worst[0], float(abs(sum(terms)) / size) if size else 0.0)
            found = mp.mpf(rm.least_spin(moments, k, theta))
            worst[1] = max(worst[1], float(abs(found - least) / least) if least else float(found))
            found, size = mp.mpf(rm.tilt_growth(moments, k, spin)), max(abs(4 * a * w), square)
            error = abs(found**2 - growth**2) * 4 * a * a
            worst[2] = max(worst[2], float(error / size) if size else 0.0)
            # the potential, by halves of theta
            s, c = mp.sin(mp.mpf(theta) / 2), mp.cos(mp.mpf(theta) / 2)
            c = mp.mpf(0) if abs(theta - np.pi) <= POLE else c
            down, up = (mp.mpf(p_phi) - p_psi) / 2, (mp.mpf(p_phi) + p_psi) / 2
            found = rm.effective_potential(moments, k, p_phi, p_psi, theta)
            if (s == 0 and down) or (c == 0 and up):
                assert np.isposinf(found), case
                continue
            down, up = down * c / s if s else mp.mpf(0), up * s / c if c else mp.mpf(0)
            rest = mp.mpf(p_psi) ** 2 / (2 * mp.mpf(third)), w * (c * c - s * s)
            size = (abs(down) + abs(up)) ** 2 / (2 * a) + sum(map(abs, rest)) + abs(w)
            error = abs(found - ((down + up) ** 2 / (2 * a) + sum(rest)))
            worst[3] = max(worst[3], float(error / size) if size else float(abs(found)))
    return worst


@pytest.mark.parametrize(
    "seeds", [range(300), pytest.param(range(300, 5000), marks=pytest.mark.slow)], ids=str
)
def test_steady_motions_at_their_limits(seeds):
    """Before, tops without weight and spin were nan, and so was every second top at its least
    spin."""
    # measured 1.9e-16, 2.2e-16, 3.3e-16, 4.3e-16
    assert worst_of_tops(seeds).max() < 4e-15


def either(q, truth):
    """Return the largest difference of an attitude from either of the two quaternions of one."""
    truth = np.array(truth, float)
    return min(apart(q, truth), apart(q, -truth))


def worst_of_motions(seeds):
    """Return the largest differences of attitudes of free, weightless and heavy tops from mpmath,
    over 1 + the largest angle, in units from 1e-40 to 1e40."""
    worst = np.zeros(3)
    for seed in seeds:
        some = np.random.default_rng(seed)
        unit, time = (10.0 ** some.integers(-40, 41) for _ in range(2))
        first, third = some.uniform(0.55, 1.0, 2)
        third = float(some.choice([third, first, first * (1.0 + 1e-13), 2.0 * first]))
        l = some.normal(size=3) * some.choice([0.0, 1e-9, 1.0, 30.0])
        l = l * some.choice([(1, 1, 1), (0, 0, 1), (1, 1, 0)])
        t = float(some.choice([0.0, 1e-6, 1.0, -300.0]))
        l, moments = l * unit / time, (first * unit, first * unit, third * unit)
        size = 1.0 + np.linalg.norm(l) / moments[0] * abs(t * time)
        truth, start = oracles.symmetric(moments, l, t * time)[0], (1.0, 0.0, 0.0, 0.0)
        free = rm.solve_free_top(moments, l, start, t * time)
        weightless = rm.solve_lagrange_top(moments, 0.0, l, start, t * time)
        for i, found in enumerate((free, weightless)):
            worst[i] = max(worst[i], either(found.attitude, truth) / size)
        # heavy, with a nutation
        k, q = some.uniform(0.5, 2.0) * unit / time**2, some.normal(size=4)
        q /= np.linalg.norm(q)
        l = some.normal(size=3) * some.choice([0.3, 3.0, 30.0]) * unit / time
        end, _ = oracles.lagrange(*moments[1:], k, l, q, t * time)
        found = rm.solve_lagrange_top(moments, k, l, q, t * time).attitude
        rate = np.linalg.norm(l) / moments[0] + np.sqrt(k / moments[0])
        worst[2] = max(worst[2], either(found, end) / (1.0 + rate * abs(t * time)))
    return worst


@pytest.mark.parametrize(
    ("seeds", "bound"),
    [(range(25), 1e-14), pytest.param(range(25, 500), 1e-13, marks=pytest.mark.slow)],
    ids=str,
)
def test_motions_at_their_limits(seeds, bound):
    worst = worst_of_motions(seeds)
    assert (worst < bound).all(), worst  # measured 4e-16, 1.7e-15, 1.1e-15


TOP = {"moments": (1.0, 1.0, 0.6), "weight": 1.3}
STATE = {"momentum": (0.1, 0.3, 2.0), "attitude": (0.9, 0.3, 0.2, 0.1)}
CLOSED_FORMS = {
    rm.solve_free_top: {"moments": (1.0, 2.0, 2.5), **STATE, "t": 0.7},
    rm.analyse_free_top: {"moments": (1.0, 2.0, 2.5), "momentum": (0.1, 0.3, 2.0)},
    rm.solve_lagrange_top: {**TOP, **STATE, "t": 0.7},
    rm.analyse_lagrange_top: {**TOP, **STATE},
    rm.effective_potential: {**TOP, "p_phi": 0.3, "p_psi": 0.7, "theta": 0.4},
    rm.steady_precession: {**TOP, "omega3": 9.0, "theta": 0.4},
    rm.least_spin: {**TOP, "theta": 0.4},
    rm.tilt_growth: {**TOP, "omega3": 1.0},
    rm.omega_from_euler_rates: {"angles": (0.1, 0.4, 0.2), "rates": (1.0, 2.0, 3.0)},
    rm.euler_rates: {"angles": (0.1, 0.4, 0.2), "omega": (1.0, 2.0, 3.0)},
}
ARGUMENTS = [(form, name) for form, known in CLOSED_FORMS.items() for name in known]


def last(found):
    """Return the arrays of a result as one list."""
    arrays = found if isinstance(found, tuple) else (found,)
    return [x for x in arrays if np.asarray(x).dtype.kind == "f"]


@pytest.mark.parametrize(("form", "name"), ARGUMENTS, ids=lambda x: getattr(x, "__name__", x))
def test_bad_numbers_are_refused_by_name_and_value(form, name):
    """Before, 21 of 34 arguments gave nan without a word, and moments could be negative."""
    known = CLOSED_FORMS[form]
    good = np.asarray(known[name], float)
    for number in (np.nan, np.inf, -np.inf, *((-1.0, 0.0) if name == "moments" else ())):
        bad = good.copy()
        bad[... if good.ndim == 0 else good.size - 1] = number
        with pytest.raises(rm.SceneError) as caught:
            form(**known | {name: bad})
        error = caught.value
        if name != "attitude":
            assert error.at == name and str(float(number)) in str(error), str(error)
        # a row of three is counted, and the others keep their bits
        rows = np.stack([good, bad, good])
        with pytest.warns(rm.SceneWarning, match="1 of 3 elements are nan in the result") as told:
            found = last(form(**known | {name: rows}))
        assert name == "attitude" or f"{name} = " in str(told[0].message)
        for values, wanted in zip(found, last(form(**known)), strict=True):
            assert np.isnan(values[1]).all()
            assert np.array_equal(values[0], wanted) and np.array_equal(values[2], wanted)
    with pytest.raises(rm.SceneError, match=name):
        form(**known | {name: "five"})


def test_shapes_that_do_not_broadcast_are_refused():
    for form, known in CLOSED_FORMS.items():
        for one, other in itertools.combinations(known, 2):
            rows = {one: [known[one]] * 2, other: [known[other]] * 3}
            with pytest.raises(rm.SceneError, match="broadcast"):
                form(**known | {name: np.array(x) for name, x in rows.items()})

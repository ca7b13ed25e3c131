"""Integrators of a user's own: wrong facts and wrong steps are refused before they are compiled."""

import inspect
from typing import NamedTuple

import pytest

import rigidmc as rm
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.protocols import linear_combination, normalised, scaled, state_rates
from rigidmc.scene.user_parts.integrators import check_user_integrator
from tests.tools.reference import apart
from tests.tools.scenes import TOP


class Ralston(NamedTuple):
    """Ralston's method of order 2."""

    order, evaluations, is_reversible, conserves = 2, 2, False, ("|q|",)
    accepts, compensated = "any torque", False

    def step(self, body, effects, t, h, q, l):
        y, rates = (q, l), scaled(body, h)
        k1 = state_rates(rates, effects, body, t, h, q, l)
        z = linear_combination(y, (2 / 3,), (k1,))
        k2 = state_rates(rates, effects, body, t + 2 * h / 3, h, z[0], z[1])
        q, l = linear_combination(y, (1 / 4, 3 / 4), (k1, k2))
        return normalised(q), l


def short(self, q, l):
    return q, l[:2]


def still(self, q, l):
    return q, l


def asks(self, q, speed):
    return q, speed


def with_facts(**facts):
    """Ralston with other facts or another step, as a user may have them; None for none."""
    kind = type("Own", (Ralston,), {})
    for name, value in facts.items():
        setattr(kind, name, value)
    return kind()


@pytest.mark.parametrize(("facts", "words"), [
    ({"order": 3}, "Own.order: is 3, but the error of a step falls as for order 2.0"),
    ({"order": "2"}, "Own.order: is '2', expected a number"),
    ({"evaluations": 4}, "Own.evaluations: is 4, but a step evaluates 2 torques"),
    ({"is_reversible": True}, "Own.is_reversible: is True, but a step of -h after one of h ends"),
    ({"conserves": ("|q|", "T")}, "Own.conserves: names T, which a step of a free body changes"),
    ({"conserves": ("E",)}, "Own.conserves: is .'E',., expected a tuple of some of .q., "),
    ({"accepts": "all"}, "Own.accepts: is 'all', expected 'any torque' or 'no torque'"),
    ({"step": short}, r"Own.step: returns .*expected \(q, L\): tuples of 4 and 3 numbers"),
    ({"step": still}, "Own.evaluations: is 2, but a step evaluates 0 torques"),
    ({"step": asks}, "Own.step: unknown argument 'speed'; it may name body, effects, t, h"),
])  # fmt: skip
def test_wrong_facts_and_steps_are_refused(facts, words):
    with pytest.raises(rm.SceneError, match=words):
        rm.prepare(TOP.with_run(integrator=with_facts(**facts)))


class Bare(NamedTuple):
    """An integrator without facts."""

    def step(self, q, l):
        return q, l


class RK4(NamedTuple):
    """A class with the name of another one."""

    def step(self, q, l):
        return q, l


def test_what_is_no_integrator_is_refused():
    for value, words in (
        (Bare(), "Bare.order: is missing"),
        (RK4(), "'rk4' is an integrator of the package"),
        (Ralston, "Ralston: expected a name, or an integrator such as Kutta38"),
        (1.0, "float: expected a name"),
    ):
        with pytest.raises(rm.SceneError, match=words):
            TOP.with_run(integrator=value)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_the_integrators_of_the_package_pass(name):
    """What is refused is wrong: all facts of all others hold in the same trial."""
    if implements(INTEGRATORS[name], "step"):
        check_user_integrator(INTEGRATORS[name], name)


def test_an_integrator_runs_with_its_order_and_a_changed_one_is_compiled_anew():
    run = {"members": 4, "t_end": 2.0}
    true = rm.simulate(TOP, "rk8", dt=0.02, **run).omega
    coarse, fine = (
        apart(rm.simulate(TOP, Ralston(), dt=dt, **run).omega, true) for dt in (0.02, 0.01)
    )
    assert 3.5 < coarse / fine < 4.5  # measured 3.99
    source = inspect.getsource(Ralston).replace("(1 / 4, 3 / 4)", "(0.0, 1.0)")
    names = {**globals(), "NamedTuple": NamedTuple}
    exec(source.replace("2 / 3", "1 / 2").replace("2 * h / 3", "h / 2"), names)  # midpoint rule
    other = rm.simulate(TOP, names["Ralston"](), dt=0.02, **run)
    assert other.attrs["integrator"] == "ralston"
    # measured 1.027: another method of its order
    assert 1.01 < apart(other.omega, true) / coarse < 1.1

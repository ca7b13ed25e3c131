"""One loop over all observables: shape, facts, outputs, and values against NumPy."""

import math

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects import Gravity
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import bare_observables, monitors, outputs, statistics
from rigidmc.physics.observables import protocol as P
from rigidmc.physics.observables.compiled import begin, update, value
from tests.tools.kernels import one_step, prepare
from tests.tools.reference import rotation

MOMENTS, STATIC = np.array([0.6, 0.8, 1.0]), np.array([0.1, -0.2, 0.3])
BODY = MassProperties.of(tuple(MOMENTS), tuple(STATIC))
Q, L = (0.5, -0.1, 0.7, math.sqrt(0.25)), (1.8, 0.4, -0.9)
START = 3.0, 1 / 2.0, 5.0, 1 / 5.0  # energy and 1/its scale, |L|^2 and 1/|L|^2
ENERGY = 0.5 * np.sum(np.square(L) / MOMENTS) + 9.81 * (rotation(Q) @ STATIC)[2]

TRUE = {
    "omega": np.divide(L, MOMENTS),
    "momentum": L,
    "principal_omega": np.divide(L, MOMENTS),
    "principal_momentum": L,
    "attitude": Q,
    "energy": ENERGY,
    "l2": np.dot(L, L),
    "energy_drift": (ENERGY - 3.0) / 2.0,
    "l2_drift": (np.dot(L, L) - 5.0) / 5.0,
    "work": 1.5,
}
BARE = bare_observables()
NUMBERS = {  # of summaries that need some
    "passage": {"axis": 3, "angle": 0.5},
    "histogram": {"of": "energy", "low": 0.0, "high": 1.0},
}


@pytest.mark.parametrize("name", BARE)
def test_value_and_facts(name):
    kind = BARE[name]
    found = value(kind(), BODY, (Gravity(9.81),), 0.0, Q, L, START, (1.5,))
    assert len(found) == P.size(kind.dims, 1)
    if name in TRUE:
        assert np.allclose(found, TRUE[name], rtol=1e-15, atol=1e-15)
    assert np.isfinite(found).all()
    assert isinstance(kind(), P.Observable)
    for fact in (kind.units, kind.long_name, kind.__doc__):
        assert isinstance(fact, str) and fact


def test_every_observable_has_its_value_in_numpy():
    assert TRUE.keys() == BARE.keys()  # a new one: add its value to TRUE


LAWS = {"energy": True, "energy_drift": True, "lz": True, "l2": False}  # also under gravity?


def change_along(kind, effects):
    """Largest change of an observable along 0.4 s of motion, in 20 steps of rk8."""
    made, q, l = prepare(INTEGRATORS["rk8"], 0.1, effects), Q, L
    first, largest = value(kind(), BODY, effects, 0.0, Q, L, START, (1.5,)), 0.0
    for i in range(20):
        q, l = one_step(made, BODY, effects, 0.02 * i, 0.02, q, l)
        now = value(kind(), BODY, effects, 0.02 * (i + 1), q, l, START, (1.5,))
        largest = max(largest, float(np.abs(np.subtract(now, first)).max()))
    return largest


@pytest.mark.parametrize("name", [name for name, kind in BARE.items() if kind.conserved])
def test_a_law_that_an_observable_claims_holds(name):
    kind = BARE[name]
    assert change_along(kind, (Gravity(9.81),) * LAWS[kind.conserved]) < 1e-13  # measured 2e-15


@pytest.mark.parametrize("name", ["omega", "momentum", "attitude", "l2"])
def test_what_is_not_conserved_changes(name):
    assert change_along(BARE[name], (Gravity(9.81),)) > 0.1  # measured 0.43 to 0.85


def over_steps():
    """{label: observable} of everything over all steps."""
    summaries = {name: kind(**NUMBERS.get(name, {})) for name, kind in monitors().items()}
    return summaries | {name: kind(BARE[of]()) for name, (of, kind) in statistics().items()}


@pytest.mark.parametrize("label", over_steps())
def test_outputs_over_all_steps(label):
    one = over_steps()[label]
    one.check()
    every = P.Event, P.Running, P.Growth, P.NoiseSum, P.EnsembleObservable
    kinds = [kind for kind in every if isinstance(one, kind)]
    assert len(kinds) == 1
    facts, some = outputs(label, one), np.ones(2)
    assert all(units and text and "{" not in text for units, text, _ in facts.values())
    if kinds == [P.Event]:
        found = one.results(P.EventRecord(*[some] * 7))
    elif kinds == [P.Running]:
        kept = begin(one, BODY, (), 0.0, Q, L)
        assert len(kept) == len(update(one, kept, BODY, (), 0.1, Q, L)) == one.state_size
        found = one.results(np.array([kept, kept]).T, some)
    elif kinds == [P.Growth]:
        found = one.results(np.ones((3, 2)), some)
    elif kinds == [P.NoiseSum]:
        found = one.results(np.ones((7, 2)))
    else:
        found = {}
        assert one.counts(np.ones((5, 2))).shape == (5, one.edges().size + 1)
    assert len(found) == len(facts)
    for values, (_, _, dims) in zip(found.values(), facts.values(), strict=True):
        assert values.shape == (*[P.size((dim,)) for dim in dims], 2)
    if label in monitors():
        assert list(found) == list(one.outputs)


def test_a_drift_is_relative_to_a_thousandth_of_the_energies_in_play_at_least():
    """E(0) is 2e-4 kinetic, under 1e-3 of the 3 J in play, and 2 J beyond it."""
    body = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.0, 0.0, 0.3))
    for spin, relative_to in ((0.02, 1e-3 * (3.0 + 2e-4)), (2.0, 2.0)):
        level = np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0
        scene = rm.Scene(body, rm.Gravity(10.0), rm.Start(omega=(spin, 0.0, 0.0), attitude=level))
        run = {"dt": 0.1, "t_end": 2.0, "every": 0.5, "members": 2, "checks": False}
        ds = rm.simulate(scene, "rk4", **run, save=("energy", "energy_drift"))
        change = (ds.energy - ds.energy[0]).values[1:]
        assert np.abs(change).min() > 1e-9
        assert np.allclose(change / ds.energy_drift.values[1:], relative_to, rtol=1e-6)

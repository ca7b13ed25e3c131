"""One loop over OBSERVABLES: shape, facts, and values against NumPy."""

import math

import numpy as np
import pytest

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects import Gravity
from rigidmc.observables import OBSERVABLES
from rigidmc.observables.protocol import value
from tests.kernels import SIZES
from tests.reference import rotation

MOMENTS, STATIC = np.array([0.6, 0.8, 1.0]), np.array([0.1, -0.2, 0.3])
BODY = MassProperties.of(tuple(MOMENTS), tuple(STATIC))
Q, L = (0.5, -0.1, 0.7, math.sqrt(0.25)), (1.8, 0.4, -0.9)
START = 3.0, 1 / 2.0, 5.0, 1 / 5.0  # energy and 1/its scale, |L|^2 and 1/|L|^2
ENERGY = 0.5 * np.sum(np.square(L) / MOMENTS) + 9.81 * (rotation(Q) @ STATIC)[2]

TRUE = {
    "omega": np.divide(L, MOMENTS),
    "momentum": L,
    "attitude": Q,
    "energy": ENERGY,
    "l2": np.dot(L, L),
    "energy_drift": (ENERGY - 3.0) / 2.0,
    "l2_drift": (np.dot(L, L) - 5.0) / 5.0,
    "work": 1.5,
}


def test_every_observable_has_a_truth_here():
    assert set(TRUE) == set(OBSERVABLES)


@pytest.mark.parametrize("name", OBSERVABLES)
def test_value_and_facts(name):
    kind = OBSERVABLES[name]
    found = value(kind(), BODY, (Gravity(9.81),), 0.0, Q, L, START, (1.5,))
    assert len(found) == {**SIZES, ("effect",): 1}[kind.dims]
    assert np.allclose(found, TRUE[name], rtol=1e-15, atol=1e-15)
    assert all(
        isinstance(fact, str) and fact for fact in (kind.units, kind.long_name, kind.__doc__)
    )

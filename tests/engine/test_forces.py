"""Torque and energy of ensembles against those of their members, one by one in plain Python."""

import numpy as np

from rigidmc.engine import formulas
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects import Gravity, ViscousDamping, canonical
from rigidmc.physics.effects.protocol import from_numbers, numbers
from rigidmc.physics.effects.sums import total_energy, total_torque
from tests.physics.effects.test_effects import EXAMPLES, MOMENTS, STATIC
from tests.tools.reference import apart

some = np.random.default_rng(4)
Q, L = some.normal(size=(4, 50)), some.normal(size=(3, 50))
Q /= np.linalg.norm(Q, axis=0)


def one(effects, i):
    return tuple(
        from_numbers(type(e), [float(np.broadcast_to(v, 50)[i]) for _, _, v in numbers(e)])
        for e in effects
    )


def worst(effects, torque, energy):
    body, off = MassProperties.of(MOMENTS, STATIC), 0.0
    for i, (q, l) in enumerate(zip(map(tuple, Q.T), map(tuple, L.T), strict=True)):
        mine = one(effects, i)
        energies = total_energy(mine, body, q), energy[i]
        off = max(off, apart(total_torque(mine, body, 0.0, q, l), torque[:, i]), apart(*energies))
    return off


def test_all_effects_at_once_compiled():
    effects, body = canonical(tuple(EXAMPLES.values())), MassProperties.of(MOMENTS, STATIC)
    effects = tuple(
        from_numbers(type(e), [v * some.uniform(0.8, 1.2, 50) for _, _, v in numbers(e)])
        for e in effects
    )
    found = formulas.evaluate_forces(effects, body, tuple(Q), tuple(L))
    assert worst(effects, found[:3], found[3]) < 2e-14  # measured 1.8e-15
    other = formulas.torques(effects, body, tuple(Q), tuple(L)), formulas.energies(effects, body, Q)
    assert worst(effects, *other) < 2e-14


def test_plain_functions_take_arrays_if_they_can():
    effects, body = (Gravity(2.0), ViscousDamping(0.1)), MassProperties.of(MOMENTS, STATIC)
    found = formulas.torques(effects, body, tuple(Q), tuple(L))
    assert worst(effects, found, formulas.energies(effects, body, tuple(Q))) == 0.0
    assert formulas.energies(effects, body, tuple(Q.reshape(4, 5, 10))).shape == (5, 10)

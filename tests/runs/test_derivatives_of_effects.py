"""Derivatives of runs with every effect, and of hard bodies and starts; see derivative_errors."""

import warnings

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.free_flow import free_flow
from rigidmc.physics.dynamics.quaternions import spin
from rigidmc.physics.dynamics.rotation_flows import symmetric_flow, turn_by_asymmetry
from rigidmc.physics.dynamics.so3 import cross
from tests.tools.derivative_errors import (
    AHEAD,
    HARD,
    NAMES,
    RUN,
    effect_case,
    errors,
    hard_case,
    has_kink,
    pairs,
)

compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
# Rounding of differences: measured 5.0e-11 (srkn11, spin about axis 1, heavy, by a moment)
MOST = 2e-10


@compiled
def test_derivatives_with_gravity_are_those_of_differences():
    """A sample of those below."""
    found = errors(effect_case("gravity"), "rk4") | errors(hard_case("upright top", True), "rk4")
    assert len(found) > 20 and max(found.values()) < MOST, found


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("integrator", NAMES)
def test_derivatives_are_those_of_differences(integrator):
    """Of every effect, and of hard bodies and starts."""
    for name, case in pairs(integrator):
        found = errors(case, integrator, has_kink(integrator, name))
        assert len(found) >= 9 and max(found.values()) < MOST, (name, found)


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["exact", "strang", "rotations"])
def test_values_of_symmetric_bodies_keep_their_bits(integrator):
    """They have a flow of their own, whose derivatives by moments leave the symmetry."""
    for name in HARD:
        case = hard_case(name, False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rm.SceneWarning)
            plain = rm.simulate(case.scene(), integrator, **RUN)
            found = rm.simulate(case.scene(), integrator, wrt=tuple(case.given), **RUN)
        for saved in RUN["save"]:
            assert np.array_equal(plain[saved], found[saved], equal_nan=True), (name, saved)


@pytest.mark.parametrize("axis", [0, 1, 2, None])
def test_the_change_of_a_symmetric_flow_if_its_moments_differ(axis):
    """Against the flow of any body. A sphere (None) counts as symmetric about axis 2."""
    some, e = np.random.default_rng(1), 1e-3
    inverse, e_axis = np.full(3, 1 / 1.5), 1 if axis is None else axis
    inverse[e_axis] = 1 / 1.5 if axis is None else 1.0
    one, three = (e_axis - 1) % 3, (e_axis + 1) % 3
    for _ in range(20):
        l, h = tuple(2.0 * some.normal(size=3)), some.uniform(0.1, 0.5)

        def flow(d, l=l, h=h):
            apart = inverse.copy()
            apart[one], apart[three] = apart[one] + d, apart[three] - d
            body = MassProperties.of(tuple(1.0 / apart), (0.0, 0.0, 0.0))
            return np.concatenate(free_flow(body, ((),) * 6, (1 / 64,) * 64, h, l))

        true = sum(w * (flow(k * e) - flow(-k * e)) / e for k, w in AHEAD.items())
        rounded = inverse.copy()
        if axis is not None:  # moments that are equal but for rounding keep the axis
            rounded[one] *= 1.0 + some.uniform(-1e-15, 1e-15)
        body = MassProperties.of(tuple(1.0 / rounded), (0.0, 0.0, 0.0))
        turn, change = symmetric_flow(body, h, l)
        _, eta = turn_by_asymmetry(body, h, l)
        # the code of the flow has 1/C - 1/A with A the moment of `one`, which changes by -d
        eta = np.array(eta)
        eta[e_axis] -= h * l[e_axis]
        found = np.concatenate([spin(turn, 0.5 * eta), cross(np.add(l, change), eta)])
        assert np.abs(found - true).max() < 2e-12  # measured 8e-13

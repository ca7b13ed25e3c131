"""Flips of bodies that differ: counted from saved states by another formula, and none of bodies
that have no middle axis."""

from itertools import pairwise

import numpy as np
import pytest

import rigidmc as rm

# three different moments, in three orders; then two or three equal ones, some but for rounding
BODIES = [
    (1.0, 2.0, 3.0), (1.0, 1.5, 2.0), (2.0, 1.5, 1.0), (1.0, 3.0, 2.0),
    (1.0, 1.0, 2.0), (2.0, 1.0, 2.0), (2.0, 2.0, 1.0), (1.0, 1.0, 1.0), (1.0, 1.0 + 1e-14, 2.0),
]  # fmt: skip
DIFFERENT = np.array([True] * 4 + [False] * 5)


def turned_over(omega, moments):
    """How often L about the middle axis changed its sign after it came within 60 degrees of it, of
    saved omega (times, 3, members)."""
    momentum = omega * moments
    middle = np.argsort(moments, axis=0)[1]
    part = np.take_along_axis(momentum, middle[None, None, :], axis=1)[:, 0]
    part /= np.linalg.norm(momentum, axis=1)
    counts = np.zeros(part.shape[1])
    for i, values in enumerate(part.T):
        armed = False
        for before, now in pairwise(values):
            armed |= abs(before) > 0.5
            if before * now < 0.0:
                counts[i] += armed
                armed = False
    return counts


@pytest.mark.parametrize("scale", [1e-20, 1.0, 1e20])
def test_bodies_without_a_middle_axis_in_a_table_do_not_flip(scale):
    moments = np.array(BODIES).T
    body = rm.Body.from_moments(tuple(scale * moments))
    scene = rm.Scene(body, start=rm.Start(omega=(0.6, 0.8, 0.5)))
    ds = rm.simulate(scene, dt=0.05, t_end=60.0, every=0.05, save=("omega", "flips"))
    counted = turned_over(ds.omega.transpose("time", "axis", "member").values, moments)
    assert (counted[DIFFERENT] >= 5).all() and counted[~DIFFERENT].max() == 9  # precession
    assert ds.flips.values.tolist() == np.where(DIFFERENT, counted, 0.0).tolist()
    assert np.isnan(ds.flip_first.values[~DIFFERENT]).all()
    # an axis that is named is asked of every body
    named = rm.simulate(scene, dt=0.05, t_end=60.0, save=(rm.Flips(axis=2),))
    assert named.flips.values[4] == 9.0

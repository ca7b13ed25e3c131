"""Extrema that are searched after the steps: noted steps, and their order."""

import math

import numpy as np
from numpy.polynomial import Polynomial

from rigidmc.engine.kernel.extrema import SubInterval, cubic_minimum, may_dip, running_extrema
from rigidmc.engine.kernel.running import first_note, may_change, noted_step
from rigidmc.physics.observables.nutation import Nutation, Precession

WHOLE = SubInterval(0.0, 1.0, 0.0, None, None)
RUNNING = ((Nutation(), (0.0, 0.0)),)


def test_notes_come_first_to_last():
    steps, notes = [3, 4, 17, 31], 0.0
    for s in range(32):
        notes = notes * 2.0 + (1.0 if s in steps else 0.0)
    found = []
    while notes > 0.0:
        note = first_note(notes)
        found.append(noted_step(note, 32.0))
        notes -= note
    assert found == steps
    assert noted_step(first_note(0.0), 32.0) == 0.0


def test_the_minimum_of_a_cubic_is_its_own():
    rng = np.random.default_rng(3)
    for _ in range(200):
        low, lowest, high = np.sort(rng.normal(size=3))
        width, scale = rng.uniform(0.5, 2.0), 10.0 ** rng.uniform(-9.0, 9.0)
        # its slope is 0 at `lowest` alone between the nodes
        slope = scale * Polynomial.fromroots((lowest, high + width if rng.random() < 0.5 else -9.0))
        slope = slope if slope.deriv()(lowest) > 0.0 else -slope
        cubic = slope.integ(k=scale)
        a, b = ((float(cubic(t)), float(slope(t))) for t in (low, high))
        place, value = cubic_minimum(a, b, WHOLE._replace(a=float(low), b=float(high)))
        assert abs(place - lowest) < 1e-12 * (1.0 + abs(lowest))  # measured 6.6e-16
        assert abs(value - cubic(lowest)) < 1e-12 * abs(np.array((*a, *b))).max()  # 4.6e-16


def test_no_step_with_a_mark_is_left_out():
    rng, marked, noted = np.random.default_rng(1), 0, 0
    for _ in range(20_000):
        size = 10.0 ** rng.uniform(-3.0, 0.0)
        low, values = rng.uniform(0.0, 0.4), rng.uniform(0.0, 1.0, 2)
        slopes = size * rng.normal(size=2)
        values[1] = values[0] + 0.3 * slopes.sum() * rng.normal()
        high = max(values) + size * rng.uniform(-0.1, 0.3)
        ends = [((float(v), float(s)),) for v, s in zip(values, slopes, strict=True)]
        state = ((min(low, *map(float, values)) - size * rng.uniform(-0.1, 0.3), float(high)),)
        (one,) = running_extrema(RUNNING, True, WHOLE, state, *ends)
        note = may_change(False, RUNNING, state, *ends)
        assert note or not one.mark
        marked, noted = marked + bool(one.mark), noted + bool(note)
    assert 500 < marked <= noted < 1.1 * marked  # nearly all notes are needed


def test_a_note_needs_slopes_of_opposite_sign():
    state = ((0.5, 0.5),)
    assert may_change(False, RUNNING, state, ((0.5, -0.1),), ((0.5, 0.1),))
    assert not may_change(False, RUNNING, state, ((0.5, 0.1),), ((0.5, 0.2),))
    assert not may_change(False, RUNNING, state, ((math.nan, -0.1),), ((0.5, 0.1),))
    assert not may_dip((math.nan, -0.1), (0.5, 0.1), WHOLE)


def test_a_merged_precession_counts_the_crossings_by_way_of_the_extremum():
    angles = [-0.2, 0.9 * math.pi, 1.1 * math.pi, 1.3 * math.pi]  # the extremum is the second
    points = [(math.cos(a), math.sin(a)) for a in angles]

    def after(state, point):
        way = 1.0 if state[0] * point[1] - state[1] * point[0] > 0.0 else -1.0
        return *point, state[2] + (way if (state[1] < 0.0) != (point[1] < 0.0) else 0.0), 1.0, 0.0

    before = (*points[0], 0.0, 1.0, 0.0)
    inserted = after(after(before, points[1]), points[2])
    without = after(before, points[2])
    assert inserted[2] != without[2]
    late = Precession().merged(after(without, points[3]), without, inserted)
    assert late == after(inserted, points[3])

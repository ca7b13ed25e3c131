"""Passages that count only once they have lasted: against stays found in saves of small steps."""

import math
from dataclasses import replace

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.planning.unit_scale import scale_scene

ANGLE, T_END = math.radians(60.0), 25.0
CASES = (  # of axis 3: (way, hold, at_start)
    ("leaves", 0.9, "count"),
    ("leaves", 0.9, "ignore"),
    ("reaches", 0.6, "count"),
)
TOPS = rm.Scene(
    rm.Body.from_moments((1.0, 1.3, 0.8), mass=1.0, centre=(0.02, 0.01, 0.1)),
    rm.Gravity(9.81),
    rm.Start(omega=(rm.normal(0.0, 2.0), rm.normal(0.0, 2.0), 1.0), attitude="uniform"),
    observables=tuple(rm.Passage(3, ANGLE, way, at_start=at, hold=hold) for way, hold, at in CASES),
)
RUN = {"t_end": T_END, "members": 96, "seed": 3}


def of(run, i):
    """Counts, first and last times of the passages of case i."""
    end = f"_{i + 1}" if i else ""
    return [run[f"{name}{end}"].values for name in ("passages", "passage_first", "passage_last")]


def stays(levels, times, hold, at_start):
    """(count, first, last) of the stays above 0 in saved levels (times, members); their ends by
    straight lines."""
    found = []
    for level in levels.T:
        up = np.flatnonzero((level[:-1] < 0.0) & (level[1:] >= 0.0))
        down = np.flatnonzero((level[:-1] >= 0.0) & (level[1:] < 0.0))
        begin, end = (
            times[k] + (times[k + 1] - times[k]) * level[k] / (level[k] - level[k + 1])
            for k in (up, down)
        )
        if level[0] >= 0.0:
            begin = np.append(0.0 if at_start == "count" else math.inf, begin)
        end = np.append(end, times[-1])[: begin.size]
        lasted = begin[end - begin >= hold]
        ends = (lasted[0], lasted[-1]) if lasted.size else (math.nan, math.nan)
        found.append((lasted.size, *ends))
    return np.array(found).T


@pytest.fixture(scope="module")
def saved():
    """(times, what the cosine of the tilt is beyond the cone) at small steps."""
    run = rm.simulate(TOPS, "rk8", dt=0.01, every=0.01, **RUN, save=("attitude",))
    return run.time.values, beyond_the_cone(run)


def beyond_the_cone(run):
    w, x, y, z = run.attitude.transpose("quat", "time", "member").values
    return w * w - x * x - y * y + z * z - math.cos(ANGLE)


def expected(saved, case, hold=None):
    (times, beyond), (way, time, at) = saved, case
    level = beyond if way == "reaches" else -beyond
    return stays(level, times, time if hold is None else hold, at)


@pytest.mark.parametrize("dt", [0.05, 0.1])
def test_stays_do_not_depend_on_the_step(saved, dt):
    run = rm.simulate(TOPS, "rk8", dt=dt, **RUN, save=("passage",))
    coarse = tuple(part[::10] for part in saved)
    for i, case in enumerate(CASES):
        (count, first, last), found = expected(saved, case), of(run, i)
        assert np.array_equal(found[0], count) and count.sum() > 250
        # measured 1.4e-4, by the straight lines of the expected times
        assert np.nanmax(np.abs(found[1] - first)) < 5e-4
        assert np.nanmax(np.abs(found[2] - last)) < 5e-4
        assert np.array_equal(np.isnan(first), np.isnan(found[1]))
        # without the time, and from saves 0.1 s apart, others count: measured 29 and 2 or more
        assert np.sum(expected(saved, case, 0.0)[0] != count) > 15
        assert np.sum(expected(coarse, case)[0] != count) > 0
    assert ", and stays for 0.9 s" in run.passages.long_name


def test_a_stay_stops_a_member_once_it_has_lasted(saved):
    stopping = replace(TOPS, observables=(TOPS.observables[0]._replace(stop=True),))
    run = rm.simulate(stopping, "rk8", dt=0.05, every=0.05, **RUN, save=("passage", "attitude"))
    (count, first, last), known = of(run, 0), expected(saved, CASES[0])
    assert np.array_equal(count, known[0] > 0)
    assert np.nanmax(np.abs(first - known[1])) < 5e-4  # measured 8.9e-5
    assert np.array_equal(first, last, equal_nan=True)
    moves = (np.diff(run.attitude.values, axis=0) != 0.0).any(1)
    ends = np.where(moves.all(0), np.nan, 0.05 * (~moves).argmax(0))
    late = (ends - first - 0.9)[count > 0]
    assert np.nanmin(late) > -1e-9 and np.nanmax(late) <= 0.05 + 1e-9


def test_noise_leaves_the_ends_of_steps():
    scene = replace(TOPS, effects=(rm.Gravity(9.81), rm.Bath(0.5, 1.0)))
    ways = {"dt": 0.02, "t_end": 5.0, "every": 0.02, "members": 32}
    run = rm.simulate(scene, "strang", **ways, save=("passage", "attitude"))
    level = -beyond_the_cone(run)
    for i, (way, hold, at) in enumerate(CASES):
        known = stays(level if way == "leaves" else -level, run.time.values, hold, at)
        found = of(run, i)
        assert np.array_equal(found[0], known[0])
        for a, b in zip(found[1:], known[1:], strict=True):
            assert np.allclose(a, b, rtol=0, atol=1e-12, equal_nan=True)  # measured 0


def test_a_hold_is_a_time():
    with pytest.raises(SceneError, match=r"hold = -1\.0: expected a time of 0 or more"):
        replace(TOPS, observables=(rm.Passage(3, ANGLE, hold=-1.0),))
    assert [one.hold for one in scale_scene(TOPS, time=4.0).observables] == [3.6, 3.6, 2.4]
    loaded = rm.Scene.loads(TOPS.dumps())
    assert loaded.observables == TOPS.observables

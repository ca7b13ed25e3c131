"""The times of saves: listed, per turn, and enough to plot few members. Nothing is compiled."""

import math

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.planning import saves
from rigidmc.planning.steps import make_time_grid, round_grid
from rigidmc.runs.prepare import prepare_scene

MOMENTS, OMEGA = (1.0, 1.0, 1.5), (0.3, 0.0, 6.0)
# axis 3 of the body is its symmetry axis: omega circles it at this rate
RATE = (MOMENTS[2] / MOMENTS[0] - 1.0) * OMEGA[2]
TOP = rm.Scene(rm.Body(MOMENTS), start=rm.Start(omega=OMEGA)).with_run(members=1)


@pytest.mark.parametrize(
    ("given", "found"),
    [
        (0.5, 0.5),
        ("250 ms", 0.25),
        ("50/turn", "50/turn"),
        (" 12.5 / turn", "12.5/turn"),
        ([0, 1, 2.5], (0.0, 1.0, 2.5)),
        (("0.5 s", "1 min"), (0.5, 60.0)),
        ("0, 0.5, 2", (0.0, 0.5, 2.0)),
        (np.array([0.1, 0.2]), (0.1, 0.2)),
        (np.float64(2.0), 2.0),
        (xr.DataArray([0.5, 1.0], dims="time"), (0.5, 1.0)),
        ({"value": [1, 2], "unit": "ms"}, (0.001, 0.002)),
        ({"value": 2, "unit": "min"}, 120.0),
    ],
)
def test_save_times_are_read(given, found):
    run = rm.Run(every=given, t_end=100.0)
    assert run.every == found
    assert rm.Scene.loads(TOP.with_run(every=given).dumps()).run.every == found


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ("50/trun", "did you mean '50/turn'"),
        ("50/rev", "did you mean '50/turn'"),
        ("50/s", "saves per turn such as"),
        ("0/turn", "above 0"),
        ("many/turn", "above 0"),
        ([], "expected 1 to 100,000 times"),
        ([1.0, 1.0], "must increase, but 1 s follows 1 s"),
        ([2.0, 1.0], "must increase"),
        ([-1.0, 1.0], "from 0 on"),
        ([1.0, math.nan], "finite number of seconds"),
        (np.ones((2, 2)), "times are a list"),
        (True, "finite number of seconds"),
        (0.0, "greater than 0"),
    ],
)
def test_other_save_times_are_refused(given, rule):
    with pytest.raises(rm.SceneError, match=rule) as error:
        TOP.with_run(every=given)
    assert error.value.at == "run.every"


@pytest.mark.parametrize(
    ("t_end", "dt", "times", "steps", "listed"),
    [
        (10.0, 0.01, (0.1, 0.25, 3.0), 1000, (0, 10, 25, 300, 1000)),
        (10.0, 0.01, (0.0, 10.0), 1000, (0, 1000)),
        (10.0, 0.3, (0.1 + 0.2, 5.0), 100, (0, 3, 50, 100)),
        (1.0, 0.3, (1.0 / 7.0, 3.0 / 7.0), 7, (0, 1, 3, 7)),
        (10.0, 0.01, (0.025, 0.03), 2000, (0, 5, 6, 2000)),
        (10.0, 10.0 / 997, tuple(np.array([3, 500]) * 10.0 / 997), 997, (0, 3, 500, 997)),
        (0.3, 0.1, (0.1, 0.1 * 3), 3, (0, 1, 3)),
    ],
)
def test_steps_end_at_listed_times(t_end, dt, times, steps, listed):
    made = make_time_grid(t_end, dt, times)
    assert (made.steps, made.listed) == (steps, listed)
    assert made.dt <= dt * (1 + 1e-9) and not made.is_shortened
    inner = [t for t in times if 0.0 < t < t_end * (1 - 1e-9)]
    ends = made.clock.time(np.array(listed))
    assert np.abs(ends - [0.0, *inner, t_end]).max() < 1e-9 * dt  # measured 6e-17
    # a result stores this step, which leads to the same grid
    assert make_time_grid(t_end, made.dt, times)[:-1] == made[:-1]


def test_listed_times_between_steps_are_refused():
    rule = "between steps of 0.01 s, the nearest of which ends at 0.12 s"
    with pytest.raises(rm.SceneError, match=rule):
        make_time_grid(10.0, 0.01, tuple(np.geomspace(0.123456789, 9.0, 7).tolist()))
    with pytest.raises(rm.SceneError, match="later than t_end = 10 s"):
        make_time_grid(10.0, 0.01, (1.0, 11.0))


def test_rounds_of_own_steps_end_at_listed_times():
    made = round_grid(10.0, (0.5, 2.0, 7.5))
    assert (made.steps, made.dt, made.listed) == (20, 0.5, (0, 1, 4, 15, 20))


@pytest.mark.parametrize("number", [5, 50, 99.5])
def test_saves_per_turn(number):
    run = prepare_scene(TOP.with_run(every=f"{number}/turn", t_end=37.0)).scene.run
    found = 2.0 * math.pi / RATE / run.every
    assert number * (1 - 1e-12) <= found < 1.34 * number  # measured 1.02 to 1.33
    assert make_time_grid(37.0, 0.01, run.every).dt == 0.01  # no other step


def test_more_saves_per_turn_than_steps_shorten_the_steps():
    run = prepare_scene(TOP.with_run(every="50/turn", t_end=37.0, dt=1.0))
    assert run.plan.grid.saves == 1 + math.ceil(50 * 37.0 * RATE / (2.0 * math.pi))
    assert run.plan.grid.stride == 1


def test_saves_per_turn_of_a_body_at_rest_are_refused():
    still = rm.Scene(TOP.body, start=rm.Start(omega=(0.0, 0.0, 0.0)))
    with pytest.raises(rm.SceneError, match="nothing turns at the start"):
        prepare_scene(still.with_run(every="50/turn"))


def count_of(scene=TOP, **settings):
    """The number of intervals between the saves of a prepared run."""
    with_saves = rm.prepare(scene, **settings)
    first = rm.prepare(scene, **{**settings, "every": with_saves.scene.run.t_end})
    made, known = with_saves.plan.grid, first.plan.grid
    if with_saves.plan.scheme is not None:  # the steps do not change
        assert (made.steps, made.dt, made.is_shortened) == (known.steps, known.dt, False)
        assert with_saves.layout.settings == first.layout.settings
    return with_saves.plan.grid.saves - 1


@pytest.mark.parametrize(
    ("settings", "count"),
    [
        ({}, 500),  # the least divisor of 1000 steps from 400 on
        ({"members": 20}, 500),
        ({"members": 21}, 1),
        ({"members": range(90, 95)}, 500),
        ({"members": [3, 900]}, 500),
        ({"scene": TOP.with_run(members=1000), "members": range(5)}, 1),
        ({"scene": TOP.with_run(members=1000), "members": 5}, 500),
        ({"t_end": 1000.0}, 10_000),  # 20 per turn: 9,550
        ({"t_end": 1e5}, 1),  # 20,000 saves are too few for 47,700 turns
        ({"t_end": 1e4, "save": "momentum"}, 20_000),
        ({"dt": 10.0 / 997}, 499),  # a prime number of steps: every second one is saved
        ({"dt": 0.1}, 100),
        ({"dt": 2.0}, 1),  # steps are too long for lines
        ({"integrator": "closed"}, 400),
        ({"turn": 0.1}, 1),  # own steps would change
        ({"save": ()}, 1),
        ({"save": (rm.Flips(axis=1),)}, 1),
        ({"keep": "final"}, 1),
        ({"keep": "thinned"}, 1),
        ({"every": 2.0}, 5),
        ({"every": [1.0, 2.0]}, 3),
    ],
)
def test_few_members_save_enough_to_plot(settings, count):
    assert count_of(**settings) == count


def test_saves_to_plot_fit_the_memory(monkeypatch):
    monkeypatch.setattr(saves, "MOST_BYTES", 3 * 8 * 100)
    assert count_of() == 100
    monkeypatch.setattr(saves, "MOST_BYTES", 3 * 8 * 5)
    assert count_of() == 1  # 5 saves of 5 turns would misrepresent the motion


def test_what_prepares_a_study_adds_no_saves():
    assert prepare_scene(TOP).plan.grid.saves == 2
    assert rm.prepare(TOP, varied=("start.omega",)).plan.grid.saves == 2


def test_units_change_no_save():
    """A run is integrated in other units if the scene's are far from 1."""
    tiny = rm.Scene(rm.Body(tuple(1e-20 * i for i in MOMENTS)), start=TOP.start)
    assert count_of(tiny.with_run(members=1)) == 500
    run = rm.prepare(tiny, members=1, every=[0.1, 0.25, 7.0])
    assert run.layout.axes.times == pytest.approx([0.0, 0.1, 0.25, 7.0, 10.0], rel=1e-15)


def test_show_tells_how_saves_were_chosen():
    from rigidmc.views.descriptions import outline

    def told(**settings):
        return next(line for line in outline(TOP.with_run(**settings)) if "saves  " in line)

    assert told().endswith(
        "omega at 501 times, 0.02 s apart: chosen to plot, unless run.every is set"
    )
    assert told(every="50/turn").endswith("s apart: 50/turn")
    assert told(members=100).endswith("omega at 2 times")

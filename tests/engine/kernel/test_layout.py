"""Places of numbers: the table of rows is what a scene is staged and watched by."""

from types import SimpleNamespace

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.compiler.trees import tree_size
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import CUT_ROWS
from rigidmc.engine.kernel.block import next_cut
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects.protocol import parameter_count
from rigidmc.planning.initial import block_rows, work_flags
from tests.tools.plans import monitors_of

SAVES = ((), ("work",), ("flips",), ("energy_mean", "omega_max", "nutation"), ("megno", "work"))


def test_rows_follow_each_other_without_gaps():
    names = "ATTITUDE", "MOMENTUM", "EXTRA", "START", "DRIFT", "STATUS"
    assert [getattr(layout, name) for name in names] == np.cumsum([0, 4, 3, 7, 8, 2]).tolist()
    assert tree_size(MassProperties.of((1.0,) * 3, (0.0,) * 3)) == layout.EFFECTS - layout.BODY
    assert layout.START == layout.EXTRA + 7 and layout.GOOD_STATE + 7 == layout.STEPS
    assert layout.RECORDS + 2 * layout.RECORD_ROWS == layout.EVENT_ROWS
    assert layout.RECORD_ROWS == 5 + 7  # time, two states and levels, attitude and momentum


@pytest.mark.parametrize("save", SAVES)
def test_a_scene_is_staged_by_the_table_of_rows(save):
    scene = rm.Scene(
        rm.Body.from_moments((1.0, 2.0, 3.0), mass=1.0, centre=(0.0, 0.0, 0.1)),
        (rm.Gravity(1.0), rm.ViscousDamping(0.1)),
        rm.Start(omega=(0.1, 1.0, 0.1)),
    ).with_run(save=save)
    watched = monitors_of(scene)
    rows = layout.map_rows(
        parameter_count(*scene.effects),
        len(work_flags(scene.effects, "work" in save)),
        len(watched.events),
        [len(marks) for _, marks in watched.running],
        bool(watched.growth),
    )
    assert rows.events == block_rows(scene.effects, "work" in save)
    assert rows.end == rows.events + watched.rows
    assert rows.trailing == layout.EFFECTS + 2
    assert rows.in_state(layout.EFFECTS) == layout.EFFECTS_AT


def test_a_call_begins_at_the_parts_of_its_first_step():
    """Steps 2, 5 and 9 have two, one and three parts."""
    steps = [2, 2, 5, 9, 9, 9]
    rows = np.zeros((len(steps) + 1, CUT_ROWS))
    rows[:, 0] = *steps, 1e300
    frame = SimpleNamespace(cuts=rows.ravel(), h=0.1, slots=1, cut_count=len(steps), sampling=0)
    first = [int(np.searchsorted(steps, now)) for now in range(12)]
    assert [next_cut(frame, now) for now in range(12)] == first

"""What is worked out of a scene once stays with the scene, and with nothing else."""

import copy
import gc
import pickle
import weakref
from contextlib import suppress

import pytest

import rigidmc as rm
from rigidmc.scene.once import once


def scene():
    body = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
    return rm.Scene(body, (rm.Gravity(9.81),), rm.Start(omega=(0.5, 0.7, rm.normal(0.5, 0.1))))


def test_works_once_for_the_last_arguments():
    calls = []

    @once
    def worked(_, *args, **named):
        calls.append((args, named))
        return object()

    one = scene()
    first = worked(one, 1, key="word")
    assert worked(one, 1, key="word") is first and len(calls) == 1
    assert worked(scene(), 1, key="word") is not first
    assert worked(one, 2, key="word") is not first
    assert worked(one, 1, key="word") is not first  # only the last result is kept


@pytest.mark.parametrize(
    ("one", "other"),
    [(1, 1.0), (1, True), (0.0, -0.0), (0, False), ((1, "a"), (1.0, "a"))],
)
def test_equal_arguments_of_other_types_are_others(one, other):
    worked = once(lambda _, value: (type(value), repr(value)))
    same = scene()
    assert worked(same, one) != worked(same, other)


def test_observables_are_not_told_apart_by_their_values():
    """NamedTuples of two classes are equal if their fields are, so nothing is kept for them."""
    passage = rm.Passage(3, 0.5)
    assert passage == tuple(passage)
    worked = once(lambda _, save: type(save[0]))
    one = scene()
    assert worked(one, (tuple(passage),)) is tuple
    assert worked(one, (passage,)) is rm.Passage
    other = worked(one, (rm.Passage(3, 0.5),))
    assert other is rm.Passage


def test_simulate_works_out_a_scene_once_and_gives_the_same_bits():
    one, asked = scene(), {"dt": 0.01, "t_end": 0.1, "members": 64}
    first = rm.simulate(one, **asked)
    assert one.with_run(dt=0.02) is not one.with_run(dt=0.03)
    for changed in ({"seed": 5}, {"dt": 0.02}, {"save": ("omega", "energy")}):
        rm.simulate(one, **{**asked, **changed})  # nothing of it stays in the next
    again = rm.simulate(one, **asked)
    assert first.identical(again)
    first.omega[:] = 0.0
    first.moments.attrs["units"] = "changed by a user"
    first.status.attrs["flag_values"] = first.status.attrs["flag_values"] + 1
    with suppress(ValueError):  # the index of pandas 3 is read-only, that of pandas 2 is not
        first.time.values[:] *= 2.0
    with pytest.raises(ValueError, match="read-only"):
        again.status.attrs["flag_values"][0] = 9
    assert rm.simulate(one, **asked).identical(again)
    assert rm.simulate(scene(), **asked).identical(again)


def test_a_scene_that_ran_can_be_pickled_copied_and_forgotten():
    one = scene()
    bare = len(pickle.dumps(one))
    rm.simulate(one, dt=0.01, t_end=0.1, members=64)
    assert len(pickle.dumps(one)) == bare
    for other in (pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one)):
        assert other.dumps() == one.dumps()
    gone = weakref.ref(one)
    gc.disable()  # what holds itself would stay until the garbage is collected
    try:
        del one
        assert gone() is None
    finally:
        gc.enable()

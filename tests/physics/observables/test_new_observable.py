"""An observable is one file: functions beside it compile, and results get its dimension."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.observables.protocol import DIMENSIONS, Dimension, running

HELPERS = """
def squares(l):
    return l[0] * l[0], l[1] * l[1] + l[2] * l[2]
"""
NEW = '''
from typing import NamedTuple

from new_package.helpers import squares
from rigidmc.physics.observables.protocol import event, observable


@observable(units="kg2 m4 s-2", long_name="squares of L", dims=("part",))
class Squares(NamedTuple):
    """Squares of L along axis 1 and across it."""

    def value(self, l):
        return both(squares(l))


def both(pair):
    return pair[0] + 0.0, pair[1] + 0.0


@event(outputs={"across": ("1", "how often L was half across axis 1", ())})
class Across(NamedTuple):
    """When L has as much along axis 1 as across it."""

    def level(self, l):
        along, across = squares(l)
        return across - along

    def results(self, record):
        return {"across": record.count}
'''


@pytest.fixture
def new(tmp_path, monkeypatch):
    folder = tmp_path / "new_package"
    folder.mkdir()
    for name, text in (("__init__", ""), ("helpers", HELPERS), ("new", NEW)):
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    import new_package.new as module

    monkeypatch.setitem(DIMENSIONS, "part", Dimension(("along", "across"), "part of L"))
    return module


def test_one_file_is_all_that_an_observable_and_an_event_need(new):
    scene = rm.Scene(
        rm.Body.from_moments((1.0, 2.0, 3.0)), start=rm.Start(momentum=(0.1, 1.0, 0.001))
    )
    save = "momentum", new.Squares(), new.Across()
    ds = rm.simulate(scene, members=3, dt=0.05, t_end=40.0, every=0.05, save=save)
    l = ds.momentum.values
    expected = np.stack([l[:, 0] ** 2, l[:, 1] ** 2 + l[:, 2] ** 2], 1)
    assert ds.squares.dims == ("time", "part", "member")
    assert list(ds.part.values) == ["along", "across"]
    assert np.abs(ds.squares.values - expected).max() < 1e-15  # measured 2.2e-16
    level = expected[:, 1] - expected[:, 0]
    crossings = ((level[:-1] < 0.0) & (level[1:] >= 0.0)).sum(0)
    assert (ds.across.values == crossings + (level[0] >= 0.0)).all()


def test_a_class_that_lacks_something_is_refused():
    words = "Empty has no state_size, begin, update, results: see Running"
    with pytest.raises(TypeError, match=words):
        running()(type("Empty", (), {}))
    with pytest.raises(TypeError, match="Running has no colour"):
        running(colour="red")

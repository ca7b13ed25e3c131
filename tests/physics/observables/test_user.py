"""Observables of a user's own: what no kernel could use is refused before it is compiled."""

import math
import textwrap
from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.protocols import event, observable, running, vertical
from rigidmc.statistics.measures import save_for_measures
from tests.tools.scenes import TOP

SHORT = {"members": 8, "dt": 0.05, "t_end": 2.0, "every": 0.5}


@observable(units="m", long_name="height of the point {at:g} m up axis 3", dims=())
class Height(NamedTuple):
    at: float

    def value(self, q):
        return (self.at * vertical(q)[2],)


@event(outputs={"rises": ("1", "how often axis 3 came up", ())})
class Rises(NamedTuple):
    def level(self, q):
        return vertical(q)[2]

    def results(self, record):
        return {"rises": record.count}


def height(ds):
    """A33 of the saved attitudes (times, members)."""
    _, x, y, _ = ds.attitude.transpose("quat", ...).values
    return 1.0 - 2.0 * (x * x + y * y)


def test_two_of_a_class_and_statistics_are_those_of_the_states():
    save = ("attitude", Height(2.0), Height(3.0), "height_2_max", Rises())
    ds = rm.simulate(TOP, **SHORT, save=save)
    true = height(ds)
    for name, at in (("height", 2.0), ("height_2", 3.0)):
        assert np.abs(ds[name].values - at * true).max() < 5e-15  # measured 1.6e-15
        assert ds[name].attrs["long_name"] == f"height of the point {at:g} m up axis 3"
    assert (ds.height_2_max.values >= ds.height_2.values.max(0)).all()
    assert ds.rises.dims == ("member",)
    added = save_for_measures(TOP.with_run(save=save), ["mean(height_max)"]).run.save[-1]
    assert added == "height_max"


def own(decorator, body, **facts):
    """A class with a decorator, as a user writes it."""
    names = {"np": np, "math": math, "NamedTuple": NamedTuple, "__name__": __name__}
    exec(f"class Own(NamedTuple):\n{textwrap.indent(textwrap.dedent(body), '    ')}", names)
    return decorator(**facts)(names["Own"])


OUTPUTS = {"own": ("1", "own", ())}


def a_value(body, **facts):
    return own(observable, body, **{"units": "1", "long_name": "own", "dims": ()} | facts)


def an_event(body, **facts):
    return own(event, body, **{"outputs": OUTPUTS} | facts)


def a_running(body, **facts):
    body += "\ndef results(self, state, steps): return {'own': state[0]}"
    return own(running, body, **{"state_size": 1, "outputs": OUTPUTS} | facts)


LEVEL = "def level(self, q): return q[0]\n"
COUNT = "def results(self, record): return {'own': record.count}"
BEGIN = "def begin(self, q): return (q[0],)\n"


@pytest.mark.parametrize(("make", "words"), [
    (lambda: a_value("def value(self, q): return q[0]"), "Own.value: returns .*tuple of 1 number"),
    (lambda: a_value("def value(self, q): return q[0], q[1]"), "Own.value: .*a tuple of 1 number"),
    (lambda: a_value("def value(self, p): return (p,)"), "unknown argument 'p'; it may name body"),
    (lambda: a_value("def value(self, q): return np.ones(1)"), "returns ndarray.*no arrays"),
    (lambda: a_value("def value(self, q): return (q[4],)"), "Own.value: .*raises IndexError"),
    (lambda: a_value("def value(self, q): return ('up',)"), "Own.value: returns .'up',., expected"),
    (lambda: a_value("def value(self, q): return (math.inf,)"), "which is not finite"),
    (lambda: a_value("def value(self, works): return (1.0,)"), "uses works, which only"),
    (lambda: a_value("def value(self, q): return (1.0,)", dims=("face",)), "Own.dims: has the dim"),
    (lambda: a_value("def value(self, q): return (1.0,)", units=1), "Own.units: is 1, expected"),
    (lambda: a_value("about: str = 'z'\ndef value(self, q): return (1.0,)"), "Own.about: is 'z'"),
    (lambda: a_value("at: int = 3\ndef value(self, q): return (q[self.at],)"), "raises TypeError"),
    (lambda: an_event(COUNT), "Own.level: is missing"),
    (lambda: an_event("def level(self, q): return q\n" + COUNT), "Own.level: .*expected a number"),
    (lambda: an_event(LEVEL + "def results(self, record): return {}"), "returns dict, expected"),
    (lambda: an_event(LEVEL + "def results(self, record): return {'own': 1.0}"), "returns own"),
    (lambda: an_event(LEVEL + COUNT, outputs={"own": "1"}), "Own.outputs: has 'own': '1'"),
    (lambda: an_event(LEVEL + COUNT, outputs={"time": ("s", "t", ())}), "returns own, expected"),
    (lambda: a_running(BEGIN + "def update(self, state): return state[0]"), "Own.update: returns"),
    (lambda: a_running("def begin(self): return 1.0, 2.0\ndef update(self, state): return state"),
     "Own.begin: returns .*a tuple of 1 number"),
    (lambda: a_running(BEGIN + "def update(self, state): return state\n"
                       "def extrema(self, q): return (q[0],)"), "Own.extremum_limits: returns"),
    (lambda: a_running(BEGIN + "def update(self, state): return state", state_size=0),
     "Own.state_size: is 0"),
])  # fmt: skip
def test_what_no_kernel_could_use_is_refused(make, words):
    with pytest.raises(rm.SceneError, match=words):
        rm.prepare(TOP.with_run(**SHORT, save=(make()(),)))


class Flips(NamedTuple):
    """A class with the name of another one."""

    def value(self, q):
        return (q[0],)


def test_names_that_are_taken_are_refused():
    facts = {"units": "1", "long_name": "own", "dims": ()}
    with pytest.raises(rm.SceneError, match="Flips: 'flips' is an observable of the package"):
        TOP.with_run(save=(observable(**facts)(Flips)(),))
    taken = an_event(LEVEL + COUNT.replace("own", "status"), outputs={"status": ("1", "own", ())})
    with pytest.raises(rm.SceneError, match="gives the variable 'status', which the result"):
        rm.prepare(TOP.with_run(save=(taken(),)))
    one, other = (a_value("def value(self, q): return (1.0,)") for _ in range(2))
    with pytest.raises(rm.SceneError, match="two classes have the name 'own'"):
        TOP.with_run(save=(one(), other()))


def test_a_class_that_changes_is_compiled_anew_and_a_call_of_no_kernel_is_named():
    """Two runs of one process; the second class has the name of the first."""
    values = []
    for factor in ("2.0", "-3.0"):
        kind = a_value(f"def value(self, l): return ({factor} * l[0],)")
        ds = rm.simulate(TOP, **SHORT, save=("momentum", kind()))
        values.append((ds.own / ds.momentum.sel(axis=1)).values)
    assert np.ptp(values[0]) < 1e-15 and abs(values[0][0, 0] - 2.0) < 1e-15  # measured 0
    assert np.abs(values[1] + 3.0).max() < 2e-15  # measured 4.4e-16
    bad = a_value("def value(self, l): return (float(math.comb(5, 2)) * l[0],)")
    with pytest.raises(rm.SceneError, match=r"\[observables\] Own: cannot be compiled: .*'comb'"):
        rm.simulate(TOP, **SHORT, save=(bad(),))


@observable(units="1", long_name="1 above the horizontal, else 0", dims=())
class Above(NamedTuple):
    def value(self, q):
        if vertical(q)[2] > 0.0:
            return (1.0,)
        return (0.0,)


def test_a_branch_is_told_and_is_right():
    with pytest.warns(rm.SceneWarning, match="Above branches.* members are not vectorized"):
        ds = rm.simulate(TOP, **SHORT, save=("attitude", Above()))
    assert (ds.above.values == (height(ds) > 0.0)).all()
    assert len(np.unique(ds.above.values)) == 2

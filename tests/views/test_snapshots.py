"""Bodies at a few instants: which instants, which body, and where it is drawn."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics.rotation import to_space
from rigidmc.planning.saves import MOST
from rigidmc.views import snapshots
from rigidmc.views.ensemble import summary
from rigidmc.views.snapshots import COUNT, body_place, flight


def test_the_instants_cover_the_first_flip_or_the_run():
    t = np.linspace(0.0, 10.0, 2001)
    flips = np.tanh(4.0 * (3.0 - t)) * np.tanh(4.0 * (t - 8.0)) * -1.0  # at 3 s and 8 s
    found = snapshots._instants(t, flips, True, np.inf)
    assert len(found) == COUNT and found[0] < 2.6 and 3.4 < found[-1] < 5.0
    for value, is_rate in ((flips, False), (1.0 + 0.0 * t, True)):
        found = snapshots._instants(t, value, is_rate, np.inf)
        assert found == pytest.approx(np.linspace(0.0, 10.0, 8))


@pytest.mark.parametrize("rate", [0.1, 1.0, 4.0, 30.0])
def test_instants_do_not_alias_an_oscillation(rate):
    """Eight instants over a run show an oscillation at 2 rad of it or less."""
    t, still = np.linspace(0.0, 10.0, 20001), np.tile([0.0, 0.0, 1.0], (20001, 1))
    value = 25.0 + 3.0 * np.sin(rate * t)
    fastest = snapshots._rate(t, value, still)
    # chords are flatter than the curve: measured 9.4e-6 below; a cut oscillation seems faster
    assert fastest > rate * (1.0 - 1e-4)
    between = np.diff(snapshots._instants(t, value, False, MOST / fastest))
    assert (between * rate <= MOST * (1.0 + 1e-4)).all()
    whole = rate <= 1.0 and MOST / fastest * (COUNT - 1) >= 10.0
    assert (np.isclose(between.sum(), 10.0)) == whole


@pytest.mark.slow  # 4 s, to compile
def test_a_handle_is_drawn_while_it_flips():
    """Its stem, axis 3, points along L at first and against it in the end."""
    ds = rm.simulate(rm.Scene.load("dzhanibekov"), "closed", members=40, save=("omega",))
    one = flight(ds)
    stem = to_space(one.path.attitude, (0.0, 0.0, 1.0))
    l = to_space(one.path.attitude[0], one.path.momentum[0])
    along = np.interp(one.instants[[0, -1]], one.path.t, stem @ l / np.linalg.norm(l))
    assert along[0] > 0.9 and along[1] < -0.9
    saved = ds.omega.sel(member=one.path.member, axis=3).values
    again = np.interp(ds.time.values, one.path.t, one.value)
    assert np.abs(again - saved).max() < 0.02  # measured 4e-3, by interpolation
    figure = summary(ds)
    bodies = figure.axes[1]
    middles = bodies.collections[0].get_paths()
    x = np.array([path.vertices[:, 0].mean() for path in middles])
    nearest = np.abs(x[:, None] - [body_place(k) for k in range(COUNT)])
    assert nearest.min(1).max() < 1.3 and len(np.unique(nearest.argmin(1))) == COUNT
    words = [text.get_text() for text in bodies.texts]
    assert words == [f"{t:.3g} s" for t in one.instants]
    figure.canvas.draw()


def test_a_result_without_its_scene_has_no_body():
    scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.1, 1.0, 0.0)))
    ds = rm.simulate(scene, "closed", t_end=1.0, every=0.1, members=2, save=("omega",))
    with pytest.raises(ValueError, match="does not hold the start"):
        snapshots.snapshots(ds.drop_vars("start_omega"))
    del ds.attrs["scene"]
    with pytest.raises(ValueError, match="with its scene"):
        snapshots.snapshots(ds)
    assert len(summary(ds).axes) == 4  # time, sphere and its scale, drifts

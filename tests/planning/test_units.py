"""Other units: a scene moves alike in all of them, to the bit under powers of 2.

It also runs if numbers in SI units are out of range.
"""

from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics import observables
from rigidmc.physics.observables.protocol import event
from rigidmc.planning.unit_scale import choose_units, scale_scene, unit_exponents, unit_factor

BODY = rm.Body.from_moments((rm.uniform(0.9, 1.1), 1.4, 2.0), mass=1.5, centre=(0.1, 0.2, 0.3))
START = rm.Start(
    omega=(rm.normal(0.3, 0.1), rm.distribution("laplace", loc=0.5, scale=0.1), 0.2),
    attitude="uniform",
)
SCENE = rm.Scene(BODY, (rm.Gravity(3.0), rm.ViscousDamping(0.05)), START)
SCENE = SCENE.with_run(
    dt=0.02, t_end=2.0, every=0.5, members=64, save=("omega", "attitude", "energy", "momentum")
)
UNITS = {
    "omega": (0, 0, -1),
    "energy": (1, 2, -2),
    "momentum": (1, 2, -1),
    "attitude": (0, 0, 0),
    "energy_drift_max": (0, 0, 0),
    "moments": (1, 2, 0),
}


def test_units_are_read():
    assert unit_exponents("kg2 m4 s-2") == (2, 4, -2)
    assert unit_exponents("rad s-1") == (0, 0, -1)
    assert unit_exponents("N m") == unit_exponents("J") == (1, 2, -2)
    assert unit_factor("kg m2 s-1", 2.0, 3.0, 4.0) == 4.5
    with pytest.raises(ValueError, match="furlong"):
        unit_exponents("furlong s-1")


@pytest.mark.filterwarnings("ignore:.*far less than air")  # in other units it is
@pytest.mark.parametrize("powers", [(-7, 3, 5), (-60, -20, 11), (200, 60, -150), (-300, 0, 400)])
def test_powers_of_two_change_no_bit(powers):
    """The last two leave the integrated numbers as they are, and come back from internal units."""
    mass, length, time = (2.0**k for k in powers)
    one, two = rm.simulate(SCENE), rm.simulate(scale_scene(SCENE, mass, length, time))
    assert not two.status.values.any()
    for name, (kg, m, s) in UNITS.items():
        assert np.array_equal(
            one[name].values * (mass**kg * length**m * time**s), two[name].values
        ), name
    assert np.array_equal(one.time.values * time, two.time.values)
    assert two.attrs["dt"] == one.attrs["dt"] * time


@pytest.mark.parametrize("name", ["rk4", "strang"])
def test_powers_of_ten_change_rounding_only(name):
    one = rm.simulate(SCENE, integrator=name)
    two = rm.simulate(scale_scene(SCENE, 1e-21, 1e-7, 1e-4), integrator=name)
    assert np.abs(two.omega.values * 1e-4 - one.omega.values).max() < 3e-14  # measured 4.2e-15
    assert np.abs(two.attitude.values - one.attitude.values).max() < 3e-14  # measured 1.7e-15


def test_internal_units_only_where_they_are_needed():
    assert choose_units(SCENE) is None
    small = scale_scene(SCENE, 1e-12, 1e-3, 1e-6)
    assert choose_units(small) is None
    assert choose_units(small.with_run(dtype="float32")) is not None
    assert choose_units(scale_scene(SCENE, 1e-40, 1e-10, 1.0)) is not None


def test_a_molecule_in_single_precision():
    """1e-47 kg m2 is 0 in float32."""
    spun = rm.Start(momentum=(1e-34, 2e-34, -1e-34), attitude="uniform")
    scene = rm.Scene(rm.Body.from_moments((1.0e-47, 1.9e-47, 2.9e-47)), (), spun).with_run(
        dt=5e-15, t_end=5e-13, members=32
    )
    fine, single = rm.simulate(scene), rm.simulate(scene, dtype="float32")
    assert not single.status.values.any()
    apart = np.abs(single.omega.values - fine.omega.values).max() / np.abs(fine.omega.values).max()
    assert 1e-9 < apart < 2e-6  # measured 3.3e-7


def test_a_file_of_an_extreme_scene_runs_again(tmp_path):
    scene = scale_scene(SCENE, 1e-200, 1e-50, 1e-30)
    first = rm.simulate(scene, output=tmp_path / "a.nc")
    assert first.momentum.values.max() < 1e-200
    again = rm.simulate(rm.Scene.load(tmp_path / "a.nc"))
    for name in UNITS:
        assert np.array_equal(first[name], again[name]), name
    assert np.array_equal(first.time, again.time)


class Wind(NamedTuple):
    """An effect that does not state the unit of its number."""

    size: float

    def torque(self):
        return self.size, 0.0, 0.0


@event(
    outputs={"visits": ("1", "stays", ()), "visit_first": ("s", "begin of the first stay", ())},
    event_times=("visit_first",),
    parameter_units={"hold": "s"},
)
class Visit(NamedTuple):
    """The times at which axis 3 comes within 1 rad of the vertical and stays for some seconds."""

    hold: float

    def bind(self, moments, complete, effects):
        return rm.Passage(3, 1.0, "reaches", hold=self.hold).bind(moments, complete, effects)

    def results(self, record):
        return {"visits": record.count, "visit_first": record.first_tau}


def test_a_time_of_any_shipped_class_is_rescaled(monkeypatch):
    """The facts on the class say which numbers are times, so a new class needs no other line."""
    monkeypatch.setitem(observables.OBSERVABLES, "visit", Visit)

    def counts(size):
        body = rm.Body.from_moments((size, 1.4 * size, 2.0 * size))
        start = rm.Start(omega=(rm.normal(0.0, 1.0), 6.0, 0.2), attitude="uniform")
        scene = rm.Scene(body, (), start, observables=(Visit(0.25),))
        assert (choose_units(scene) is not None) == (size < 1.0)
        return rm.simulate(scene, save=("visit",), t_end=10.0, dt=0.02, members=64)

    near, tiny = counts(1.0), counts(2.0**-400)
    assert 200 < near.visits.sum() < 600  # measured 338
    for name in ("visits", "visit_first"):
        assert np.array_equal(near[name], tiny[name], equal_nan=True), name


def test_effects_without_units_are_not_rescaled():
    windy = rm.Scene(BODY, (Wind(0.1),), START)
    with pytest.raises(rm.SceneError, match="Wind does not declare the unit of size"):
        scale_scene(windy, mass=2.0)
    assert choose_units(windy) is None


def test_units_beyond_float64_are_no_error():
    """Spins of 1e200 rad/s: their square in kg2 m4 s-2 exceeds 1e308; the members are flagged."""
    scene = rm.Scene(
        rm.Body.from_moments((1.0, 1.4, 2.0)),
        start=rm.Start(omega=(rm.normal(0.0, 1e200), 0.0, 0.0)),
    )
    with pytest.warns(rm.SceneWarning, match="omega dt"):
        ds = rm.simulate(scene, t_end=1.0, members=4, save=("l2",))
    assert (ds.status != 0).all()

"""MEGNO, FTLE, Lyapunov spectra, SALI and GALI in units from 1e-40 to 1e20, against the same motion
in other units, the power laws of tori, and variational equations of another program."""

import numpy as np
import pytest

import rigidmc as rm
from tests.studies import test_ftle
from tests.studies.test_lyapunov import RK4, top

pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
# (unit of moments, unit of time, unit of length); the third has powers of two
UNITS = (
    (1e-20, 1.0, 1.0), (1.0, 1e-9, 1.0), (2.0**-66, 2.0**-20, 1.0), (3e-20, 7e8, 1.0),
    (1e-26, 1e-9, 1e-8), (1e-20, 1e-20, 1.0), (1e20, 1e20, 1.0), (1e-40, 1.0, 1e-20),
)  # fmt: skip
# {effects: of units of torque, time and length}
EFFECTS = {
    "free": lambda u, s, a: (),
    "gravity": lambda u, s, a: rm.Gravity(4.0 * a / s**2),
    "wheel": lambda u, s, a: (
        rm.Gravity(4.0 * a / s**2), rm.Rotor((0.3 * u * s, 0.0, 0.1 * u * s))),
    "damped": lambda u, s, a: (rm.Gravity(4.0 * a / s**2), rm.ViscousDamping(0.05 / s)),
    "friction": lambda u, s, a: (rm.Gravity(4.0 * a / s**2), rm.DryFriction(0.02 * u, 0.1 / s)),
    "driven": lambda u, s, a: rm.PeriodicTorque((0.3 * u, -0.2 * u, 0.4 * u), 1.3 / s),
    "torque": lambda u, s, a: rm.SpaceTorque((0.3 * u, -0.2 * u, 0.4 * u)),
    "field": lambda u, s, a: rm.UniformField((0.4 * u, 0.1 * u, 0.2 * u), (0.0, 0.0, 1.0)),
    "orbit": lambda u, s, a: rm.GravityGradient(4e21 / s**2, 1e7, 0.1),
    "pivot": lambda u, s, a: (
        rm.Gravity(4.0 * a / s**2), rm.MovingPivot((0.0, 0.0, 0.05 * a), 5.0 / s)),
    "dissipation": lambda u, s, a: rm.EnergyDissipation(0.05),
}  # fmt: skip


def scene(acts, unit, time, length):
    """Return tops whose motion is the same in all units."""
    orbits = acts == "orbit"
    body = rm.Body(
        tuple(unit * np.array((1.0, 1.3, 0.7))),
        mass=0.5 * unit / length**2,
        centre=(0.0,) * 3 if orbits else tuple(length * np.array((0.3, 0.1, 0.4))),
    )
    omega = tuple(rm.uniform((k - 1.0) / time, (k + 1.0) / time) for k in range(3))
    start = rm.Start(omega=omega, attitude=(0.2, rm.uniform(0.3, 2.8), rm.uniform(0.0, 6.0)))
    return rm.Scene(body, EFFECTS[acts](unit / time**2, time, length), start)


def chaos(acts, unit, time, length):
    """Return {indicator: values in units of the motion} of eight members."""
    made = scene(acts, unit, time, length)
    run = {"integrator": "rk4", "dt": 0.02 * time, "t_end": 10.0 * time}
    ds = rm.simulate(made, members=8, save=("megno",), **run)
    end = rm.lyapunov(made, members=8, **run).isel(time=-1)
    assert not ds.status.any()
    return {
        "megno": ds.megno.values,
        "lyapunov": ds.lyapunov.values * time,
        "ftle": rm.ftle(made, 8, **run).ftle.values * time,
        "spectrum": end.exponents.values * time,
        "gali": np.log(end.gali.values),
        "sali": np.log(end.sali.values),
    }


@pytest.mark.slow
@pytest.mark.parametrize("acts", EFFECTS)
def test_indicators_do_not_depend_on_units(acts):
    """120 numbers of 8 members, for 11 kinds of motion in 8 units: 10,560 numbers."""
    true = chaos(acts, 1.0, 1.0, 1.0)
    for units in UNITS:
        for name, values in chaos(acts, *units).items():
            away = np.abs(values - true[name]).max()
            assert np.isfinite(values).all()
            assert away < 2e-11, (name, units, away)  # measured 5.1e-12, on an orbit
            if units[1] == 2.0**-20:
                assert away == 0.0


def test_a_spectrum_in_units_that_are_no_powers_of_two():
    scaled, found = 3e-20, []
    for unit, time in ((1.0, 1.0), (scaled, 7e-8)):
        known = top(45.0)
        body = rm.Body(
            tuple(unit * np.array(known.body.moments)), mass=0.25 * unit, centre=known.body.centre
        )
        start = rm.Start(
            omega=(0.3 / time, rm.normal(1.0 / time, 0.2 / time), 0.5 / time), attitude="uniform"
        )
        run = {"integrator": "rk4", "dt": RK4["dt"] * time, "t_end": RK4["t_end"] * time}
        made = rm.Scene(body, rm.Gravity(4.0 / time**2), start)
        end = rm.lyapunov(made, members=8, **run).isel(time=-1)
        found.append([*(end.exponents.values * time), *np.log(end.gali.values)])
    assert np.abs(np.subtract(*found)).max() < 1e-12  # measured 7.8e-14


@pytest.mark.slow
def test_a_heavy_top_in_tiny_units_has_the_exponents_of_scipy():
    """Of all changes of the start of a chaotic top, by equations that share nothing with the
    package."""
    unit, time = 3e-20, 7e-8
    known = test_ftle.TOP
    body = rm.Body(
        tuple(unit * np.array(known.body.moments)), mass=0.5 * unit, centre=known.body.centre
    )
    omega = tuple(rm.uniform((k - 1.0) / time, (k + 1.0) / time) for k in range(3))
    start = rm.Start(omega=omega, attitude=known.start.attitude)
    made = rm.Scene(body, rm.Gravity(4.0 / time**2), start)
    run = {"integrator": "rk8", "dt": 0.02 * time, "t_end": test_ftle.TIME * time}
    study = rm.ftle(made, 5, unit=0.7 * time, **run)
    true = [test_ftle.largest(q, w, 0.7) for q, w in test_ftle.starts(study)]
    assert np.abs(study.ftle.values * time - true).max() < 3e-11  # measured 1.5e-12


TORI = {  # exponents of t of GALI_2 to GALI_6 on tori of two and three dimensions
    "free": ((1.0, 1.3, 0.7), (0.0, 0.0, 0.0), (0, -1, -2, -4, -6)),
    "lagrange": ((1.0, 1.0, 1.5), (0.0, 0.0, 0.3), (0, 0, -2, -4, -6)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TORI)
@pytest.mark.parametrize(("unit", "time"), [(1.0, 1.0), (3e-20, 7e-8)])
def test_integrable_tops_have_the_power_laws_of_their_tori(name, unit, time):
    """MEGNO -> 2, changes grow as t, SALI stays, and GALI_k falls as t^-(k - s) or t^-2(k - 3) on
    tori of s dimensions. Source: Skokos, Bountis & Antonopoulos, Eur. Phys. J. Special Topics 165
    (2008) 5."""
    moments, centre, slopes = TORI[name]
    body = rm.Body(tuple(unit * np.array(moments)), mass=unit, centre=centre)
    effects = rm.Gravity(1.0 / time**2) if any(centre) else ()
    omega = tuple(rm.normal(x / time, 0.3 / time) for x in (0.3, 1.0, 0.5))
    made = rm.Scene(body, effects, rm.Start(omega=omega, attitude="uniform"))
    run = {"integrator": "rk8" if any(centre) else "exact", "dt": 0.1 * time}
    end = {"t_end": 4000.0 * time, "members": 16}
    found = rm.lyapunov(made, every=40.0 * time, **run, **end)
    gali, times = np.log(found.gali.median("member").values[[9, -1]]), found.time.values[[9, -1]]
    measured = np.diff(gali, axis=0)[0] / np.log(times[1] / times[0])
    assert np.abs(measured - slopes).max() < 0.3  # measured 0.17, of GALI_4 of Lagrange tops
    assert found.sali[-1].min() > 1e-4
    assert float(np.abs(found.exponents[-1]).max()) * 4000.0 * time < 20.0  # measured 9.4
    megno = rm.simulate(made, save=("megno",), **run, **end).megno
    assert np.abs(megno - 2.0).max() < 0.1  # measured 0.028
    growth = [
        rm.ftle(made, 16, t_end=t * time, **run).ftle.values * t * time for t in (1000.0, 4000.0)
    ]
    # ln 4 for growth as t; measured 0.9992 and 1.017
    assert np.median(growth[1] - growth[0]) == pytest.approx(np.log(4.0), rel=0.03)

"""MEGNO, FTLE, Lyapunov spectra, SALI and GALI in tiny units, against the same motion in others and
the power laws of tori; tests/whole/test_units.py has all motions in units from 1e-20 to 1e20."""

import numpy as np
import pytest

import rigidmc as rm
from tests.studies.test_lyapunov import RK4, top

pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")


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

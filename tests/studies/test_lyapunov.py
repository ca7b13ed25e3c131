"""Lyapunov spectra: heavy tops against variational equations written by hand, for the rotation
vector of a change of attitude and a change of L; integrable tops, damping and noise."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rigidmc as rm
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError, SceneError
from rigidmc.planning.steps import rate_bounds
from rigidmc.runs.prepare import prepare_scene
from rigidmc.studies.lyapunov import tangents
from rigidmc.studies.lyapunov.study import TURN, sali_of, table
from rigidmc.studies.stability_map.compute import prepared_case, run_map

WEIGHT = 1.0
# every quick test that moves members uses the same compiled kernels
RK4 = {"integrator": "rk4", "dt": 0.01, "t_end": 8.0}


def top(degrees, energy=1.0, moments=(2.0, 2.0, 1.0)):
    """Tops between Lagrange's (0) and Kovalevskaya's (90), anywhere on a surface of energy."""
    centre = np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))
    body = rm.Body(moments, mass=0.25, centre=centre)
    return rm.Scene(body, rm.Gravity(4.0), rm.Start(momentum=rm.Shell(energy), attitude="ensemble"))


def cross(a, b):
    return np.stack([
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    ])  # fmt: skip


def rates(y, moments, centre, pull=1.0):
    """d/dt of (vertical in the body, L) (2, 3, 1, n) and of six changes (2, 3, 6, n) of attitude
    (a rotation vector in the body) and L; pull : 0 leaves out how the torque changes."""
    (up, l), (turn, dl) = y[:, :, :1], y[:, :, 1:]
    spin, dspin = l / moments, dl / moments
    torque = -WEIGHT * cross(centre, up)
    dtorque = -WEIGHT * pull * cross(centre, cross(up, turn))
    one = np.stack([cross(up, spin), cross(l, spin) + torque])
    six = np.stack([dspin - cross(spin, turn), cross(dl, spin) + cross(l, dspin) + dtorque])
    return np.concatenate([one, six], axis=2)


def start_of(scene, count):
    """(state with changes (2, 3, 7, n), (moments, centre), scale of L (n,)) of members."""
    moments, centre = (np.array(x)[:, None, None] for x in (scene.body.moments, scene.body.centre))
    run = rm.prepare(scene, members=count, **RK4)
    block = run.initial(0, count)[0][:, :count]
    w, x, y, z = block[:4]
    up = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])
    scale = moments.max() * rate_bounds(run.plan.model.effects, block)
    six = np.repeat(tangents.MIXED.T.reshape(2, 3, 6, 1), count, axis=-1)
    six[1] *= scale
    one = np.stack([up, block[4:7]])[:, :, None]
    return np.concatenate([one, six], axis=2), (moments, centre), scale


def in_metric(y, scale):
    """The six changes as columns of matrices (n, 6, 6)."""
    six = y[:, :, 1:].copy()
    six[1] /= scale
    return np.moveaxis(six.reshape(6, 6, -1), -1, 0)


def flow(y, body, end, pull=1.0):
    """A state with changes at the end, by scipy."""

    def flat(t, z):
        return rates(z.reshape(y.shape), *body, pull).ravel()

    found = solve_ivp(flat, (0.0, end), y.ravel(), "DOP853", rtol=1e-11, atol=1e-12)
    return found.y[:, -1].reshape(y.shape)


def spectrum(scene, count, pull=1.0):
    """(exponents, from the largest, and GALI_k) of members by scipy, from the whole tangent map."""
    y, body, scale = start_of(scene, count)
    end = RK4["t_end"]
    maps = in_metric(flow(y, body, end, pull), scale)
    grown = np.log(np.abs(np.diagonal(np.linalg.qr(maps)[1], axis1=1, axis2=2))) / end
    units = maps / np.linalg.norm(maps, axis=1, keepdims=True)
    gali = [np.linalg.svd(units[..., :k])[1].prod(-1) for k in range(2, 7)]
    return -np.sort(-grown.T, axis=0), np.array(gali), units


def test_a_heavy_top_has_the_spectrum_of_variational_equations(monkeypatch):
    scene = top(45.0)
    true, gali, units = spectrum(scene, 3)
    found = rm.lyapunov(scene, members=3, interval=1.7, **RK4)  # orthonormal four times
    end = found.isel(time=-1)
    assert np.abs(end.exponents.values - true).max() < 1e-7  # measured 3e-9
    assert np.abs(end.gali.values / gali - 1.0).max() < 1e-6  # measured 3e-8
    apart = [np.linalg.norm(units[..., 0] + sign * units[..., 1], axis=-1) for sign in (1, -1)]
    assert np.abs(end.sali.values - np.minimum(*apart)).max() < 1e-7
    assert np.abs(found["sum"]).max() < 1e-9  # measured 7e-11: rk4 at 0.03 rad per step
    # the same study is wrong if the torque does not change, or combinations skip momenta
    assert np.abs(end.exponents.values - spectrum(scene, 3, pull=0.0)[0]).max() > 1e-2
    monkeypatch.setattr(tangents, "STATE", slice(0, 4))
    broken = rm.lyapunov(scene, members=3, interval=1.7, **RK4)
    assert np.abs(broken["sum"]).max() > 1e-2


def test_a_member_depends_on_nothing_else():
    """Neither on threads, nor on the members of its block, nor on other saves."""
    whole = rm.lyapunov(top(45.0), members=70, threads=2, **RK4)
    some = rm.lyapunov(top(45.0), members=3, first=65, threads=1, **RK4)
    assert some.exponents.equals(whole.exponents.isel(member=slice(65, 68)))
    assert some.gali.equals(whole.gali.isel(member=slice(65, 68)))
    moved, request = rm.lyapunov.design(top(45.0), members=70, **RK4)
    moved = prepare_scene(moved)
    wide = tangents.compute_members(moved, {**request, "size": 96}, [0], 1, None)[0]
    parts = tangents.compute_members(moved, request, [0, 1, 2], 2, "cpu")
    for name, values in wide.items():
        assert np.array_equal(values, np.concatenate([one[name] for one in parts], axis=-1))
    few = rm.lyapunov(top(45.0), members=3, first=65, every=RK4["t_end"], **RK4)
    assert few.sizes["time"] == 1 and some.member.equals(few.member)
    gap = np.abs(few.exponents - some.exponents.isel(time=-1)).max()
    assert gap < 1e-8  # other places of the orthonormalisations: measured 2e-12


def test_member_steps_change_nothing():
    scene, run = top(45.0), {"integrator": "rk4", "t_end": 8.0, "members": 40}
    even = rm.lyapunov(scene, dt=0.01, **run).isel(time=-1)
    own = rm.lyapunov(scene, turn=0.04, **run).isel(time=-1)
    assert np.abs(even.exponents - own.exponents).max() < 1e-6  # measured 3e-8


def test_flagged_members_have_no_exponents():
    start = rm.Start(omega=(np.array([1.0, 1000.0]), 0.1, 0.2))
    body = rm.Body((1.0, 2.0, 2.5), mass=0.25, centre=(0.1, 0.0, 0.2))
    scene = rm.Scene(body, rm.Gravity(4.0), start)
    found = rm.lyapunov(scene.with_run(members=2), interval=0.5, every=1.0, **RK4)
    assert found.status.values.tolist() == [0, STATUSES["step_too_large"]]
    assert np.isfinite(found.exponents.values[..., 0]).all()
    assert np.isnan(found.exponents.values[..., 1]).all() and np.isnan(found.sali[:, 1]).all()
    words = "\n".join(table(found))
    assert "1 member to" in words and "flagged members, without exponents: 1" in words
    assert found["mean"].values == pytest.approx(found.exponents.values[-1, :, 0])


def test_orthonormal_vectors_and_indices():
    rng = np.random.default_rng(1)
    vectors = rng.normal(size=(6, 9, 5))
    before = np.moveaxis(vectors, -1, 0).copy()
    r = tangents.orthonormalise(vectors, 7)
    after, r = np.moveaxis(vectors, -1, 0), np.moveaxis(r, -1, 0)
    assert np.abs(after[:, :, :7] @ after[:, :, :7].transpose(0, 2, 1) - np.eye(6)).max() < 1e-14
    assert np.abs(r.transpose(0, 2, 1) @ after - before).max() < 1e-14  # of all nine rows
    assert np.abs(tangents.MIXED @ tangents.MIXED.T - np.eye(6)).max() < 1e-14
    assert np.abs(tangents.MIXED).min() > 0.07
    growth, whole = tangents.TangentGrowth(5), np.eye(6)[None]
    for _ in range(4):
        step = np.triu(rng.normal(size=(5, 6, 6)))
        step[:, range(6), range(6)] = np.exp(rng.normal(size=(5, 6)))
        growth.add(np.moveaxis(step, 0, -1))
        whole = step @ whole
    units = whole / np.linalg.norm(whole, axis=1, keepdims=True)
    volumes = np.cumprod(np.diagonal(units, axis1=1, axis2=2), axis=1)[:, 1:]
    assert np.abs(np.exp(growth.log_gali) / volumes.T - 1.0).max() < 1e-13
    logs = np.log(np.diagonal(whole, axis1=1, axis2=2)).T
    assert np.abs(growth.logarithms - logs).max() < 1e-13
    angles = np.array([1e-200, 1e-9, 0.3, 1.2, np.pi / 2, 2.5])
    expected = 2.0 * np.sin(0.5 * np.minimum(angles, np.pi - angles))
    assert np.abs(sali_of(np.sin(angles)) / expected - 1.0).max() < 1e-14
    assert sali_of(np.array([0.0, 1.0])).tolist() == pytest.approx([0.0, np.sqrt(2.0)])


def test_sums_keep_what_rounding_loses():
    sums = tangents.CompensatedSum((1,))
    for x in (1.0, 1e-16, 1e-16, -1.0, *[1e-16] * 8):
        sums.add(np.array([x]))
    assert sums.value == pytest.approx(1e-15, rel=1e-12)


def test_what_has_no_exponents_is_refused():
    scene = top(45.0)
    stop = (rm.Passage(3, 0.5, stop=True),)
    stops = rm.Scene(scene.body, scene.effects, scene.start, observables=stop)
    with pytest.raises(SceneError, match=r"passage\] stop = True: stops members"):
        rm.lyapunov(stops, **RK4)
    free = rm.Scene(rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(1.0, 0.2, 0.1)))
    with pytest.raises(SceneError, match=r"integrator = 'closed': has no steps.*use exact"):
        rm.lyapunov(free, integrator="closed", t_end=1.0)
    with pytest.raises(OptionError, match="device = 'cuda:0': a spectrum is computed on the CPU"):
        tangents.compute_members(prepare_scene(scene), {"keep": 1, "size": 32}, [0], 1, "cuda:0")
    with pytest.raises(OptionError, match="interval = -1"):
        rm.lyapunov(scene, interval=-1.0, **RK4)


@pytest.mark.parametrize(
    "run, every, expected",
    [
        ({"dt": 0.1, "t_end": 30.0}, None, (1.8, 1)),
        ({"dt": 0.1, "t_end": 3000.0}, None, (1.8, 27)),
        ({"dt": 0.1, "t_end": 0.5}, None, (0.5, 1)),
        ({"dt": 0.1, "t_end": 30.0}, 3.0, (1.5, 2)),
        ({"dt": 5.0, "t_end": 30.0}, None, (5.0, 1)),
    ],
)
def test_intervals_are_whole_steps(run, every, expected):
    """One turn of the top, at 3.2 rad/s, is the longest interval, unless a step is longer."""
    body = rm.Body((1.0, 1.0, 1.0))
    scene = rm.Scene(body, start=rm.Start(omega=(0.0, 0.0, TURN / 1.87)))
    more = {} if every is None else {"every": every}
    moved, request = rm.lyapunov.design(scene, integrator="exact", members=100, **run, **more)
    assert (moved.run.every, request["keep"]) == pytest.approx(expected)
    assert request["size"] == 32
    big = rm.lyapunov.design(scene, integrator="exact", members=10**5, **run, **more)[1]
    assert big["size"] == 512


@pytest.mark.slow
def test_integrable_tops_have_no_exponents():
    """Lagrange's and Kovalevskaya's: t |lambda| grows as ln t, by less than a tenth as much as t,
    and SALI stays; between them nearly all tops on this surface of energy are chaotic."""
    for degrees in (0.0, 90.0):
        ends = []
        for time in (1e3, 1e4):
            run = {"integrator": "rk8", "dt": 0.1, "t_end": time, "members": 32}
            found = rm.lyapunov(top(degrees), **run)
            assert np.abs(found["sum"]).max() < 1e-11  # measured 7e-14 at the end
            ends.append(float(np.abs(found.exponents[-1]).max()) * time)
            assert found.sali[-1].min() > 1e-4  # measured 3e-3
        assert max(ends) < 20.0  # measured 8.7, 11.7; 12.0, 12.0
    found = rm.lyapunov(top(45.0), **run)
    assert float((found.sali[-1] < 1e-8).mean()) > 0.7  # measured 0.81
    assert np.abs(found["sum"]).max() < 1e-10
    assert found.pair_error.max() < 2e-3  # measured 4e-4, ln(t)/t


@pytest.mark.slow
def test_a_chaotic_top_has_the_exponents_of_a_program_by_hand():
    """To t = 1e4, by classical Runge-Kutta steps and QR in NumPy. Paths part after 300 s: the
    means over members that start together are compared, to 1 %."""
    count, steps, end = 64, 250_000, 1e4
    centre = np.array([0.6, 0.2, 0.8]) / np.sqrt(1.04)
    omega = tuple(rm.normal(x, 1e-3) for x in (1.2, 0.1, 0.3))
    start = rm.Start(omega=omega, attitude=(0.0, 1.2, 0.5))
    top = rm.Body((1.0, 1.3, 0.7), mass=0.25, centre=tuple(centre))
    scene = rm.Scene(top, rm.Gravity(4.0), start)
    y, body, scale = start_of(scene, count)
    h, sums = end / steps, np.zeros((6, count))
    for i in range(steps):
        a = rates(y, *body)
        b = rates(y + 0.5 * h * a, *body)
        c = rates(y + 0.5 * h * b, *body)
        y = y + h / 6.0 * (a + 2.0 * (b + c) + rates(y + h * c, *body))
        y[0, :, 0] /= np.linalg.norm(y[0, :, 0], axis=0)
        if i % 50 == 49:
            q, r = np.linalg.qr(in_metric(y, scale))
            sums += np.log(np.abs(np.diagonal(r, axis1=1, axis2=2))).T
            six = np.moveaxis(q, 0, -1).reshape(2, 3, 6, count).copy()
            six[1] *= scale
            y[:, :, 1:] = six
    up, l = y[0, :, 0], y[1, :, 0]
    energy = 0.5 * (l * l / body[0][:, 0]).sum(axis=0) + (body[1][:, 0] * up).sum(axis=0)
    assert np.ptp(energy) < 0.02  # the starts differ by 0.01; with steps of 0.1 s: 0.3
    by_hand = -np.sort(-sums, axis=0) / end
    found = rm.lyapunov(scene, integrator="rk8", dt=0.1, t_end=end, members=count)
    ours, theirs = found.exponents.values[-1].mean(axis=1), by_hand.mean(axis=1)
    assert np.abs(ours[[0, 5]] / theirs[[0, 5]] - 1.0).max() < 0.01
    assert np.abs(ours[1:5] - theirs[1:5]).max() < 1e-4


@pytest.mark.slow
def test_volumes_shrink_by_damping_and_keep_in_splittings():
    """The sum of the exponents is the mean divergence of the motion: -3 gamma with a bath."""
    run = {"dt": 0.05, "t_end": 50.0, "members": 8}
    # An interval rounds the volume by the condition of its tangents times 2e-16. In 3.5 s, the
    # interval by default, the condition of one member here is 2,400: its sum is 1.4e-14 after one.
    kept = rm.lyapunov(top(45.0), integrator="strang", interval=0.25, **run)
    assert np.abs(kept["sum"]).max() < 1e-14  # measured 3.1e-15
    kept = rm.lyapunov(top(45.0), integrator="strang", **run)
    assert np.abs(kept["sum"][-1]).max() < 1e-14  # measured 1.2e-15
    single = rm.lyapunov(top(45.0), integrator="strang", dtype="float32", **run)
    assert np.abs(single.exponents[-1] - kept.exponents[-1]).max() < 2e-3
    bath = rm.Scene(rm.Body((1.0, 1.5, 2.0)), rm.Bath(0.2, 1.0))
    found = rm.lyapunov(bath, integrator="strang", **run)
    assert np.abs(found["sum"] + 0.6).max() < 1e-12
    body = rm.Body((1.0, 1.5, 2.0))
    damped = rm.Scene(body, rm.AxialDamping((0.1, 0.2, 0.3)), rm.Start(omega=(1.0, 0.5, 0.2)))
    found = rm.lyapunov(damped, integrator="rk8", **run)
    assert np.abs(found["sum"][-1] + 0.6).max() < 1e-9


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
def test_a_spectrum_in_units_that_are_no_powers_of_two():
    scaled, found = 3e-20, []
    for unit, time in ((1.0, 1.0), (scaled, 7e-8)):
        known = top(45.0)
        moments = tuple(unit * np.array(known.body.moments))
        body = rm.Body(moments, mass=0.25 * unit, centre=known.body.centre)
        omega = 0.3 / time, rm.normal(1.0 / time, 0.2 / time), 0.5 / time
        start = rm.Start(omega=omega, attitude="uniform")
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
@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
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
    ends = (rm.ftle(made, 16, t_end=t * time, **run).ftle.values * t for t in (1000.0, 4000.0))
    growth = [end * time for end in ends]
    # ln 4 for growth as t; measured 0.9992 and 1.017
    assert np.median(growth[1] - growth[0]) == pytest.approx(np.log(4.0), rel=0.03)


def megno(*known, members=128):
    """MEGNO of starts all over an energy surface, with m g c = 1 J."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)  # a centre of mass far out
        run = {"integrator": "rk8", "dt": 0.2, "t_end": 1000.0, "members": members}
        return rm.simulate(top(*known), **run, save=("megno",)).megno.values


def share(*known, **more):
    return float((megno(*known, **more) > 4.0).mean())


def test_integrable_tops_have_no_chaos_and_one_between_has():
    """Lagrange's and Kovalevskaya's; a degree away from the second there is."""
    for degrees in (0.0, 90.0):
        assert megno(degrees, 1.0).max() < 3.0  # measured 2.04 and 2.37
    assert share(45.0, 1.0) > 0.7  # measured 0.85
    assert 0.1 < share(89.0, 1.0) < 0.4  # measured 0.23


@pytest.mark.slow
def test_chaos_rises_and_falls_with_energy():
    """None near the bottom; near Lagrange's top it begins about the energy of the upright one, a
    thin layer (Holmes & Marsden 1983); at high energy none is left, unless three moments differ."""
    assert share(45.0, -0.9) == 0.0
    near = [share(4.0, energy, members=512) for energy in (-0.5, 1.0, 4.0)]
    assert near[0] == near[2] == 0.0 and 0.01 < near[1] < 0.1  # measured 0, 0.04, 0
    falls = [share(45.0, energy) for energy in (1.0, 2.0, 4.0, 9.0)]
    assert falls == sorted(falls, reverse=True) and falls[-1] < 0.02  # 0.85, 0.50, 0.19, 0
    assert share(90.0, 9.0, (2.0, 1.5, 1.0)) > 0.15  # measured 0.28


@pytest.mark.slow
def test_a_map_of_the_share():
    found = run_map(prepared_case("chaos_share", (16, 10), members=64))
    part = found["p(megno>4)"].values
    assert not found.failed.values.any() and part[0].max() == 0.0
    middle = part[2:6, 5:11].mean()
    assert 0.3 < middle < 0.6  # measured 0.45
    assert part[:, 0].max() < 0.2 and part[2:, 0].mean() < 0.05  # measured 0.047 and 0.006

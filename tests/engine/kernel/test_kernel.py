"""The kernel: the bits of a member depend on the member alone; a bad member harms no other.

Also: drifts and saves are what they claim to be.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import rigidmc as rm
from bench.problems.published import PROBLEMS
from rigidmc.engine.kernel import arguments
from rigidmc.engine.kernel import layout as K
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects import Gravity, PeriodicTorque, ViscousDamping
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, integrators_for, scheme_of
from rigidmc.physics.observables import bare_observables
from rigidmc.physics.observables.protocol import size
from tests.tools.commands import python
from tests.tools.kernels import block_of, make_block, program, run, slots
from tests.tools.reference import apart

EFFECTS = Gravity(9.81), ViscousDamping(0.1)
EVERYTHING = tuple(kind() for kind in bare_observables().values())
ROWS = sum(size(o.dims) for o in EVERYTHING)
H, TOTAL, STRIDE, MEMBERS = 0.01, 47, 10, 96  # the last save is off the stride
RK4 = scheme_of(INTEGRATORS["rk4"])


def tops(members=MEMBERS, effects=EFFECTS):
    """A block of bodies of all kinds."""
    some = np.random.default_rng(1)
    masses, q = some.uniform(0.2, 1.0, (3, members)), some.normal(size=(4, members))
    body = MassProperties.of(masses.sum(0) - masses, some.normal(size=(3, members)) * 0.1)
    return make_block(body, effects, q / np.linalg.norm(q, axis=0), some.normal(size=(3, members)))


def moved(block, steps=TOTAL, stride=STRIDE, **how):
    """The saves of a block that rk4 moves."""
    return run(block, RK4, EFFECTS, H, steps, EVERYTHING, stride, **how)


@pytest.fixture(scope="module")
def whole():
    """(block, saves) of all the tops in one call."""
    block = tops()
    return block, moved(block)


def same(a, b):
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def value_rows(name):
    names = [n for n, kind in bare_observables().items() for _ in range(size(kind.dims))]
    return [i for i, n in enumerate(names) if n == name]


def test_position_and_neighbours_in_a_block_change_no_bit(whole):
    order = np.random.default_rng(2).permutation(MEMBERS)
    for members in (order, order[:32], np.array([5, 77, 40] + [11] * 29)):
        block = np.ascontiguousarray(tops()[:, members])
        out = moved(block)
        assert same(block, np.ascontiguousarray(whole[0][:, members]))
        assert same(out, np.ascontiguousarray(whole[1][:, :, members]))


@pytest.mark.parametrize("cuts", [(1,), (16, 32), (7, 10, 33, 46)])
def test_a_run_in_several_calls_is_the_run(whole, cuts):
    block = tops()
    out = moved(block, cuts=cuts)
    assert same(block, whole[0])  # the largest drifts too: the end of a call adds no check
    assert same(out, whole[1])


@pytest.mark.parametrize("own", [False, True], ids=["equal steps", "steps of their own"])
def test_calls_of_a_run_go_on_in_time(own):
    """A torque that depends on time, in calls that end within rounds and between them."""
    effects = (PeriodicTorque((0.1, -0.2, 0.3), 2.0, 0.7),)
    made, slots_each, blocks = scheme_of(INTEGRATORS["strang"]), 4 if own else None, []
    for cuts in ((), (16, 18, 40)):
        block = tops(effects=effects)
        block[K.STEPS] = 1 + np.arange(MEMBERS) % 4 if own else 1
        run(block, made, effects, H, 48, cuts=cuts, slots_each=slots_each)
        blocks.append(block)
    assert same(*blocks)
    late = tops(effects=effects)
    late[K.EFFECTS + 4] += 0.1  # a torque that is ahead in time moves the tops elsewhere
    late[K.STEPS] = blocks[0][K.STEPS]
    run(late, made, effects, H, 48, slots_each=slots_each)
    apart = np.abs(late[K.MOMENTUM : K.EXTRA] - blocks[0][K.MOMENTUM : K.EXTRA]).max(0)
    assert apart.min() > 1e-3  # measured 2.6e-3 and 1.0e-2


def test_one_bit_of_the_start_is_not_lost(whole):
    block = tops()
    block[K.MOMENTUM, 3] = np.nextafter(block[K.MOMENTUM, 3], np.inf)
    moved(block)
    assert np.flatnonzero((block != whole[0]).any(axis=0)).tolist() == [3]


def test_saves_are_at_every_stride_and_at_the_end(whole):
    assert slots(TOTAL, STRIDE) == len(whole[1]) == 6
    for slot, steps in enumerate([0, 10, 20, 30, 40, 47]):
        block = tops()
        moved(block, steps)
        assert same(whole[1][slot][value_rows("attitude")], block[K.ATTITUDE : K.MOMENTUM])
        assert same(whole[1][slot][value_rows("momentum")], block[K.MOMENTUM : K.EXTRA])
    assert np.isfinite(whole[1]).all()


def test_a_stride_beyond_the_end_saves_the_first_and_the_last(whole):
    block = tops()
    out = moved(block, stride=10**9)
    assert same(out, np.ascontiguousarray(whole[1][[0, -1]]))


@pytest.mark.parametrize("cuts", [(), (1, 9, 20, 33)])
def test_listed_saves_are_those_of_every_step(whole, cuts):
    listed = np.array([0, 1, 9, 20, 33, 34, TOTAL])
    each = moved(tops(), stride=1)
    block, out = tops(), np.full(listed.size * ROWS * MEMBERS, -1.0)
    saved = {"save_steps": listed, "save_count": listed.size}
    steps = arguments.StepRange(H, 1, 0, TOTAL, 0, 0, TOTAL, **saved)
    moves = program(RK4, EFFECTS, EVERYTHING)
    for first, last in pairwise([0, *cuts, TOTAL]):
        part = steps._replace(first=first, last=last)
        target = arguments.SaveTarget(out, MEMBERS, 0, np.arange(MEMBERS))
        moves.advance(block, part, None, target)
    assert same(out.reshape(-1, ROWS, MEMBERS), each[listed])


@pytest.mark.parametrize("stride", [1, 10, 47, 100, 0])
def test_saves_are_counted_to_each_step(stride):
    listed = np.array([0, 3, 4, TOTAL]) if stride == 0 else np.arange(0, TOTAL, stride)
    at = np.unique(np.append(listed, TOTAL))
    listing = {"save_steps": at, "save_count": at.size} if stride == 0 else {}
    steps = arguments.StepRange(H, 1, stride, TOTAL, 0, 0, TOTAL, **listing)
    for n in range(TOTAL + 1):
        assert steps.saves_until(n) == np.count_nonzero(at <= n)
    assert [steps.step_of_save(i) for i in range(at.size + 1)] == [*at, TOTAL]


def energy_of(block, q, l):
    """Kinetic and potential energy with NumPy, and the largest possible potential energy."""
    body, (w, x, y, z) = MassProperties(*block[K.BODY : K.EFFECTS]), q
    arm = np.array([body.p1, body.p2, body.p3])
    up = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), w**2 - x**2 - y**2 + z**2])
    kinetic = 0.5 * (body.i1 * l[0] ** 2 + body.i2 * l[1] ** 2 + body.i3 * l[2] ** 2)
    heights = [a * u for a, u in zip(arm, up, strict=True)]
    return kinetic, 9.81 * sum(heights), 9.81 * np.abs(arm).sum(0)


def test_drift_rows_are_the_largest_drifts_of_all_checks():
    block = tops()
    kinetic, potential, _ = energy_of(block, block[:4], block[4:7])
    # member 0 starts with almost no energy: its drift is measured against the energies in play
    block[K.BODY + 6 : K.EFFECTS, 0] *= -np.sign(potential[0])
    block[4:7, 0] *= np.sqrt(np.abs(potential[0]) / kinetic[0])
    kinetic, potential, bound = energy_of(block, block[:4], block[4:7])
    scale = np.maximum(np.abs(kinetic + potential), 1e-3 * (kinetic + bound))
    assert abs(kinetic[0] + potential[0]) < 1e-12 < 1e-4 < scale[0]
    # half of them without damping: their drift, from large steps, comes and goes
    block[K.EFFECTS + 1, MEMBERS // 2 :] = 0.0
    out = run(block, RK4, EFFECTS, 10 * H, TOTAL, EVERYTHING, 1)
    q, l = (out[:, value_rows(name)].transpose(1, 0, 2) for name in ("attitude", "momentum"))
    energies, squares = np.add(*energy_of(block, q, l)[:2]), (l**2).sum(0)
    drift, drift2 = (energies - energies[0]) / scale, squares / squares[0] - 1.0
    assert (block[K.DRIFT] > 5e-8).all()  # measured 1.1e-7: large enough to test
    assert (np.abs(drift).argmax(0) < TOTAL).sum() > 10  # measured 32: and not at the end
    # the energy of member 0 reaches many times its scale, and its drift shows the rounding of it
    assert apart(np.abs(drift).max(0), block[K.DRIFT]) < 3e-12  # measured 3e-13
    assert apart(np.abs(drift2).max(0), block[K.DRIFT + 1]) < 7e-14  # measured 7e-15
    omega = block[K.BODY : K.BODY + 3] * out[:, value_rows("momentum")]
    for name, true, bound in (  # measured a tenth
        ("energy_drift", drift[:, None], 4e-12),
        ("l2_drift", drift2[:, None], 3e-13),
        ("energy", energies[:, None], 2e-14),
        ("l2", squares[:, None], 4e-14),
        ("omega", omega, 1e-15),
    ):
        assert apart(out[:, value_rows(name)], true) < bound


def test_what_is_saved_has_the_remainders_of_sums():
    """A step in float32 from numbers that float32 has: with its remainders it is that of float64,
    but for the rounding of what the step adds, which is 1e-3 of the state."""
    body = rm.Body.from_moments((1.0, 1.5, 2.0), mass=1.0, centre=(0.125, 0.25, 0.25))
    start = rm.Start(momentum=(0.5, 0.75, 0.875), attitude=(0.5, 0.5, 0.5, 0.5))
    scene, h = rm.Scene(body, (rm.Gravity(8.0),), start), 2.0**-9
    words, saves = ("attitude", "momentum"), {}
    for dtype in ("float32", "float64"):
        end = rm.simulate(scene, "rk4", dt=h, t_end=h, dtype=dtype, members=1, save=words)
        saves[dtype] = np.concatenate([end[word].values[-1, :, 0] for word in words])
    remainders = saves["float32"] - saves["float32"].astype("f4")
    assert np.abs(remainders).min() > 1.5e-9  # measured 1.57e-9: each of them counts
    # measured 1.45e-10; a remainder with a wrong sign 3e-9, without remainders 1.6e-9 at least
    assert np.abs(saves["float32"] - saves["float64"]).max() < 7e-10


def test_the_momentum_of_a_top_that_starts_at_rest_drifts_by_all_of_it():
    block = tops()
    block[K.MOMENTUM : K.START, 5] = 0.0
    out = moved(block, stride=1)
    squares = out[:, value_rows("l2")[0], 5]
    assert np.allclose(out[:, value_rows("l2_drift")[0], 5], squares > 0.0, atol=3e-16)
    assert squares.max() > 0.0 and abs(block[K.DRIFT + 1, 5] - 1.0) < 3e-16  # rounding of x (1/x)
    assert block[K.STATUS, 5] == K.STATUSES["ok"]


def test_a_check_every_sixteen_steps_finds_drift_without_saves():
    many, few = tops(), tops()
    moved(many, 64, 1)
    run(few, RK4, EFFECTS, H, 64)
    assert same(many[: K.EXTRA], few[: K.EXTRA])
    assert (few[K.DRIFT : K.STATUS] <= many[K.DRIFT : K.STATUS]).all()
    assert (few[K.DRIFT : K.STATUS] > 0).all()
    assert (few[K.GOOD_STEP] == 64).all()


def test_bad_members_are_flagged_and_frozen_and_harm_no_other():
    """Among thousands: one starts with nan, one with inf, one diverges on the way, one has an
    invalid body from the start.
    """
    members, steps = 2048, 200
    healthy = tops(members)
    sick = healthy.copy()
    nan, inf, growing, invalid = 1000, 31, 77, 2047
    sick[K.MOMENTUM + 1, nan] = np.nan
    sick[K.ATTITUDE, inf] = np.inf
    sick[K.BODY : K.EFFECTS, growing] = [1.0] * 3 + [0.0] * 6  # a free sphere, which damping
    sick[K.EFFECTS + 1, growing] = -50.0  # of the wrong sign takes 150 steps to spin too fast
    sick[K.MOMENTUM : K.EXTRA, growing] *= 1e-30
    sick[K.STATUS, invalid] = K.STATUSES["invalid_input"]
    before = sick.copy()
    moved(healthy, steps, 50)
    out = moved(sick, steps, 50)
    others = np.setdiff1d(np.arange(members), [nan, inf, growing, invalid])
    assert same(np.ascontiguousarray(sick[:, others]), np.ascontiguousarray(healthy[:, others]))
    assert not sick[K.STATUS, others].any()
    assert sick[K.STATUS, [nan, inf, growing, invalid]].tolist() == [
        K.STATUSES[s] for s in ["non_finite"] * 3 + ["invalid_input"]
    ]
    for m in (nan, inf, invalid):
        assert same(sick[:7, m], before[:7, m])  # unchanged
        assert sick[K.GOOD_STEP, m] == sick[K.FAULT_STEP, m] == 0
        assert np.isnan(sick[K.DRIFT, m])
    last = int(sick[K.GOOD_STEP, growing])
    assert 100 < last < sick[K.FAULT_STEP, growing] < steps  # measured 176 and 192
    again = np.ascontiguousarray(before[:, growing // 32 * 32 : growing // 32 * 32 + 32])
    moved(again, last, 50)
    assert again[K.STATUS, growing % 32] == 0
    assert same(sick[:7, growing], again[:7, growing % 32])  # frozen at its last good state
    assert np.isfinite(sick[: K.STATUS, growing]).all()
    slot = last // 50 + 1
    assert np.isfinite(out[:, :, growing]).all()
    frozen = out[slot:, 3:6, growing]  # saved frozen from then on
    assert (frozen == sick[K.MOMENTUM : K.EXTRA, growing]).all()


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # of long steps
@pytest.mark.parametrize("size", [1e-2, 1e2])
def test_the_vertical_momentum_is_judged_by_the_largest_that_energies_allow(size):
    """Tops of 1/100 and of 100 times the mass move alike: five of 24 exceed the limit."""

    def flagged(size):
        moments, start = [size * i for i in (1.0, 1.4, 2.0)], rm.normal(3.0, 0.5)
        body = rm.Body.from_moments(moments, mass=size, centre=(0.1, 0.2, 0.3))
        omega = 0.3, rm.normal(0.5, 0.2), start
        scene = rm.Scene(body, rm.Gravity(9.81), rm.Start(omega=omega, attitude="uniform"))
        ways = {"dt": 0.1, "t_end": 40.0, "members": 24, "momentum_limit": 1e-4}
        return rm.simulate(scene, "rk4", energy_limit=1.0, **ways).status_step.values

    one, other = flagged(1.0), flagged(size)
    assert one.tolist() == other.tolist() and (one > 0).sum() == 5


@pytest.mark.parametrize("name", ["rk4", "rk8", "exact", "rotations"])
def test_without_attitude_the_momentum_has_the_same_bits(name):
    made = scheme_of(INTEGRATORS[name], TurnBounds(0.1, 0.1))
    with_it, without = tops(effects=()), tops(effects=())
    before = without[: K.MOMENTUM].copy()
    run(with_it, made, (), H, 100)
    run(without, made, (), H, 100, attitude=False)
    assert same(with_it[K.MOMENTUM : K.GOOD_STEP], without[K.MOMENTUM : K.GOOD_STEP])
    assert same(without[: K.MOMENTUM], before)  # not moved
    assert not same(with_it[: K.MOMENTUM], before)


def test_no_step_at_all():
    block = tops()
    before = block[:7].copy()
    out = moved(block, 0)
    assert same(block[:7], before)
    assert not block[K.STATUS].any()
    assert len(out) == 1


def physics():
    """A few steps of every integrator with everything switched on, compiled or in plain Python."""
    results = {}
    bodies = [PROBLEMS[n] for n in ("hairer_heavy", "simo_wong_top", "cardona_top")]
    for name, kind in INTEGRATORS.items():
        if name in ("closed", "gbs12"):  # makes no steps; compiles for 5 s, see test_gbs12.py
            continue
        effects = next(e for e in (EFFECTS, EFFECTS[:1], ()) if name in integrators_for(e))
        block, made = block_of(bodies, effects), scheme_of(kind, TurnBounds(0.2, 0.2), effects)
        saved = EVERYTHING if name == "rk4" else ()
        out = run(block, made, effects, 1e-3, 20, saved, 7)
        results[name] = block
        if saved:
            results["saves"] = out
    return results


def test_plain_python_runs_the_same_physics(tmp_path):
    root = Path(__file__).parents[3]
    code = (
        "import numpy; from tests.engine.kernel.test_kernel import physics; "
        f"numpy.savez({str(tmp_path / 'plain.npz')!r}, **physics())"
    )
    python(code, cwd=root, NUMBA_DISABLE_JIT="1")
    plain = np.load(tmp_path / "plain.npz")
    compiled = physics()
    assert set(plain) == set(compiled)
    for name, block in compiled.items():
        if name == "saves":
            size = np.maximum(np.abs(block).max(axis=(0, 2), keepdims=True), 1.0)
            assert apart(plain[name] / size, block / size) < 4e-15  # measured 4e-16
            continue
        for rows in (slice(K.ATTITUDE, K.MOMENTUM), slice(K.MOMENTUM, K.START)):
            error = np.abs(plain[name][rows] - block[rows]) / np.linalg.norm(block[rows], axis=0)
            assert error.max() < 4e-15  # measured 4e-16: fused multiply-add rounds once less

"""Derivatives of the engine are those of its own step in 40 digits; values keep their bits."""

import mpmath as mp
import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.compiler.trees import tree_unflatten
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import SaveTarget, StepRange
from rigidmc.engine.kernel.layout import opening_substep
from rigidmc.engine.program_spec import Derivatives
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.integrators.protocol import from_stepping, precompute, step, to_stepping
from rigidmc.planning.initial import noise_keys
from rigidmc.runs.assemble import make_program

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
MEMBERS, STEPS, H = 32, 100, 0.01
GRAVITY = (rm.Gravity(g=9.81),)
NAMES = [name for name in INTEGRATORS if name != "closed"]


def prepared(name, effects=GRAVITY, save=("omega", "attitude"), **settings):
    """A run of bodies with three moments, at random starts."""
    rng = np.random.default_rng(1)
    body = rm.Body.from_moments((1.0, 1.5, 2.0), mass=1.0, centre=(0.05, 0.02, 0.1))
    q = rng.normal(size=(MEMBERS, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    start = rm.Start(omega=1.5 * rng.normal(size=(MEMBERS, 3)), attitude=q)
    scene = rm.Scene(body, effects=() if name == "exact" else effects, start=start)
    steps = settings if "turn" in settings else {"dt": H, **settings}
    times = {"t_end": H * STEPS, "every": H * STEPS / 2}
    return rm.prepare(scene, name, members=MEMBERS, save=save, **times, **steps)


def directions(run, count=2):
    """(count, rows, members): changes of the rows of members at their start."""
    rows, rng = run.initial(0, MEMBERS)[0], np.random.default_rng(5)
    change = np.zeros((count, *rows.shape))
    change[:, layout.ATTITUDE : layout.EXTRA] = rng.normal(size=(count, 7, MEMBERS))
    # Quaternions stay of unit length: members with other lengths are flagged and stop.
    q, turn = rows[layout.ATTITUDE : layout.MOMENTUM], change[:, layout.ATTITUDE : layout.MOMENTUM]
    turn -= (turn * q).sum(1, keepdims=True) * q
    change[1:, layout.BODY :] = 0.1 * rng.normal(size=(count - 1, len(rows) - layout.BODY, MEMBERS))
    return change


def moved(run, change=None, at_once=0):
    """(saves, rows at the end) of a run, with derivatives along changes of its start."""
    plan, columns = run.plan, 0 if change is None else len(change)
    at_once = at_once or columns
    passes = columns // at_once if columns else 1
    program = make_program(plan, derivatives=Derivatives(at_once, passes))
    rows = run.initial(0, MEMBERS)[0]
    block = rows if change is None else np.concatenate([rows, *change])
    out = np.full((plan.grid.saves, run.layout.values, 1 + columns, MEMBERS), np.nan)
    grid, order = plan.grid, np.arange(MEMBERS)
    slots = int(rows[layout.STEPS].max()) if plan.has_member_steps else 1
    steps = StepRange(
        grid.dt, slots, slots * grid.stride, slots * grid.steps, int(plan.has_member_steps), 0,
        slots * grid.steps, slots * grid.head, grid.last_dt,
    )  # fmt: skip
    keys = noise_keys(plan.model.effects, plan.run.seed, order)
    program.advance(block, steps, keys, SaveTarget(out, MEMBERS, 0, order))
    return out, block.reshape(1 + columns, -1, MEMBERS)


def exact_flow(run, rows):
    """(q, L) after the steps of a run, of one member in the working precision of mpmath."""
    integrator, substeps = run.plan.scheme.integrator, run.plan.scheme.substeps
    body = tree_unflatten(MassProperties(*[0.0] * 9), rows, layout.BODY)
    effects = tree_unflatten(blank(run.plan.model.effects), rows, layout.EFFECTS)
    q, l, h = tuple(rows[:4]), tuple(rows[4:7]), mp.mpf(run.plan.grid.dt)
    opening = opening_substep(substeps[0], h)
    q, l = to_stepping(integrator, body, effects, 0.0, opening, q, l)
    parts = [tuple(mp.mpf(x) * h for x in row[:3]) for row in substeps[1:]]
    constants = precompute(integrator, body, parts[0], l)
    for _ in range(STEPS):
        for part in parts:
            q, l = step(integrator, body, effects, 0.0, h, part, q, l, constants)
    q, l = from_stepping(integrator, body, effects, 0.0, opening, q, l)
    return np.array(q + tuple(l[:3]))


@pytest.mark.parametrize("name", ["rk4", pytest.param("rk8", marks=pytest.mark.slow)])
def test_derivatives_are_those_of_the_step_in_40_digits(name, monkeypatch):
    """rk4 1.3e-15 and rk8 6.8e-16 of the largest; asked 1e-14."""
    monkeypatch.setattr(mp.mpf, "sqrt", mp.sqrt, raising=False)
    run = prepared(name)
    change = directions(run)
    start, (_, end) = run.initial(0, MEMBERS)[0][:, 3], moved(run, change)
    with mp.workdps(50):
        tiny = mp.mpf(10) ** -20
        for j in range(2):
            along = [mp.mpf(x) for x in change[j, :, 3]]
            there, back = (
                exact_flow(run, [mp.mpf(x) + s * d for x, d in zip(start, along, strict=True)])
                for s in (tiny, -tiny)
            )
            true = ((there - back) / (2 * tiny)).astype(float)
            found = end[1 + j, : layout.EXTRA, 3]
            assert np.abs(found - true).max() < 1e-14 * np.abs(true).max()


def check_bits(run):
    """Values have the bits of a plain run; return (derivatives, saves, rows at the end)."""
    change = directions(run)
    plain, plain_end = moved(run)
    saves, end = moved(run, change)
    assert np.array_equal(saves[:, :, :1], plain, equal_nan=True)
    assert np.array_equal(end[0], plain_end[0], equal_nan=True)
    return change, saves, end


def test_values_keep_their_bits():
    _, saves, _ = check_bits(prepared("rk4"))
    assert np.abs(saves[1:, :, 1:]).min() > 0.0


CASES = {
    "float32": {"dtype": "float32"},
    "compensated": {"compensated": True},
    "own steps": {"turn": 0.05},
    "monitors": {"save": ("omega", "flips", "nutation", "energy_mean", "omega_max")},
    "growth": {"save": ("omega", "megno")},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", NAMES)
def test_every_integrator_and_kind_of_run_keeps_its_bits(name, case):
    if name == "exact" and case in ("compensated", "own steps"):
        pytest.skip("not offered")
    run = prepared(name, **CASES[case])
    change, saves, end = check_bits(run)
    again, again_end = moved(run, change, at_once=1)  # in two passes
    assert np.array_equal(saves, again, equal_nan=True)
    assert np.array_equal(end, again_end, equal_nan=True)


def test_times_of_two_events_change_as_differences_do():
    body = rm.Body.from_moments((1.0, 1.5, 2.0), mass=1.0, centre=(0.05, 0.02, 0.1))
    omega = 1.5 * np.random.default_rng(1).normal(size=(MEMBERS, 3))
    cones = rm.Passage(1, 1.2), rm.Passage(3, 0.4)

    def times(by):
        scene = rm.Scene(body, GRAVITY, rm.Start(omega=omega + [by, 0.0, 0.0]), observables=cones)
        return rm.simulate(scene, integrator="rk8", dt=0.02, t_end=2.0, every=1.0, save=cones,
                           members=MEMBERS, wrt="start.omega.1")  # fmt: skip

    ds, high, low = map(times, (0.0, 1e-5, -1e-5))
    for name in ("passage_last", "passage_first_2", "passage_last_2"):
        change = (high[name] - low[name]).values / 2e-5
        assert np.abs(change).max() > 1.0
        assert np.abs(ds[f"d_{name}"].values[0] - change).max() < 1e-7, name  # measured 2.2e-9

"""The compiled kernel on arrays: members in, states and saves out.

Nothing of the package above the engine.
"""

from itertools import pairwise

import numpy as np
import pytest

from rigidmc.engine import program as programs
from rigidmc.engine.kernel import arguments
from rigidmc.engine.kernel import layout as K
from rigidmc.engine.program_spec import ProgramSpec
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects.protocol import blank, numbers, parameter_count
from rigidmc.physics.integrators import TurnBounds, integrators_for, scheme_of
from rigidmc.physics.integrators.protocol import from_stepping, precompute, step, to_stepping
from rigidmc.physics.observables.protocol import size

NOTHING = np.empty(0)
# Their kernels compile for 2.5 s each; tests/physics/integrators/test_gbs12.py has quick tests.
DEAR = ("gbs12",)


def stepping(effects=()):
    """Parameters of a test: the integrators that make steps, the dear ones for slow tests."""
    able = [name for name in integrators_for(effects) if name != "closed"]
    return [pytest.param(n, marks=pytest.mark.slow) if n in DEAR else n for n in able]


def make_block(body, effects, attitude, momentum):
    """Rows of a block; fields of body and effects are numbers or one per member.

    Copies of the last member fill up the lanes.
    """
    attitude, momentum = np.asarray(attitude, float), np.asarray(momentum, float)
    members = momentum.shape[1]
    rows = np.zeros((K.EFFECTS + parameter_count(*effects), members))
    rows[K.ATTITUDE : K.MOMENTUM] = attitude.reshape(4, -1)
    rows[K.MOMENTUM : K.EXTRA] = momentum
    values = [value for effect in effects for _, _, value in numbers(effect)]
    for row, field in enumerate([*body[:BODY_NUMBERS], *values], start=K.BODY):
        rows[row] = field
    return np.ascontiguousarray(np.pad(rows, ((0, 0), (0, -members % K.LANES)), mode="edge"))


def block_of(problems, effects=None):
    """The block of named problems, one per member; with their own gravity if `effects` is None."""
    names = "moments", "static_moment", "attitude", "momentum"
    fields = (np.array([getattr(p, name) for p in problems], float).T for name in names)
    moments, static, attitude, momentum = fields
    if effects is None:
        weights = np.array([p.gravity for p in problems])
        effects = tuple(type(e)(weights) for e in problems[0].effects)
    return make_block(MassProperties.of(moments, static), effects, attitude, momentum)


def slots(total, stride):
    """The number of saves of a run, step 0 included."""
    return (total + stride - 1) // stride + 1


def program(made, effects, observables=(), lanes=None, **how):
    """The compiled Program of a Form; how : further fields of a ProgramSpec."""
    return programs.Program(ProgramSpec(made, blank(effects), observables, **how), lanes)


def run(
    block, made, effects, h, steps, observables=(), stride=None, cuts=(), slots_each=None, **how
):
    """Change the block in place by `steps` steps; return the saves (slot, value row, member).

    made : a Form;  cuts : steps at which the run is split into several calls
    slots_each : rounds of length h, in which each member makes block[STEPS] steps; `steps` and
        `stride` then count slots
    how : as of `program`
    """
    stride = stride or max(steps, 1)
    rows = sum(size(o.dims) for o in observables)  # of works nothing where none are kept
    width = block.shape[1] if observables else 0
    out = np.full(slots(steps, stride) * rows * width, -1.0) if observables else NOTHING
    saves = arguments.SaveTarget(out, width, 0, np.arange(block.shape[1]))
    moves, own = program(made, effects, observables, **how), int(slots_each is not None)
    for first, last in pairwise([0, *cuts, steps]):
        part = arguments.StepRange(float(h), slots_each or 1, stride, steps, own, first, last)
        moves.advance(block, part, None, saves)
    return out.reshape(-1, rows, width) if observables else None


def march(kind, problems, h, steps, made=None, **how):
    """(attitudes (4, n), momenta (3, n)) of named problems after `steps` steps."""
    block, effects = block_of(problems), problems[0].effects
    made = made or prepare(kind, max(turn(p, h) for p in problems), effects)
    run(block, made, effects, h, steps, **how)
    assert not block[K.STATUS].any()
    return block[: K.MOMENTUM, : len(problems)], block[K.MOMENTUM : K.EXTRA, : len(problems)]


def prepare(kind, turn, effects=(), symmetric=False):
    """The Form for steps that turn by `turn` [rad]."""
    return scheme_of(kind, TurnBounds(turn, 3.0 * turn, symmetric), effects)


def one_step(made, body, effects, t, h, q, l):
    """One step in plain Python, opened before and closed after."""
    if len(q) == 2 and implements(made.integrator, "with_compensation"):
        substeps = np.vstack([np.zeros(4), made.substeps[1:]])
        made = made._replace(integrator=made.integrator.with_compensation(), substeps=substeps)
    lead, rows = [h * x for x in made.substeps[0]], made.substeps[1:]
    q, l = to_stepping(made.integrator, body, effects, t + lead[3], lead, q, l)
    once = precompute(made.integrator, body, tuple(h * rows[0][:3]), l)
    for row in rows:
        part = t + h * row[3], h, tuple(h * row[:3])
        q, l = step(made.integrator, body, effects, *part, q, l, once)
    return from_stepping(made.integrator, body, effects, t + h + lead[3], lead, q, l)


def turn(problem, h):
    """The angle by which L moves within the body in a step [rad], plus a tenth for kicks."""
    return 1.1 * abs(h) * turn_rate_of(problem.moments, problem.momentum)


def turn_rate_of(moments, momentum):
    """lambda = sqrt(P + max(Q1, Q3)) [rad/s], the frequency of L in the body, axes in any order."""
    order = np.argsort(moments)
    (one, two, three), size = np.asarray(moments, float)[order], np.linalg.norm(momentum)
    u = np.asarray(momentum, float)[order] / size
    pairs = (two, three), (three, one), (one, two)
    first, second, third = ((a - b) / a / b for a, b in pairs)
    p, q1, q3 = first * third * u[1] ** 2, -second * third * u[0] ** 2, -first * second * u[2] ** 2
    return float(size * np.sqrt(p + max(q1, q3)))

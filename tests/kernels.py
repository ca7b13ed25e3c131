"""The compiled kernel on arrays: members in, states and saves out, nothing of the package above the engine."""

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.free_flow import turn_rate
from rigidmc.engine import kernel as K

NOTHING = np.empty(0)
SIZES = {(): 1, ("axis",): 3, ("quat",): 4}


def make_block(body, effects, attitude, momentum):
    """Rows of a block; fields of body and effects are numbers or one per member. The last member fills up the lanes."""
    attitude, momentum = np.asarray(attitude, float), np.asarray(momentum, float)
    members = momentum.shape[1]
    rows = np.zeros((K.EFFECTS + sum(map(len, effects)), members))
    rows[K.ATTITUDE : K.MOMENTUM] = attitude.reshape(4, -1)
    rows[K.MOMENTUM : K.START] = momentum
    for row, field in enumerate([*body, *(field for effect in effects for field in effect)], start=K.BODY):
        rows[row] = field
    return np.ascontiguousarray(np.pad(rows, ((0, 0), (0, -members % K.LANES)), mode="edge"))


def block_of(problems, effects=None):
    """The block of named problems, one a member; their own gravity where `effects` is not given."""
    moments, static = (np.array([getattr(p, name) for p in problems], float).T for name in ("moments", "static_moment"))
    effects = effects if effects is not None else tuple(type(e)(np.array([p.gravity for p in problems])) for e in problems[0].effects)
    attitude, momentum = (np.array([getattr(p, name) for p in problems]).T for name in ("attitude", "momentum"))
    return make_block(MassProperties.of(moments, static), effects, attitude, momentum)


def slots(total, stride):
    """Saves of a run, step 0 included."""
    return (total + stride - 1) // stride + 1


def run(block, integrator, effects, h, steps, observables=(), stride=None, attitude=True, cuts=()):
    """Change the block in place, `steps` steps further on; the saves as an array (slot, value row, member).

    cuts : steps at which the run is split into several calls
    """
    stride = stride or max(steps, 1)
    size = sum(SIZES[o.dims] for o in observables)
    width = block.shape[1] if observables else 0
    out = np.full(slots(steps, stride) * size * width, -1.0) if observables else NOTHING
    types = tuple(type(e)(*[0.0] * len(e)) for e in effects)  # the kernel reads the fields from the block
    edges = [0, *cuts, steps]
    for first, last in zip(edges, edges[1:], strict=False):
        K.advance(integrator, types, observables, (0.0,) if attitude else (), block, out, width, 0, float(h), first, last, stride, steps)
    return out.reshape(-1, size, width) if observables else None


def march(kind, problems, h, steps, effects=None, integrator=None):
    """(attitudes (4, n), momenta (3, n)) of named problems after `steps` steps of an integrator of INTEGRATORS."""
    block = block_of(problems, effects)
    integrator, pieces = (integrator, 1) if integrator else prepare(kind, max(turn(p, h) for p in problems))
    run(block, integrator, problems[0].effects if effects is None else effects, h / pieces, steps * pieces)
    assert not block[K.STATUS].any()
    return block[: K.MOMENTUM, : len(problems)], block[K.MOMENTUM : K.START, : len(problems)]


def prepare(kind, turn, attitude=True):
    """(integrator, pieces per step) for steps that turn by `turn` [rad]."""
    return kind().prepared(turn, attitude) if hasattr(kind, "prepared") else (kind(), 1)


def turn(problem, h):
    """Turn of the momentum within the body in a step h [rad]; a tenth more, for what kicks may add."""
    return 1.1 * abs(h) * turn_rate_of(problem.moments, problem.momentum)


def turn_rate_of(moments, momentum):
    """lambda = sqrt(P + max(Q1, Q3)) of `rigidmc.dynamics.free_flow`, whatever the order of the axes [rad/s]."""
    order = np.argsort(moments)
    moments, momentum = (np.asarray(x, float)[order] for x in (moments, momentum))
    size = np.linalg.norm(momentum)
    return float(size * turn_rate(MassProperties.of(tuple(moments), (0.0, 0.0, 0.0)), tuple(momentum / size)))

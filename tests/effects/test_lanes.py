"""All effects in one kernel of lanes, in float32 and with parameters of each member's own, against plain Python in float64."""

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects import canonical
from rigidmc.effects.parameters import filled, numbers
from rigidmc.engine import layout as K
from rigidmc.integrators import INTEGRATORS
from tests.effects.test_effects import EXAMPLES, MOMENTS, STATIC
from tests.kernels import make_block, one_step, prepare, run

STEPS, H, MEMBERS = 5, 0.02, 4


def test_strang_with_the_flows_of_all_effects():
    some = np.random.default_rng(9)
    effects = canonical(tuple(EXAMPLES.values()))
    each = tuple(filled(type(e), [v * some.uniform(0.8, 1.2, MEMBERS) for _, _, v in numbers(e)]) for e in effects)
    body, q, l = MassProperties.of(MOMENTS, STATIC), some.normal(size=(4, MEMBERS)), some.normal(size=(3, MEMBERS))
    q /= np.linalg.norm(q, axis=0)
    block = make_block(body, each, q, l)
    made = prepare(INTEGRATORS["strang"], 0.2, effects)
    run(block, made, effects, H, STEPS, dtype=np.float32)
    for m in range(MEMBERS):
        mine = tuple(filled(type(e), [float(v[m]) for _, _, v in numbers(e)]) for e in each)
        at, now = tuple(q[:, m]), tuple(l[:, m])
        for i in range(STEPS):
            at, now = one_step(made, body, mine, i * H, H, at, now)
        assert np.abs(block[K.ATTITUDE : K.MOMENTUM, m] - at).max() < 5e-7  # measured 7e-8
        assert np.abs(block[K.MOMENTUM : K.REST, m] - now).max() < 5e-6  # measured 1.6e-6
        assert np.abs(now - l[:, m]).max() > 0.05

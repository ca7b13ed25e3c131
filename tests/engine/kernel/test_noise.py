"""Random words against numpy's Philox to the bit; the logarithm against 40 digits; the normal law.

In plain Python and compiled.
"""

import math
from typing import NamedTuple

import mpmath as mp
import numpy as np
import pytest
from scipy import stats

from rigidmc.engine import program
from rigidmc.engine.formulas import evaluate
from rigidmc.engine.kernel import arguments, layout
from rigidmc.engine.kernel.noise import normal_deviates as of_step
from rigidmc.engine.kernel.noise import normals, philox, uniform_number
from rigidmc.engine.program_spec import ProgramSpec
from rigidmc.engine.streams import key_of, stream_of
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.functions import as_float, as_word, logarithm
from rigidmc.physics.dynamics.methods import OFF, ON, flag
from rigidmc.physics.effects import Bath
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, scheme_of
from tests.tools.kernels import make_block

KEY, STREAM, STEP = key_of(5), np.uint64(stream_of("effects.bath.noise")), np.uint64(12345)
ONE = np.uint64(1)


def words(member):
    with np.errstate(over="ignore"):
        return philox((KEY[0], KEY[1]), (np.uint64(member) + ONE, STEP, STREAM, ONE))


class Member(NamedTuple):
    """The words and deviates of one member.

    number : the bits of its index and 1, those of its words as numbers
    """

    number: float

    def values(self):
        four = philox((KEY[0], KEY[1]), (as_word(self.number), STEP, STREAM, ONE))
        a, b, c, d = four
        return (as_float(a), as_float(b), as_float(c), as_float(d), *normals(four))


@pytest.fixture(scope="module")
def made():
    numbers = np.arange(1, (1 << 20) + 1, dtype=np.uint64).view(float)
    found = evaluate(Member, 7, numbers[None], side=1)
    return found[4:], found[:4].copy().view(np.uint64)


def test_words_are_those_of_numpy(made):
    start = np.array([0, STEP, STREAM, 1], np.uint64)
    raw = np.random.Philox(key=KEY, counter=start).random_raw(4 * made[1].shape[1])
    theirs = raw.reshape(-1, 4).T
    assert np.array_equal(made[1], theirs)
    assert [list(words(m)) for m in (0, 1, 999)] == [list(theirs[:, m]) for m in (0, 1, 999)]


def test_words_side_by_side_are_the_same(made):
    numbers = np.arange(1, 1001, dtype=np.uint64).view(float)
    found = evaluate(Member, 7, numbers[None])
    assert np.array_equal(found[:4].copy().view(np.uint64), made[1][:, :1000])
    assert np.array_equal(found[4:], made[0][:, :1000])


def test_bits_come_and_go():
    for x in (1.0, -2.5, 1e-310, 3e300):
        assert as_float(as_word(x)) == x


def test_logarithm_is_right_relative_to_its_size():
    some = np.random.default_rng(2)
    small, near = 2.0 ** -some.uniform(0, 53, 2000), 1.0 - 2.0 ** -some.uniform(1, 53, 500)
    xs = np.concatenate([small, near, [2.0**-53, 1.0 - 2.0**-53, 0.5]])
    with mp.workdps(40):
        worst = max(abs((logarithm(x) - mp.log(x)) / mp.log(x)) for x in map(float, xs))
    assert worst < 2.5e-16  # measured 1.2e-16


def test_normals_are_those_of_box_and_muller(made):
    out, raw = made
    u = ((raw >> np.uint64(12)).astype(float) + 0.5) * 2.0**-52
    one, two, angle = np.sqrt(-2.0 * np.log(u[0])), np.sqrt(-2.0 * np.log(u[2])), 0.25 * np.pi * u
    octant = [[(word >> np.uint64(i)) & np.uint64(1) for i in range(3)] for word in raw]
    minus = [[1.0 - 2.0 * bit.astype(float) for bit in bits] for bits in octant]
    x = [minus[i][1] * np.where(octant[i][0], np.sin(angle[i]), np.cos(angle[i])) for i in range(4)]
    y = minus[1][2] * np.where(octant[1][0], np.cos(angle[1]), np.sin(angle[1]))
    theirs = np.stack([one * x[1], one * y, two * x[3]])
    assert np.abs(out - theirs).max() < 5e-15  # measured 9e-16
    assert normals(words(7)) == pytest.approx(tuple(out[:, 7]), abs=1e-15)


def test_normals_follow_their_law(made):
    """Keyed: the same numbers each time. Moments within 3 standard errors, tails counted to 4.5
    sigma, no correlation.
    """
    out = made[0]
    n = out.shape[1]
    assert (np.abs(out.mean(1)) < 3.0 / math.sqrt(n)).all()
    assert (np.abs(out.var(1) - 1.0) < 3.0 * math.sqrt(2.0 / n)).all()
    assert (np.abs(stats.kurtosis(out, axis=1)) < 3.0 * math.sqrt(24.0 / n)).all()
    assert all(stats.kstest(x, "norm").pvalue > 0.01 for x in out)
    for sigma in (3.0, 4.0, 4.5):
        expected = 6.0 * n * stats.norm.sf(sigma)
        assert abs(np.count_nonzero(np.abs(out) > sigma) - expected) < 3.5 * math.sqrt(expected)
    assert np.abs(np.corrcoef(out) - np.eye(3)).max() < 4.0 / math.sqrt(n)
    # of neighbours
    assert np.abs(np.mean(out[:, 1:] * out[:, :-1], axis=1)).max() < 4.0 / math.sqrt(n)


def test_the_smallest_number_is_8_sigma():
    low = uniform_number(np.uint64(0))
    assert low == 2.0**-53
    assert 8.5 < math.sqrt(-2.0 * logarithm(low)) < 8.6
    assert uniform_number(np.uint64(2**64 - 1)) == 1.0 - 2.0**-53


def drawn(paired, number, member=7):
    with np.errstate(over="ignore"):
        word = np.uint64(member) + ONE
        return np.array(of_step(paired, KEY, word, np.uint64(number), STREAM))


def test_a_paired_step_has_the_noise_of_two():
    both = (drawn(OFF, 24690) + drawn(OFF, 24691)) / math.sqrt(2.0)
    assert drawn(OFF, 12345) == pytest.approx(normals(words(7)))
    assert np.abs(drawn(ON, 12345) - both).max() < 1e-15  # measured 2e-16
    assert np.abs(drawn(ON, 12344) - both).max() > 0.1


@pytest.mark.parametrize("paired", [False, True])
def test_steps_with_the_noise_of_steps_of_half_the_length(paired):
    """A free sphere in a bath is a sum of its deviates: after five steps of 0.2 s from rest."""
    h, steps, members = 0.2, 5, 32
    effects = (Bath(1.3, 0.7),)
    body = MassProperties.of((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    block = make_block(body, effects, np.eye(4)[:1].T.repeat(members, 1), np.zeros((3, members)))
    made = scheme_of(INTEGRATORS["strang"], TurnBounds(1.0, 1.0), effects)
    moves = program.Program(ProgramSpec(made, blank(effects), paired=paired))
    noise = arguments.NoiseKeys(*KEY, np.array([STREAM]), np.arange(members))
    moves.advance(block, arguments.StepRange(h, 1, steps, steps, 0, 0, steps), noise)
    keeps, spread = math.exp(-1.3 * h), math.sqrt(0.7 * (1.0 - math.exp(-2.6 * h)))
    momentum = np.zeros((3, members))
    for s in range(steps):
        three = [drawn(flag(paired), s, member) for member in range(members)]
        momentum = keeps * momentum + spread * np.array(three).T
    off = np.abs(block[layout.MOMENTUM : layout.EXTRA] - momentum).max()
    assert off < 5e-15  # measured 5e-16

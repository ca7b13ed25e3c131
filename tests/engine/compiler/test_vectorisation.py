"""The machine code of steps: packed arithmetic on the widest registers, no call, no idle work."""

import inspect
import math
import platform
import re
import textwrap
from typing import NamedTuple

import pytest

from rigidmc.engine.compiler.compose import inline
from rigidmc.engine.compiler.frozen import frozen
from rigidmc.engine.machine import vector_bits
from rigidmc.physics.dynamics.methods import OFF, ON
from rigidmc.physics.dynamics.so3 import cross, vertical
from rigidmc.physics.effects import Gravity, ViscousDamping
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, rk4, scheme_of
from rigidmc.physics.integrators.rk4 import RK4, ScaledRK4
from tests.tools.assembly import ARITHMETIC, LIBM, STORE, Case, blocks_of, case, counted, loop_of

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="reads x86-64 assembly"
)


class Gamma(NamedTuple):
    """An effect that calls the library, one member at a time."""

    def torque(self, l):
        return math.gamma(1.5 + l[0]), 0.0, 0.0


def weight(g, body, q):
    """The torque of gravity, p = mass times centre of mass and the vertical u: -g p x u."""
    return cross(vertical(q), (g * body.p1, g * body.p2, g * body.p3))


def spun_up(change, share, h, body, torque):
    """change + share h dw/dt by a torque."""
    (x, y, z), (a, b, c), (d, e, f) = rk4.quarters(body, h), change, torque
    return a + (share * h * x) * d, b + (share * h * y) * e, c + (share * h * z) * f


for _function in (weight, spun_up):
    inline(_function)


def without_effects(instead=r"\5"):
    """The step of RK4 as one would write it for free bodies alone.

    Its source has every `add_push(..., t, h, share, q, w, x)` replaced by x, or by a torque.
    """
    source = textwrap.dedent(inspect.getsource(ScaledRK4.step))
    call = r"add_push\(effects, body, ([^,]+), h, ([^,]+), ([^,]+), ([^,]+), (.*)\)$"
    free, count = re.subn(call, instead, source, flags=re.M)
    assert count == 4
    space = {**vars(rk4), "weight": weight, "spun_up": spun_up}
    exec(free, space)
    return space["step"]


class ByHand(NamedTuple):
    """RK4 of a free body and nothing else."""

    step = without_effects()
    groups = 2


class HeavyByHand(NamedTuple):
    """RK4 of a heavy body and nothing else."""

    step = without_effects(r"spun_up(\5, \2, h, body, weight(effects[0].g, body, \3))")
    groups = 2


G, D, WITH, WITHOUT = Gravity(1.0), ViscousDamping(1.0), ON, OFF
WITH_SUMS = RK4().scheme(())._replace(integrator=RK4().scheme(()).integrator.with_compensation())


CASES = {
    "rk4": case("rk4"),
    "rk4 gravity": case("rk4", (G,)),
    "rk4 momentum": case("rk4", (), WITHOUT),
    "rk4 by hand": Case(scheme_of(frozen(ByHand()))),
    "rkmk4 gravity damping": case("rkmk4", (G, D)),
    "strang gravity damping": case("strang", (G, D)),
    "exact": case("exact"),
    "exact momentum": case("exact", (), WITHOUT),
    "strang gravity": case("strang", (G,)),
    "chin4 gravity": case("chin4", (G,)),
    "aba864 gravity": case("aba864", (G,)),
    "rotations gravity": case("rotations", (G,)),
    "fast symmetric": Case(
        scheme_of(INTEGRATORS["strang"], TurnBounds(3.0, 3.0, True), (G,)), (G,)
    ),
    "rk8 gravity": case("rk8", (G,)),
    "cf4 gravity": case("cf4", (G,)),
    "ck45 gravity": case("ck45", (G,)),
    "midpoint gravity": case("midpoint", (G,)),
    "rk4 gravity compensated": Case(WITH_SUMS, (G,), WITH, ON),
    "strang gravity compensated": case("strang", (G,), WITH, ON),
    "rk4 gravity float32": case("rk4", (G,), WITH, OFF, "float32"),
    "rk8 gravity float32": case("rk8", (G,), WITH, OFF, "float32"),
    "strang gravity float32": case("strang", (G,), WITH, OFF, "float32"),
    "rk4 gravity damping works": Case(RK4().scheme(()), (G, D), works=(0.0, 0.0)),
    "rk4 gravity by hand": Case(scheme_of(frozen(HeavyByHand())), (G,)),
    "rkmk4 gravity damping float32": case("rkmk4", (G, D), WITH, OFF, "float32"),
}
RARE = (  # with  pytest -m slow
    "fast symmetric", "rotations gravity", "ck45 gravity", "aba864 gravity", "rk8 gravity float32",
    "rkmk4 gravity damping float32", "strang gravity compensated", "chin4 gravity", "cf4 gravity",
    "midpoint gravity",
    "rk4 gravity compensated", "strang gravity float32", "rk4 gravity damping works",
)  # fmt: skip
BROKEN = {"rk4 gamma": case("rk4", (frozen(Gamma()),))}


def counts(names):
    return {name: counted((CASES | BROKEN)[name]) for name in names}


@pytest.fixture(scope="module")
def code():
    """Counts for all cases except the rare ones."""
    return counts(name for name in (*CASES, *BROKEN) if name not in RARE)


@pytest.mark.parametrize("name", [name for name in CASES if name not in RARE])
def test_the_step_is_packed_arithmetic_on_the_widest_registers(code, name):
    is_packed(code[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", RARE)
def test_the_step_of_rare_kernels_is_packed_too(name):
    is_packed(counts([name])[name])


def is_packed(found):
    assert found["packed"] >= 40  # measured 45 (momentum alone by rk4) to 846 (rk8)
    assert found["widest"]
    assert found["scalar"] == 0
    assert found["calls"] == 0
    assert found["libm"] == []


def test_an_absent_effect_leaves_no_work(code):
    packed = {name: found["packed"] for name, found in code.items()}
    assert packed["rk4"] == packed["rk4 by hand"] < packed["rk4 gravity"]
    assert packed["rk4 gravity"] <= packed["rk4 gravity by hand"]
    assert packed["exact"] < packed["strang gravity damping"]


def test_code_that_cannot_be_packed_is_detected(code):
    assert code["rk4 gamma"]["packed"] == 0
    with pytest.raises(AssertionError):
        is_packed(code["rk4 gamma"])


def test_without_attitude_a_step_does_about_half_the_work(code):
    assert code["rk4 momentum"]["packed"] < 0.42 * code["rk4"]["packed"]  # measured 45 of 114
    assert code["exact momentum"]["packed"] < 0.56 * code["exact"]["packed"]  # measured 53 of 105


def test_a_step_costs_no_more_than_it_should(code):
    flops = {name: found["flops"] for name, found in code.items()}
    assert flops["rk4"] < 192  # measured 188
    assert flops["rk4 gravity"] < 300  # measured 293
    assert flops["rk4 momentum"] < 65  # measured 63
    assert flops["rkmk4 gravity damping"] < 695  # measured 654
    # a series in place of two roots and three divisions is more operations and less time: counted
    # in times of a product
    slots = {name: found["slots"] for name, found in code.items()}
    # measured 554: each side of the drift has its own times
    assert slots["strang gravity damping"] < 575
    # measured 450.5 with vectors of 512 bits, 472 with 256 (Zen 3)
    assert slots["strang gravity"] < (465 if vector_bits() == 512 else 487)
    # steps of a free body share almost everything: 429 by a whole drift each
    assert slots["exact"] < 121  # measured 115.5
    assert slots["exact momentum"] < 56  # measured 53; 165.5


def test_the_reader_finds_the_inner_loop_of_several_blocks():
    text = (
        "f:\n\tvmulpd\t%zmm0, %zmm1, %zmm2\n.outer:\n\tvsubpd\t%zmm0, %zmm1, %zmm2\n"
        ".latch:\n\tincq\t%rax\n\tvaddpd\t%zmm0, %zmm1, %zmm2\n\tje\t.latch\n"
        "\tvmulpd\t%zmm0, %zmm1, %zmm2\n\tjmp\t.latch\n\tjne\t.outer\n\tretq\n"
    )
    assert [line.split()[0] for line in loop_of(text)] == ["incq", "vaddpd", "je", "vmulpd", "jmp"]


def test_the_reader_detects_bad_code():
    bad = (
        "f:\n\tvmulpd\t%ymm0, %ymm1, %ymm2\n\tvaddsd\t%xmm0, %xmm1, %xmm2\n"
        "\tmovabsq\t$sin, %rax\n\tcallq\t*%rax\n"
    )
    found = [m and m.groups() for m in map(ARITHMETIC.match, blocks_of(bad)[1])]
    assert found == [("mul", "p", "d"), ("add", "s", "d"), None, None]
    assert LIBM.search(bad)
    assert STORE.match("vmovupd\t%zmm15, 1472(%rbp)")
    assert not STORE.match("vmovupd\t%zmm15, 160(%rsp)")

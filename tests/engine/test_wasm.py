"""Members in WebAssembly have the bits of the processor, with either fused multiply-add."""

import math
import random
import struct
from fractions import Fraction

import llvmlite.binding as llvm
import numpy as np
import pytest

import rigidmc as rm
from bench.bits import QUICK, sums
from rigidmc.engine.wasm import module, program
from rigidmc.engine.wasm.fused import EXACT, ONE, RELAXED, fused_in_range
from rigidmc.studies.bits import cases
from tests.engine.test_bits import changed
from tests.tools.same import assert_same

pytest.importorskip("wasmtime")

TINY, HUGE = 5e-324, 1.7976931348623157e308
ENDS = (0.0, 1.0, TINY, 2.0**-1022, HUGE, math.inf, math.nan, 2.0**-537, 1 + 2.0**-52, 2.0**27 + 1)


def triples(count):
    """Numbers of all sizes; sums that cancel, ends of the range, ties below the normal numbers."""
    chance = random.Random(1)

    def number():
        sign = chance.choice((-1.0, 1.0))
        few = 1.0 + chance.getrandbits(6) * 2.0 ** -chance.choice((5, 26, 52))
        any_bits = struct.unpack("<d", struct.pack("<Q", chance.getrandbits(64)))[0]
        tiny = chance.getrandbits(53) * 2.0 ** chance.randint(-1074, -900)
        scaled = few * 2.0 ** chance.randint(900, 1023), few * 2.0 ** chance.randint(-560, -480)
        some = chance.gauss(0.0, 1.0), any_bits, chance.choice(ENDS), tiny, *scaled
        return sign * chance.choice(some)

    for _ in range(count):
        x, y, z = number(), number(), number()
        near = -(x * y) * (1.0 + chance.choice((-1, 0, 1)) * 2.0**-52)
        yield x, y, chance.choice((z, near, near + chance.choice((-1, 1)) * TINY))


def rounded_once(x, y, z):
    """x y + z by fractions, with the rules of IEEE 754 for zeros, infinities and NaN."""
    if not all(map(math.isfinite, (x, y, z))):
        return z if math.isfinite(x) and math.isfinite(y) else x * y + z
    total = Fraction(x) * Fraction(y) + Fraction(z)
    if total == 0:
        return x * y + z if 0.0 in (x, y) else 0.0
    sign = 1.0 if total > 0 else -1.0
    try:
        return sign * float(abs(total))
    except OverflowError:
        return sign * math.inf


# Code that fuses n pairs of (x, y, z) from an address on, and puts x y + z behind them.
PAIRS = """
define void @members(ptr %a, i64 %n, i64 %unused) {
start:
  br label %loop
loop:
  %i = phi i64 [0, %start], [%next, %loop]
  %at = getelementptr [4 x <2 x double>], ptr %a, i64 %i
  %py = getelementptr <2 x double>, ptr %at, i64 1
  %pz = getelementptr <2 x double>, ptr %at, i64 2
  %po = getelementptr <2 x double>, ptr %at, i64 3
  %x = load <2 x double>, ptr %at
  %y = load <2 x double>, ptr %py
  %z = load <2 x double>, ptr %pz
  %r = call <2 x double> @llvm.fma.v2f64(<2 x double> %x, <2 x double> %y, <2 x double> %z)
  store <2 x double> %r, ptr %po
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, %n
  br i1 %more, label %loop, label %end
end:
  ret void
}
declare <2 x double> @llvm.fma.v2f64(<2 x double>, <2 x double>, <2 x double>)
"""


def computed(given, version):
    """(the module, x y + z of triples (n, 3) in it)."""
    code = module.wasm_of(llvm.parse_assembly(PAIRS), version)
    pairs = np.zeros((len(given) // 2, 4, 2))
    pairs[:, :3] = given.reshape(-1, 2, 3).transpose(0, 2, 1)
    at, room = program.STACK, -(-pairs.nbytes // program.PAGE) * program.PAGE
    made = program.Runtime(code, bytes(at) + pairs.tobytes() + bytes(room - pairs.nbytes))
    made.call("members", at, len(pairs), 0)
    return made, made.numbers(at, pairs.size).reshape(pairs.shape)[:, 3].ravel()


@pytest.mark.parametrize("version", [EXACT, RELAXED])
def test_the_fused_multiply_add_rounds_once(version):
    given = np.array(list(triples(20_000)))
    truth = np.array([rounded_once(*map(float, one)) for one in given])
    made, found = computed(given, version)
    same = (found.view(np.int64) == truth.view(np.int64)) | (np.isnan(found) & np.isnan(truth))
    assert same.all(), [[float(v).hex() for v in one] for one in given[~same][:3]]
    x = 1.0 + 2.0**-30  # what a page asks of its machine
    assert made.call(ONE, x, x, -(1.0 + 2.0**-29)) == 2.0**-60


def test_the_function_for_numbers_of_any_size_rounds_once():
    """By itself: the other function calls it seldom."""
    for x, y, z in triples(2_000):
        if x and y:
            with np.errstate(over="ignore"):  # of a word that is not chosen
                truth, found = rounded_once(x, y, z), fused_in_range(x, y, z)
            assert found == truth or (math.isnan(found) and math.isnan(truth)), (x, y, z)


def test_a_sum_rounded_twice_is_seen():
    given = np.array(list(triples(2_000)))
    with np.errstate(all="ignore"):
        twice = given[:, 0] * given[:, 1] + given[:, 2]
    truth = np.array([rounded_once(*map(float, one)) for one in given])
    assert ((twice != truth) & ~np.isnan(truth)).sum() > 100  # measured 586 of 2,000


SCENE = {"integrator": "rk8", "dt": 0.01, "t_end": 1.0, "every": 0.25, "members": 5}


def test_a_heavy_top_has_the_bits_of_the_processor():
    here, there = (rm.simulate("heavy_top", device=d, **SCENE) for d in ("cpu", "wasm"))
    assert_same(here, there)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
@pytest.mark.parametrize("version", [EXACT, RELAXED])
def test_the_recorded_bits(version, monkeypatch):
    """Events, statistics, noise, steps of members' own, works and shadows."""
    monkeypatch.setitem(program.WasmProgram.__init__.__kwdefaults__, "fused", version)
    names = [case.name for case in cases(QUICK) if "float32" not in case.name]
    assert not changed(sums((0,), QUICK, names=names, device="wasm"))


def test_single_precision_is_refused():
    code = PAIRS.replace("double", "float").replace("f64", "f32")
    with pytest.raises(rm.OptionError, match=r"compute in float64: set run\.dtype"):
        module.wasm_of(llvm.parse_assembly(code), RELAXED)


def test_functions_that_webassembly_lacks_are_refused():
    code = "declare double @sin(double)\ndefine void @members(ptr %a, i64 %n, i64 %m) {\n"
    code += "  %x = load double, ptr %a\n  %y = call double @sin(double %x)\n"
    code += "  store double %y, ptr %a\n  ret void\n}\n"
    with pytest.raises(rm.OptionError, match="calls sin, which WebAssembly does not have"):
        module.wasm_of(llvm.parse_assembly(code), RELAXED)

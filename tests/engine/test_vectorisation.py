"""The machine code of the kernel: packed arithmetic on the widest registers, no call, no work for what a scene has not."""

import inspect
import json
import math
import platform
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from rigidmc.effects import Gravity, ViscousDamping
from rigidmc.effects.parameters import parameter_count
from rigidmc.engine import kernel
from rigidmc.engine import layout as K
from rigidmc.engine.compose import FLAGS, as_single
from rigidmc.engine.machine import vector_bits
from rigidmc.integrators import INTEGRATORS, Turns, form, rk4
from rigidmc.integrators.rk4 import RK4

pytestmark = pytest.mark.skipif(platform.machine().lower() not in ("x86_64", "amd64"), reason="reads x86-64 assembly")


class Sine(NamedTuple):
    """An effect that calls the library, which no kernel should."""

    def torque(self, l):
        return math.sin(l[0]), 0.0, 0.0


def without_effects():
    """The step of RK4 as one writes it for free bodies alone: its source with every `push(..., x)` replaced by x."""
    source = textwrap.dedent(inspect.getsource(RK4.step))
    free, count = re.subn(r"push\(effects, body, [^,]+, [^,]+, [^,]+, [^,]+, (.*)\)$", r"\1", source, flags=re.M)
    assert count == 4
    space = dict(vars(rk4))
    exec(free, space)
    return space["step"]


class ByHand(NamedTuple):
    """RK4 of a free body and nothing else."""

    step = without_effects()


G, D, WITH, WITHOUT, OWN = Gravity(1.0), ViscousDamping(1.0), (0.0,), (), (np.empty(0, int),)


def case(name, effects=(), attitude=WITH, compensated=(), dtype=float, own=()):
    return form(INTEGRATORS[name], Turns(0.1, 0.1), bool(attitude), effects), effects, attitude, compensated, dtype, own


CASES = {
    "rk4": case("rk4"),
    "rk4 gravity": case("rk4", (G,)),
    "rk4 momentum": case("rk4", (), WITHOUT),
    "rk4 by hand": (form(ByHand()), (), WITH, (), float, ()),
    "rkmk4 gravity damping": case("rkmk4", (G, D)),
    "strang gravity damping": case("strang", (G, D)),
    "exact": case("exact"),
    "exact momentum": case("exact", (), WITHOUT),
    "strang gravity": case("strang", (G,)),
    "chin4 gravity": case("chin4", (G,)),
    "aba864 gravity": case("aba864", (G,)),
    "rotations gravity": case("rotations", (G,)),
    "fast symmetric": (form(INTEGRATORS["strang"], Turns(3.0, 3.0, True), True, (G,)), (G,), WITH, (), float, ()),
    "rk8 gravity": case("rk8", (G,)),
    "cf4 gravity": case("cf4", (G,)),
    "ck45 gravity": case("ck45", (G,)),
    "midpoint gravity": case("midpoint", (G,)),
    "rk8 gravity own steps": case("rk8", (G,), own=OWN),
    "strang gravity own steps": case("strang", (G,), own=OWN),
    "rk4 gravity compensated": case("rk4", (G,), WITH, (0.0,)),
    "strang gravity compensated": case("strang", (G,), WITH, (0.0,)),
    "rk4 gravity float32": case("rk4", (G,), WITH, (), np.float32),
    "rk8 gravity float32": case("rk8", (G,), WITH, (), np.float32),
    "strang gravity float32": case("strang", (G,), WITH, (), np.float32),
    "rkmk4 gravity damping float32": case("rkmk4", (G, D), WITH, (), np.float32),
}
BROKEN = {"rk4 sine": case("rk4", (Sine(),))}

ARITHMETIC = re.compile(r"v?(mul|add|sub|div|sqrt|fn?m(?:add|sub)\d+)([ps])([ds])\s")
STORE = re.compile(r"v?mov[au]p[ds]\s+%[xyz]mm\d+, -?\w*\((?!%rsp)")
LIBM = re.compile(r"\$_*(sin|cos|tan|exp|expm1|pow|log|sqrt|fmod|rint|round|floor|fabs|fma|hypot)\w*\b")


def blocks_of(assembly):
    """Lists of instructions between labels."""
    blocks = [[]]
    for line in assembly.splitlines():
        if re.match(r"[.\w$]+:", line):
            blocks.append([])
        elif line.startswith("\t") and not line.startswith("\t."):
            blocks[-1].append(line.strip())
    return blocks


def slots(loop):
    """Cycles that the vector instructions of a loop take in one pipe: moves none, a division 10 and a root 18 (Zen 4, 512 bits)."""
    words = [i.split()[0] for i in loop if re.search(r"%[xyz]mm|%k\d", i) and not i.startswith("vmov")]
    return sum(10 if "div" in w else 18 if "sqrt" in w else 1 for w in words)


def counted(name):
    """What the step loop of a freshly compiled kernel does; a kernel from the disk cache has no assembly to read."""
    made, effects, attitude, compensated, dtype, own = (CASES | BROKEN)[name]
    compiled = njit(nogil=True, **FLAGS)(kernel._advance)
    block = np.zeros((K.EFFECTS + parameter_count(*effects), 0))
    integrator = as_single(made.integrator) if dtype == np.float32 else made.integrator
    how = (integrator, made.parts, effects, (), attitude, compensated, np.empty(0, dtype), own, (), ())
    compiled(*how, block, np.empty(0), 0, 0, 0.01, 1, 0, 1, 1, 1)
    (assembly,) = compiled.inspect_asm().values()
    loop = max(blocks_of(assembly), key=lambda block: sum(bool(m) and m[2] == "p" for m in map(ARITHMETIC.match, block)))
    wanted = "s" if dtype == np.float32 else "d"
    operations = [(i, *m.groups()) for i in loop if (m := ARITHMETIC.match(i))]
    packed = [(i, kind) for i, kind, shape, real in operations if shape == "p" and real == wanted]
    rows = (7 if attitude else 3) * (2 if compensated else 1)  # what a step stores
    unrolled = sum(bool(STORE.match(i)) for i in loop) / rows
    return {
        "packed": len(packed) / unrolled,
        "flops": sum(2 if kind.startswith("f") else 1 for _, kind in packed) / unrolled,
        "parts": len(made.parts) - 1,
        "slots": slots(loop) / unrolled * (len(made.parts) - 1),
        "widest": all({512: "%zmm", 256: "%ymm", 128: "%xmm"}[vector_bits()] in i for i, _ in packed),
        "scalar": len(operations) - len(packed),
        "calls": sum("call" in i for i in loop),
        "libm": sorted({m[0] for m in LIBM.finditer(assembly)}),
    }


def report(names):
    print(json.dumps({name: counted(name) for name in names}))


@pytest.fixture(scope="module")
def code():
    """Counts for all cases, compiled in two fresh processes."""
    names, root = [*CASES, *BROKEN], Path(__file__).parents[2]
    script = "import sys; from tests.engine.test_vectorisation import report; report(sys.argv[1:])"
    runs = [
        subprocess.Popen([sys.executable, "-c", script, *part], cwd=root, stdout=subprocess.PIPE)
        for part in (names[::2], names[1::2])
    ]
    outputs = [run.communicate()[0] for run in runs]
    assert not any(run.returncode for run in runs)
    return {name: counts for output in outputs for name, counts in json.loads(output).items()}


@pytest.mark.parametrize("name", CASES)
def test_the_step_is_packed_arithmetic_on_the_widest_registers(code, name):
    found = code[name]
    assert found["packed"] >= 40  # measured 48 (momentum alone by rk4) to 420 (rkmk4 with all effects)
    assert found["widest"]
    assert found["scalar"] == 0
    assert found["calls"] == 0
    assert found["libm"] == []


def test_an_absent_effect_leaves_no_work(code):
    packed = {name: found["packed"] for name, found in code.items()}
    assert packed["rk4"] == packed["rk4 by hand"] < packed["rk4 gravity"]
    assert packed["exact"] < packed["strang gravity damping"]


def test_a_library_call_is_caught(code):
    assert code["rk4 sine"]["libm"] == ["$sin"]
    assert code["rk4 sine"]["calls"] > 0  # measured 32


def test_without_attitude_most_work_is_gone(code):
    assert code["rk4 momentum"]["packed"] < 0.4 * code["rk4"]["packed"]  # measured 48 of 140
    assert code["exact momentum"]["packed"] < 0.45 * code["exact"]["packed"]  # measured 110 of 279


def test_a_step_costs_no_more_than_it_should(code):
    flops = {name: found["flops"] for name, found in code.items()}
    assert flops["rk4"] < 225  # measured 215
    assert flops["rk4 gravity"] < 355  # measured 338
    assert flops["rk4 momentum"] < 70  # measured 66
    assert flops["rkmk4 gravity damping"] < 695  # measured 662
    assert flops["strang gravity damping"] < 545  # measured 520: each side of the drift has its own times
    assert flops["exact"] < 400  # measured 378
    assert flops["exact momentum"] < 145  # measured 136


def test_the_reader_sees_what_it_looks_for():
    bad = "f:\n\tvmulpd\t%ymm0, %ymm1, %ymm2\n\tvaddsd\t%xmm0, %xmm1, %xmm2\n\tmovabsq\t$sin, %rax\n\tcallq\t*%rax\n"
    assert [m and m.groups() for m in map(ARITHMETIC.match, blocks_of(bad)[1])] == [
        ("mul", "p", "d"),
        ("add", "s", "d"),
        None,
        None,
    ]
    assert LIBM.search(bad)
    assert STORE.match("vmovupd\t%zmm15, 1472(%rbp)")
    assert not STORE.match("vmovupd\t%zmm15, 160(%rsp)")

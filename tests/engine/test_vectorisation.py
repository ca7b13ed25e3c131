"""The machine code of the kernel: packed arithmetic on the widest registers, no call, no work for what a scene has not."""

import json
import math
import platform
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from rigidmc.dynamics.euler import increments, scaled
from rigidmc.dynamics.so3 import add, add4, axpy, axpy4, renormalise
from rigidmc.effects import Gravity, ViscousDamping
from rigidmc.engine import kernel as K
from rigidmc.engine.compose import FLAGS
from rigidmc.engine.machine import vector_bits
from rigidmc.integrators import RK4, RKMK4, Exact, Strang

pytestmark = pytest.mark.skipif(platform.machine().lower() not in ("x86_64", "amd64"), reason="reads x86-64 assembly")


class Nothing(NamedTuple):
    """An effect that does nothing."""


class Sine(NamedTuple):
    """An effect that calls the library, which no kernel should."""

    def torque(self, l):
        return math.sin(l[0]), 0.0, 0.0


class HandWritten(NamedTuple):
    """RK4 of a free body as one writes it for that alone."""

    def step(self, body, h, q, l):
        half = scaled(body, 0.5 * h)
        dq1, dl1 = increments(half, q, l)
        dq2, dl2 = increments(half, add4(q, dq1), add(l, dl1))
        dq3, dl3 = increments(half, add4(q, dq2), add(l, dl2))
        dq4, dl4 = increments(half, add4(q, add4(dq3, dq3)), add(l, add(dl3, dl3)))
        q = axpy4(q, 1.0 / 3.0, axpy4(add4(dq1, dq4), 2.0, add4(dq2, dq3)))
        return renormalise(q), axpy(l, 1.0 / 3.0, axpy(add(dl1, dl4), 2.0, add(dl2, dl3)))


G, D, WITH, WITHOUT = Gravity(1.0), ViscousDamping(1.0), (0.0,), ()
CASES = {
    "rk4": (RK4(), (), WITH),
    "rk4 gravity": (RK4(), (G,), WITH),
    "rk4 gravity damping": (RK4(), (G, D), WITH),
    "rk4 momentum": (RK4(), (), WITHOUT),
    "rk4 nothing": (RK4(), (Nothing(),), WITH),
    "rk4 by hand": (HandWritten(), (), WITH),
    "rkmk4": (RKMK4(), (), WITH),
    "rkmk4 gravity": (RKMK4(), (G,), WITH),
    "strang": (Strang(), (), WITH),
    "strang gravity": (Strang(), (G,), WITH),
    "strang gravity damping": (Strang(), (G, D), WITH),
    "exact": (Exact(), (), WITH),
    "exact momentum": (Exact(), (), WITHOUT),
}

BROKEN = {"rk4 sine": (RK4(), (Sine(),), WITH)}

ARITHMETIC = re.compile(r"v?(mul|add|sub|div|sqrt|fn?m(?:add|sub)\d+)([ps])d\s")
STORE = re.compile(r"v?mov[au]pd\s+%[xyz]mm\d+, -?\w*\((?!%rsp)")
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


def counted(name):
    """What the step loop of a freshly compiled kernel does; a kernel from the disk cache has no assembly to read."""
    integrator, effects, attitude = (CASES | BROKEN)[name]
    kernel = njit(nogil=True, **FLAGS)(K._advance)
    block = np.zeros((K.EFFECTS + sum(map(len, effects)), 0))
    kernel(integrator, effects, (), attitude, block, np.empty(0), 0, 0, 0.01, 0, 1, 1, 1)
    (assembly,) = kernel.inspect_asm().values()
    found = [[ARITHMETIC.match(i) for i in block] for block in blocks_of(assembly)]
    loop = max(zip(blocks_of(assembly), found, strict=True), key=lambda pair: sum(m is not None and m[2] == "p" for m in pair[1]))[0]
    operations = [(i, *m.groups()) for i in loop if (m := ARITHMETIC.match(i))]
    packed = [(i, kind) for i, kind, form in operations if form == "p"]
    unrolled = sum(bool(STORE.match(i)) for i in loop) / (7 if attitude else 3)  # a step stores 7 or 3 rows
    return {
        "packed": len(packed) / unrolled,
        "flops": sum(2 if kind.startswith("f") else 1 for _, kind in packed) / unrolled,
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
    runs = [subprocess.Popen([sys.executable, "-c", script, *part], cwd=root, stdout=subprocess.PIPE) for part in (names[::2], names[1::2])]
    outputs = [run.communicate()[0] for run in runs]
    assert not any(run.returncode for run in runs)
    return {name: counts for output in outputs for name, counts in json.loads(output).items()}


@pytest.mark.parametrize("name", CASES)
def test_the_step_is_packed_arithmetic_on_the_widest_registers(code, name):
    found = code[name]
    assert found["packed"] >= 40  # measured 42 (momentum alone) to 408 (rkmk4 with gravity) with fused multiply-add
    assert found["widest"]
    assert found["scalar"] == 0
    assert found["calls"] == 0
    assert found["libm"] == []


def test_an_absent_effect_leaves_no_work(code):
    packed = {name: found["packed"] for name, found in code.items()}
    assert packed["rk4"] == packed["rk4 nothing"] == packed["rk4 by hand"]
    assert packed["rk4"] < packed["rk4 gravity"] < packed["rk4 gravity damping"]
    assert packed["rkmk4"] < packed["rkmk4 gravity"]
    assert packed["exact"] == packed["strang"] < packed["strang gravity"] < packed["strang gravity damping"]


def test_a_library_call_is_caught(code):
    assert code["rk4 sine"]["libm"] == ["$sin"]
    assert code["rk4 sine"]["calls"] > 0  # measured 32


def test_without_attitude_most_work_is_gone(code):
    assert code["rk4 momentum"]["packed"] < 0.35 * code["rk4"]["packed"]  # measured 42 of 143
    assert code["exact momentum"]["packed"] < 0.45 * code["exact"]["packed"]  # measured 110 of 279


def test_a_step_costs_no_more_than_it_should(code):
    flops = {name: found["flops"] for name, found in code.items()}
    assert flops["rk4"] < 230  # measured 216
    assert flops["rk4 gravity"] < 345  # measured 327
    assert flops["rk4 momentum"] < 65  # measured 60
    assert flops["rkmk4 gravity"] < 670  # measured 638
    assert flops["strang gravity"] < 465  # measured 441
    assert flops["exact"] < 400  # measured 378
    assert flops["exact momentum"] < 145  # measured 136


def test_the_reader_sees_what_it_looks_for():
    bad = "f:\n\tvmulpd\t%ymm0, %ymm1, %ymm2\n\tvaddsd\t%xmm0, %xmm1, %xmm2\n\tmovabsq\t$sin, %rax\n\tcallq\t*%rax\n"
    assert [m and m.groups() for m in map(ARITHMETIC.match, blocks_of(bad)[1])] == [("mul", "p"), ("add", "s"), None, None]
    assert LIBM.search(bad)
    assert STORE.match("vmovupd\t%zmm15, 1472(%rbp)")
    assert not STORE.match("vmovupd\t%zmm15, 160(%rsp)")

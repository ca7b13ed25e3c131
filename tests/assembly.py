"""The machine code of kernels, read: what the loop over lanes does."""

import re
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from rigidmc.effects.parameters import blank, parameter_count
from rigidmc.engine import kernel
from rigidmc.engine import layout as K
from rigidmc.engine.compose import FLAGS, as_single
from rigidmc.engine.flops import DIVISION, ROOT
from rigidmc.engine.machine import vector_bits
from rigidmc.engine.watch import watch_rows
from rigidmc.integrators import INTEGRATORS, Turns, form

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
    return sum(DIVISION if "div" in w else ROOT if "sqrt" in w else 1 for w in words)


class Case(NamedTuple):
    """What a kernel is compiled for."""

    made: Any  # Form
    effects: tuple = ()
    attitude: tuple = (0.0,)
    compensated: tuple = ()
    dtype: Any = float
    own: tuple = ()
    ledger: tuple = ()
    events: tuple = ()
    running: tuple = ()
    shadow: tuple = ()


def case(name, effects=(), attitude=(0.0,), compensated=(), dtype=float, own=(), ledger=(), events=(), running=(), shadow=()):
    """The Case of an integrator by name."""
    made = form(INTEGRATORS[name], Turns(0.1, 0.1), effects)
    return Case(made, blank(effects), attitude, compensated, dtype, own, ledger, events, running, shadow)


def assembly_of(case):
    """The assembly of a freshly compiled kernel; one from the disk cache has none to read."""
    made, effects, attitude, compensated, dtype, own, ledger, *watch = case
    compiled = njit(nogil=True, **FLAGS)(kernel._advance)
    block = np.zeros((K.EFFECTS + parameter_count(*effects) + 2 * len(ledger) + watch_rows(*watch), 0))
    integrator = as_single(made.integrator) if dtype == np.float32 else made.integrator
    how = (integrator, made.parts, effects, (), attitude, compensated, np.empty(0, dtype), own, (), (), ledger, *watch)
    compiled(*how, block, np.empty(0), 0, 0, 0.01, 1, 0, 1, 1, 1)
    (assembly,) = compiled.inspect_asm().values()
    return assembly


def counted(case):
    """What the step loop of a kernel does."""
    made, attitude, compensated, dtype, assembly = case.made, case.attitude, case.compensated, case.dtype, assembly_of(case)
    loop = max(blocks_of(assembly), key=lambda block: sum(bool(m) and m[2] == "p" for m in map(ARITHMETIC.match, block)))
    wanted = "s" if dtype == np.float32 else "d"
    operations = [(i, *m.groups()) for i in loop if (m := ARITHMETIC.match(i))]
    packed = [(i, kind) for i, kind, shape, real in operations if shape == "p" and real == wanted]
    rows = (7 if attitude else 3) * (2 if compensated else 1) + len(case.ledger)  # what a step stores
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

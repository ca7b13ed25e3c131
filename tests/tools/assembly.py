"""Reads the machine code of steps: what the loop over them contains."""

import re
from typing import Any, NamedTuple

from rigidmc.engine.compiler.kernels import KernelKey, signature_of
from rigidmc.engine.compiler.libraries import in_written_order
from rigidmc.engine.compiler.machine_code import lower
from rigidmc.engine.inspection import DIVISION, ROOT, why_scalar
from rigidmc.engine.kernel.arguments import letters_of
from rigidmc.engine.kernel.march import march
from rigidmc.engine.machine import vector_bits
from rigidmc.engine.program import lanes_for
from rigidmc.physics.dynamics.methods import OFF, ON, flag, static_count
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, scheme_of
from rigidmc.physics.integrators.protocol import interleaving

ARITHMETIC = re.compile(r"v?(mul|add|sub|div|sqrt|fn?m(?:add|sub)\d+)([ps])([ds])\s")
STORE = re.compile(r"v?mov[au]p[ds]\s+%[xyz]mm\d+, -?\w*\((?!%rsp)")
LIBM = re.compile(
    r"\$_*(sin|cos|tan|exp|expm1|pow|log|sqrt|fmod|rint|round|floor|fabs|fma|hypot|gamma|tgamma)"
    r"\w*\b"
)


def blocks_of(assembly):
    """Lists of the instructions between labels."""
    blocks = [[]]
    for line in assembly.splitlines():
        if re.match(r"[.\w$]+:", line):
            blocks.append([])
        elif line.startswith("\t") and not line.startswith("\t."):
            blocks[-1].append(line.strip())
    return blocks


BRANCH = re.compile(r"\tj\w+\s+(\S+)$")


def is_packed(line):
    """Whether a line is packed arithmetic."""
    found = ARITHMETIC.match(line)
    return bool(found) and found[2] == "p"


def loop_of(assembly, branch=BRANCH, counts=is_packed):
    """The loop with most lines that count, of those without another in them.

    A loop goes from a label to the last jump back to it.
    """
    lines = [line for line in assembly.splitlines() if not line.startswith("\t.")]
    labels = {line.split(":")[0]: i for i, line in enumerate(lines) if re.match(r"[.\w$]+:", line)}
    ends = {}
    for i, line in enumerate(lines):
        jump = branch.match(line)
        if jump and labels.get(jump[1], i) < i:
            ends[labels[jump[1]]] = i
    loops = [
        [line.strip() for line in lines[begin : end + 1] if line.startswith("\t")]
        for begin, end in ends.items()
        if not any(begin < other < end for other in ends)
    ]
    return max(loops, key=lambda loop: sum(map(bool, map(counts, loop))))


def slots(loop):
    """Cycles that the vector instructions of a loop take in one pipe.

    Moves take none, a division 10, a square root 18 (Zen 4, 512 bits).
    """
    words = [
        i.split()[0] for i in loop if re.search(r"%[xyz]mm|%k\d", i) and not i.startswith("vmov")
    ]
    return sum(DIVISION if "div" in w else ROOT if "sqrt" in w else 1 for w in words)


class Case(NamedTuple):
    """What steps are compiled for."""

    made: Any  # Form
    effects: tuple = ()
    attitude: tuple = ON
    compensated: tuple = OFF
    dtype: Any = "float64"
    works: tuple = ()


def case(name, effects=(), attitude=ON, compensated=OFF, dtype="float64", works=()):
    """The Case of an integrator, by name."""
    return Case(
        scheme_of(INTEGRATORS[name], TurnBounds(0.1, 0.1), effects),
        blank(effects),
        attitude,
        compensated,
        dtype,
        works,
    )


def library_of(key):
    """The LLVM code of a piece and of what it calls, freshly compiled."""
    signature = signature_of(key)
    return lower(key.function, signature.args, signature.return_type).library


def assembly_of_key(key):
    """The assembly of a piece, freshly compiled."""
    with in_written_order():
        return library_of(key).get_asm_str()


def assembly_of(case, lanes):
    """The assembly of steps, freshly compiled."""
    groups = static_count(min(lanes, interleaving(case.made.integrator)))
    several = flag(len(case.made.substeps) > 2)
    made, effects, works = case.made.integrator, case.effects, case.works
    parts = made, effects, case.attitude, case.compensated, works, groups, several, OFF
    return assembly_of_key(KernelKey(march, parts, case.dtype, lanes, letters_of(march)))


def counted(case):
    """What the loop over steps contains."""
    lanes = 1 if case.effects and any(map(why_scalar, case.effects)) else lanes_for(case.dtype)
    assembly = assembly_of(case, lanes)
    loop = loop_of(assembly)
    wanted = "s" if case.dtype == "float32" else "d"
    operations = [(i, *m.groups()) for i in loop if (m := ARITHMETIC.match(i))]
    packed = [(i, kind) for i, kind, shape, real in operations if shape == "p" and real == wanted]
    # registers that one number of many members takes
    vectors = max(1, lanes * (32 if wanted == "s" else 64) // vector_bits())
    return {
        "packed": len(packed) / vectors,
        "flops": sum(2 if kind.startswith("f") else 1 for _, kind in packed) / vectors,
        "parts": len(case.made.substeps) - 1,
        "slots": slots(loop) / vectors * (len(case.made.substeps) - 1),
        "spills": sum("(%rsp)" in i and i.startswith("vmov") for i in loop) / vectors,
        "widest": all(
            {512: "%zmm", 256: "%ymm", 128: "%xmm"}[vector_bits()] in i for i, _ in packed
        )
        or lanes * 64 < vector_bits(),
        "scalar": len(operations) - len(packed),
        "calls": sum("call" in i for i in loop),
        "libm": sorted({m[0] for m in LIBM.finditer(assembly)}),
    }

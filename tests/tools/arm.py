"""The machine code of steps for ARM, on any computer: `python -m tests.tools.arm` counts it."""

import json
import os
import re
import sys

TRIPLE, CPU = "aarch64-unknown-linux-gnu", "neoverse-n1"
ARITHMETIC = re.compile(r"f(mla|mls|mul|add|sub|div|sqrt|neg|abs)\s+(v\d+\.2d)?")
STACK = re.compile(r"(ld|st)[rp]\s+[qd]\d+.*\[sp")
BRANCH = re.compile(r"\t(?:b(?:\.\w+)?|cbn?z|tbn?z)\s+(?:.*, ?)?(\.?\w+)$")
CASES = ("exact", ()), ("strang", (9.81,)), ("rk4", ()), ("rk4", (9.81,)), ("rk8", (9.81,))


def use_arm():
    """Make Numba compile for ARM; before it is imported. Nothing of that code can run."""
    os.environ.update(NUMBA_CPU_NAME=CPU, NUMBA_CPU_FEATURES="")
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    llvm.get_process_triple = llvm.targets.get_process_triple = lambda: TRIPLE

    from rigidmc.engine import machine

    machine.platform.machine = lambda: "aarch64"


def counted():
    """{integrator, with gravity or not: {members side by side: what a member and step takes}}."""
    from rigidmc.physics.effects import Gravity
    from tests.tools.assembly import assembly_of, case, loop_of

    found = {}
    for name, weight in CASES:
        made = case(name, tuple(map(Gravity, weight)))
        for lanes in (2, 4, 8):
            loop = loop_of(assembly_of(made, lanes), BRANCH, ARITHMETIC.match)
            packed = [line for line in loop if (m := ARITHMETIC.match(line)) and m[2]]
            found.setdefault(f"{name}, {'heavy' if weight else 'free'}", {})[lanes] = {
                "instructions": len(loop) / lanes,
                "packed": len(packed) / lanes,
                "stack": sum(bool(STACK.match(line)) for line in loop) / lanes,
                "calls": sum(line.startswith("bl") for line in loop),
            }
    return found


if __name__ == "__main__":
    use_arm()
    json.dump(counted(), sys.stdout, indent=1)

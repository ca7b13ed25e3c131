"""The disk cache of a user's own parts: whatever changes their physics changes their stamp, what no
stamp tells is compiled in every process, and code from the disk is never taken for other code.

`RUN` is a process that loads own files, one variant after the other, and tells of each the torque,
whether it agrees with the same method in plain Python, and how many functions Numba compiled.
"""

import json
import os
import subprocess
import sys

import pytest

from rigidmc.engine.pieces import config

pytestmark = [
    pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled"),
    pytest.mark.skipif(not hasattr(os, "getuid"), reason="folder permissions are those of POSIX"),
]

MINE = """
import math
from typing import NamedTuple

import numba
import numpy as np

import helper
from helper import bent
from rigidmc.protocols import cross, into_body, scale

RATE, SIZES, TURNED, SHARE = 1.5, (0.25, (2.0, 4.0)), False, np.float64(0.125)
QUICK = 0.5


class Numbers(NamedTuple):
    one: float
    two: float = 3.0


KNOWN = Numbers(0.75)


def made(factor):
    def grown(x, by=0.5):
        return factor * x + by

    return grown


grown = made(2.0)


@numba.njit
def quick(x):
    return 1.25 * x + QUICK


def turned(x):
    if TURNED:
        return -x
    return x


def both(x):
    return Numbers(x, x).two * KNOWN.two


class Push(NamedTuple):
    size: float
    other: float

    def torque(self, q):
        x = self.size + 0.25 * self.other
        y = grown(x) + RATE * x + SIZES[1][0] + SHARE * KNOWN.one + quick(RATE)
        z = bent(y) + helper.SHIFT + turned(x) + both(x) + math.sin(x)
        by = lambda: 0.5 * z
        return scale(by(), cross((1.0, 2.0, 3.0), into_body(q, (1.0, 0.0, 0.0))))
"""
HELPER = """
from third import deep

SHIFT = 0.375


def bent(x):
    return deep(x) - 0.5 * x


def straight(x):
    return deep(x) - 0.75 * x
"""
THIRD = "def deep(x):\n    return 1.5 * x\n"
FILES = {"mine.py": MINE, "helper.py": HELPER, "third.py": THIRD}
EDITS = {  # what changes: (file, before, after)
    "a number in the source": ("mine.py", "0.25 * self.other", "0.26 * self.other"),
    "an operator": ("mine.py", "self.size + 0.25", "self.size - 0.25"),
    "a name that is called": ("mine.py", "math.sin", "math.cos"),
    "a number in a nested function": ("mine.py", "0.5 * z", "0.6 * z"),
    "a constant in a closure": ("mine.py", "made(2.0)", "made(2.5)"),
    "a global number": ("mine.py", "= 1.5,", "= 1.75,"),
    "a number in a tuple in a global": ("mine.py", "(2.0, 4.0)", "(2.5, 4.0)"),
    "a number of NumPy": ("mine.py", "np.float64(0.125)", "np.float64(0.25)"),
    "a condition": ("mine.py", "False,", "True,"),
    "a field of a constant": ("mine.py", "Numbers(0.75)", "Numbers(1.25)"),
    "the default of a field": ("mine.py", "two: float = 3.0", "two: float = 3.5"),
    "the order of fields": (
        "mine.py", "    size: float\n    other: float", "    other: float\n    size: float"
    ),
    "a default": ("mine.py", "by=0.5", "by=0.75"),
    "a number in a function of njit": ("mine.py", "1.25 * x", "1.5 * x"),
    "a global of a function of njit": ("mine.py", "QUICK = 0.5", "QUICK = 0.75"),
    "which function a name stands for": ("mine.py", "import bent", "import straight as bent"),
    "a helper in another file": ("helper.py", "- 0.5 * x", "- 0.625 * x"),
    "a number of another file": ("helper.py", "= 0.375", "= 0.5"),
    "a helper of a helper in a third file": ("third.py", "1.5 * x", "1.75 * x"),
}  # fmt: skip

RUN = """
import json, sys
import numpy as np
from numba.core import compiler

count, plain = [0], compiler.CompilerBase.__init__

def counted(self, *arguments):
    count[0] += 1
    plain(self, *arguments)

compiler.CompilerBase.__init__ = counted
from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects.sums import total_torque
from rigidmc.engine import own_stamps, pieces
from rigidmc.engine.forces import evaluated
from rigidmc.files.code import class_of

state, lines = ((0.5, 0.5, 0.1, 0.7), (1.0, 2.0, 3.0)), []
body = MassProperties(*[1.0] * 9)
for folder in sys.argv[1:]:
    kind, before = class_of(folder, "mine.py", "Push", "effects"), count[0]
    found = evaluated((kind(0.3, 0.7),), body, *state)[:3]
    lines.append([kind, found, count[0] - before])
for kind, found, compiled in lines:  # at the end: Python, too, lets Numba compile `quick`
    why = own_stamps.why_unkept(kind)
    wanted = total_torque((kind(0.3, 0.7),), body, 0.0, *state)
    right = bool(np.allclose(found, wanted, rtol=1e-12, atol=0.0))
    print(json.dumps([found[0].hex(), right, compiled, why]))
for (function, types), address in pieces._by_types.items():
    code = pieces._dispatchers[function].overloads[types]
    assert code.library.get_pointer_to_function(code.fndesc.llvm_func_name) == address
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("own")


def written(place, name, **changes):
    """The folder of a variant of the files."""
    folder = place / name.replace(" ", "_")
    folder.mkdir(exist_ok=True)
    for file, text in {**FILES, **changes}.items():
        (folder / file).write_text(text)
    return str(folder)


def edited(place, name):
    file, old, new = EDITS[name]
    assert FILES[file].count(old) == 1
    return written(place, name, **{file: FILES[file].replace(old, new)})


def ran(cache, *folders):
    """(bits of the torque, whether it is right, functions compiled, why it is not kept) of each."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")}
    done = subprocess.run(
        [sys.executable, "-c", RUN, *folders],
        env={**environment, "RIGIDMC_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_what_changes_the_physics_changes_the_code_in_the_next_process(place):
    """Without the hash in the names of functions "plain", from the disk, and the first edit have
    the same name in the second process, and the code of one is found by the name of the other."""
    folders = [written(place, "plain"), *(edited(place, name) for name in EDITS)]
    ((bits, right, compiled, why),) = ran(place / "cache", folders[0])
    assert (right, why) == (True, "") and compiled > 10

    first, *others = ran(place / "cache", *folders)
    assert first == [bits, True, 0, ""]
    for name, (other, right, compiled, why) in zip(EDITS, others, strict=True):
        assert (right, why) == (True, "") and compiled > 0 and other != bits, name

    again = ran(place / "cache", *reversed(folders))
    assert again == [[other, True, 0, ""] for other, *_ in [*reversed(others), first]]

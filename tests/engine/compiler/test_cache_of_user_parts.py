"""The disk cache of a user's own parts: whatever changes their physics changes their stamp, what no
stamp tells is compiled in every process, and code from the disk is never taken for other code.

`RUN` is a process that loads own files, one variant after the other, and tells of each the torque,
whether it agrees with the same method in plain Python, and how many functions Numba compiled.
"""

import hashlib
import itertools
import json
import os

import numba
import numpy as np
import pytest

from rigidmc.engine.compiler import disk_cache, frozen, kernels, lowering, machine_code
from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.formulas import evaluate_forces
from rigidmc.files.user_code import class_of
from rigidmc.physics.dynamics.euler import MassProperties
from tests.tools.commands import python

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
from rigidmc.engine.compiler import lowering

count, plain = [0], lowering._infer

def counted(*arguments):
    count[0] += 1
    return plain(*arguments)

lowering._infer = counted
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects.sums import total_torque
from rigidmc.engine.compiler import frozen, machine_code
from rigidmc.engine.formulas import evaluate_forces
from rigidmc.files.user_code import class_of

state, lines = ((0.5, 0.5, 0.1, 0.7), (1.0, 2.0, 3.0)), []
body = MassProperties(*[1.0] * 9)
for folder in sys.argv[1:]:
    kind, before = class_of(folder, "mine.py", "Push", "effects"), count[0]
    found = evaluate_forces((kind(0.3, 0.7),), body, *state)[:3]
    lines.append([kind, found, count[0] - before])
for kind, found, compiled in lines:  # at the end: Python, too, lets Numba compile `quick`
    why = frozen.why_not_cached(kind)
    wanted = total_torque((kind(0.3, 0.7),), body, 0.0, *state)
    right = bool(np.allclose(found, wanted, rtol=1e-12, atol=0.0))
    print(json.dumps([found[0].hex(), right, compiled, why]))
engine = machine_code._codegen()._engine._ee
for name, address in machine_code._addresses.items():
    assert engine.get_function_address(f"kernel_{name[:32]}") == address
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
    return [json.loads(line) for line in python(RUN, *folders, cache=cache)[0].splitlines()]


def test_what_changes_the_physics_changes_the_stamp(place):
    folders = [written(place, "unedited"), *(edited(place, name) for name in EDITS)]
    stamps = [frozen.stamp_of(class_of(each, "mine.py", "Push", "effects")) for each in folders]
    assert None not in stamps and len(set(stamps)) == 1 + len(EDITS)


COMPILED = (  # one of each way to the code; each takes .3 s to compile
    "a number in the source", "a constant in a closure", "a global of a function of njit",
    "which function a name stands for", "a helper of a helper in a third file",
)  # fmt: skip


@pytest.mark.parametrize("names", [COMPILED, pytest.param((*EDITS,), marks=pytest.mark.slow)])
def test_what_changes_the_physics_changes_the_code_in_the_next_process(tmp_path, names):
    """Without the hash in the names of functions "plain", from the disk, and the first edit have
    the same name in the second process, and the code of one is found by the name of the other."""
    folders = [written(tmp_path, "plain"), *(edited(tmp_path, name) for name in names)]
    ((bits, right, compiled, why),) = ran(tmp_path / "cache", folders[0])
    assert (right, why) == (True, "") and compiled > 10

    first, *others = ran(tmp_path / "cache", *folders)
    assert first == [bits, True, 0, ""]
    for name, (other, right, compiled, why) in zip(names, others, strict=True):
        assert (right, why) == (True, "") and compiled > 0 and other != bits, name

    again = ran(tmp_path / "cache", *reversed(folders))
    assert again == [[other, True, 0, ""] for other, *_ in [*reversed(others), first]]


BARE = """
from typing import NamedTuple
import ctypes, functools, math
import numba
from numba.extending import overload

BEFORE

class Push(NamedTuple):
    size: float
    other: float

    def torque(self, l):
        return TERM * self.size, self.other * l[0], 0.0
"""
UNKNOWN = {  # why it is not kept: (before the class, in it)
    "Push.torque reads cosine, a _FuncPtr": (
        "cosine = ctypes.CDLL(None).cos\ncosine.argtypes = [ctypes.c_double]\n"
        "cosine.restype = ctypes.c_double",
        "cosine(0.5)",
    ),
    "whole reads place, a dict": (
        "def whole(x):\n    return x\n@functools.wraps(whole)\ndef half(x):\n    return 0.5 * x\n"
        "half.place = {}",
        "half(3.0)",
    ),
    "half has no source": ("exec('def half(x):\\n    return 0.5 * x')", "half(3.0)"),
    "half has njit options that prevent caching": (
        "@numba.njit(cache=True)\ndef half(x):\n    return 0.5 * x",
        "half(3.0)",
    ),
    "third has njit options that prevent caching": (
        "@numba.njit('f4(f4)')\ndef third(x):\n    return 0.25 * x",
        "third(3.0)",
    ),
    # its code calls itself by a name that Numba counted in the first process
    "": ("@numba.njit\ndef f(n):\n    return 1.0 if n < 1 else n * f(n - 1)", "f(9)"),
}


def bare(place, name, before, term):
    text = BARE.replace("BEFORE", before).replace("TERM", term)
    return written(place, name, **{"mine.py": text})


def test_what_no_stamp_tells_has_none(place):
    for reason, code in UNKNOWN.items():
        kind = class_of(bare(place, f"unknown {reason}", *code), "mine.py", "Push", "effects")
        assert frozen.why_not_cached(kind) == reason
        assert (frozen.stamp_of(kind) is None) == bool(reason)


# of the C library, of Numba, and what has a stamp and is not kept all the same
SOME = (*(*UNKNOWN,)[:4:3], "")


@pytest.mark.parametrize("reasons", [SOME, pytest.param((*UNKNOWN,), marks=pytest.mark.slow)])
@pytest.mark.slow
def test_what_no_stamp_tells_is_compiled_in_every_process(tmp_path, reasons):
    folders = [bare(tmp_path, f"bare {i}", *UNKNOWN[each]) for i, each in enumerate(reasons)]
    for _ in range(2):
        found = ran(tmp_path / "bare", *folders)
        for reason, (_, right, compiled, why) in zip(reasons, found, strict=True):
            assert (why, right) == (reason, True) and compiled > 0, reason
    assert not list((tmp_path / "bare").rglob("*.o"))


TEACHING = (
    "def half(x):\n    return NUMBER * x\n"
    "@overload(half)\ndef _(x):\n    return lambda x: NUMBER * x"
)


WHY = """
import sys
from rigidmc.engine.compiler import frozen
from rigidmc.files.user_code import class_of
kind = class_of(sys.argv[1], "mine.py", "Push", "effects")
print(frozen.stamp_of(kind), frozen.why_not_cached(kind))
"""


def test_who_teaches_numba_has_no_stamp(place):
    """No function of the class names what the overload computes. From then on no class of the
    process has a stamp: nothing is compiled, but in a process."""
    folder = bare(place, "teaches", TEACHING.replace("NUMBER", "0.75"), "half(3.0)")
    told, _ = python(WHY, folder)
    assert told.startswith("None ") and "extends Numba" in told


@pytest.mark.slow  # 6 s: two processes, each of which compiles
def test_who_teaches_numba_is_compiled_in_every_process(place):
    folders = [
        bare(place, f"teaches {number}", TEACHING.replace("NUMBER", number), "half(3.0)")
        for number in ("0.5", "0.25")
    ]
    one, other = (ran(place / "taught", folder)[0] for folder in folders)
    assert one[0] != other[0] and one[1] and other[1] and one[2] > 0 and other[2] > 0
    assert "extends Numba" in one[3] and not list((place / "taught").rglob("*.o"))


NUMBERS = itertools.count()


def loaded(place, name, before):
    """The class of a variant of BARE, from its file."""
    name = f"{name} {next(NUMBERS)}"  # a file is read once
    return class_of(bare(place, name, before, "half(3.0)"), "mine.py", "Push", "effects")


def stamp(place, name, before):
    return frozen.stamp_of(loaded(place, name, before))


HALF = "def half(x, by=2.0, *, more=0.0):\n    return NUMBER * x\nNUMBER = "


def test_a_stamp_tells_numbers_by_their_bits_and_nothing_else(place):
    numbers = "0.0", "-0.0", "0", "False", "None", "'0'", "1", "1.0", "True", "(1.0,)", "(1,)"
    more = "math.nan", "-math.nan", "math.pi", "3.14159265358979", "math.sin", "math.cos", "abs"
    stamps = {stamp(place, "numbers", HALF + number) for number in (*numbers, *more)}
    assert len(stamps) == len(numbers) + len(more) and None not in stamps
    plain = stamp(place, "numbers", HALF + "0.0")
    spaced = HALF.replace("):", "):\n    # a comment\n\n") + "0.0  # another"
    assert stamp(place, "elsewhere", spaced + "\nunused = [1]") == plain
    for old, new in (("by=2.0", "by=3.0"), ("more=0.0", "more=1.0"), ("2.0, *,", "2.0,")):
        assert stamp(place, "numbers", HALF.replace(old, new) + "0.0") not in (plain, None)


@pytest.mark.parametrize(
    "value",
    ["[1.0]", "{}", "{1.0}", "b'1'", "1j", "...", "range(3)", "object()",
     "ctypes.c_double", "type('Class', (), {})", "__import__('numpy').array(['a'])", "(1.0, [2.0])",
     "numba.vectorize(half)", "functools.partial(half, 1.0)", "type('Float', (float,), {})(1.0)",
     "numba.njit(half, fastmath={'nsz'})", "type.__call__"],
)  # fmt: skip
def test_other_values_have_no_stamp(place, value):
    kind = loaded(place, "other", f"{HALF}0.0\nNUMBER = {value}")
    assert frozen.why_not_cached(kind) and frozen.stamp_of(kind) is None


def test_a_class_that_changes_in_a_process_gets_another_stamp_and_back(place):
    kind = loaded(place, "steady", HALF + "1.0")
    first, names = frozen.frozen_class(kind), kind.torque.__globals__
    names["NUMBER"] = 2.0
    assert frozen.stamp_of(kind) == stamp(place, "steady again", HALF + "2.0") != first.stamp
    names["NUMBER"] = 1.0
    assert frozen.frozen_class(kind) is first
    kind.torque = lambda self: (0.0, 0.0, 0.0)
    assert frozen.stamp_of(kind) != first.stamp


STATE = MassProperties(*[1.0] * 9), (1.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0)


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """What tells how many functions Numba compiles for a class, with an empty cache at first."""
    monkeypatch.setenv("RIGIDMC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(disk_cache, "_TOLD", set())
    count, real = [], lowering._infer

    def counted(*arguments):
        count.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(lowering, "_infer", counted)

    def functions(kind):
        count.clear()
        for module in kernels, machine_code:
            monkeypatch.setattr(module, "_addresses", {})
        monkeypatch.setattr(machine_code, "_llvm_code", {})
        found = evaluate_forces((kind(0.3, 0.7),), *STATE)
        assert found[:3].tolist() == pytest.approx([1.5 * 0.3, 0.7, 0.0], rel=1e-15)
        return len(count)

    return functions


SIMPLE = "def half(x):\n    return 0.5 * x"


def test_a_file_of_an_own_part_is_taken_from_a_private_cache_only(
    place, compiled, tmp_path, caplog
):
    def again():
        return compiled(loaded(place, "private", SIMPLE))

    assert again() > 0 and again() == 0
    (file,), (machine_code,) = ((tmp_path / "cache").rglob(f"*.{kind}") for kind in ("bc", "o"))
    data, aside = file.read_bytes(), tmp_path / "aside"
    torn = bytearray(data)
    torn[len(data) // 2] ^= 1
    file.write_bytes(torn)
    assert again() == 0  # from the machine code
    machine_code.write_bytes(torn)
    assert again() > 0 and again() == 0 and not caplog.records

    aside.write_bytes(data)
    for each in file, machine_code:
        each.unlink()
        each.symlink_to(aside)
    assert again() > 0 and "is a link" in caplog.text
    assert aside.read_bytes() == data and not file.is_symlink()

    file.write_bytes(data)
    for folder in (file.parent, file.parent.parent, tmp_path / "cache"):
        disk_cache._TOLD.clear()
        caplog.clear()
        folder.chmod(0o770)
        assert again() > 0 and "not private" in caplog.text
        folder.chmod(0o700)
    assert again() == 0


def test_llvm_code_with_a_right_sum_and_no_code_is_replaced(place, compiled, tmp_path, caplog):
    """Nothing in it runs: when files were pickles, such a file could name a command."""
    assert compiled(loaded(place, "planted", SIMPLE)) > 0
    (file,), (machine_code,) = ((tmp_path / "cache").rglob(f"*.{kind}") for kind in ("bc", "o"))
    content = b"no code" * 100
    file.write_bytes(content + hashlib.sha256(file.name.encode() + content).digest())
    machine_code.unlink()
    assert compiled(loaded(place, "planted", SIMPLE)) > 0
    assert "cannot use the kernel cache" in caplog.text
    assert compiled(loaded(place, "planted", SIMPLE)) == 0


def test_two_classes_of_one_name_in_a_signature_keep_their_places(place, compiled):
    """Each is written by its place: in the next process they may be loaded in another order."""
    one = "def half(x):\n    return 0.25 * x"
    kinds = [loaded(place, "two", code) for code in (SIMPLE, one)]

    def forces(first, second):
        return evaluate_forces((first(1.0, 0.0), second(0.0, 1.0)), *STATE)

    assert compiled(kinds[0]) > 0
    first = forces(*kinds)
    again = [loaded(place, "two", code) for code in (one, SIMPLE)][::-1]
    assert compiled(again[0]) == 0
    assert (forces(*again) == first).all()
    swapped = forces(*again[::-1])
    assert swapped.tolist() == [0.75, 1.0, 0.0, 0.0] != first.tolist()


SCENE = """
[body]
moments = [1.0, 2.0, 2.8]

[effects.Push]
module = "mine.py"
size = 0.3
other = 0.7

[start]
omega = [0.1, 0.2, 0.3]

[run]
dt = 0.02
t_end = 0.2
every = 0.1
save = ["omega"]
"""
SIMULATE = """
import sys
from rigidmc.engine.compiler import lowering
count, plain = [], lowering._infer
def counted(*arguments):
    count.append(1)
    return plain(*arguments)
lowering._infer = counted
import rigidmc as rm
from rigidmc.engine import compile_helper
compile_helper.threads_available = lambda: 1
scene = rm.Scene.load(sys.argv[1], allow_code=True)
bits = rm.simulate(scene).omega.values.tobytes().hex()
print(len(count), bits)
print([one.compiled for one in rm.precompile(scene)])
"""


@pytest.mark.slow  # 12 s: two processes, and all pieces of a run; the formulas above take less
def test_a_run_with_an_own_effect_compiles_nothing_in_the_next_process(place):
    """Before, the second process compiled as many functions as the first, 132 for one effect."""
    folder = bare(place, "simulated", SIMPLE, "half(3.0)")
    with open(os.path.join(folder, "scene.toml"), "w") as file:
        file.write(SCENE)
    given = SIMULATE, os.path.join(folder, "scene.toml")
    (first, bits, *_), (second, same, *warmed) = (
        python(*given, cache=place / "simulate")[0].split() for _ in range(2)
    )
    assert int(first) > 50 and int(second) == 0 and bits == same and warmed == ["[()]"]


@pytest.mark.parametrize(
    ("of", "name", "value"),
    [(np, "__version__", "0"), (numba, "__version__", "0"), (disk_cache, "_C_LIBRARY", "glibc 1")],
)
def test_another_library_makes_all_kernels_stale(monkeypatch, of, name, value):
    before = disk_cache.compiler_stamp.__wrapped__()
    monkeypatch.setattr(of, name, value)
    assert disk_cache.compiler_stamp.__wrapped__() != before

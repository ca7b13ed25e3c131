"""The disk cache of kernels: fast the second time, void after any change of the sources, safe.

Each test runs a copy of the package in separate processes, with a separate cache folder.
"""

import ctypes
import errno
import json
import os
import random
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import llvmlite.binding as llvm
import numba
import pytest

import rigidmc
from rigidmc.engine import compile_time
from rigidmc.engine.compiler import disk_cache, frozen, machine_code
from rigidmc.engine.machine import vector_bits
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.integrators.protocol import step
from rigidmc.physics.integrators.rk4 import RK4
from tests.tools.commands import python
from tests.tools.reference import apart

pytestmark = pytest.mark.skipif(
    not hasattr(os, "getuid"), reason="folder permissions are those of POSIX"
)

RUN = """
import json, logging, os, sys
logging.basicConfig(format="%(name)s %(levelname)s %(message)s")
from typing import NamedTuple
import numpy as np
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects import ViscousDamping
from rigidmc.engine import compile_helper, program
from rigidmc.engine.program_spec import ProgramSpec
from rigidmc.engine.compiler import machine_code
from rigidmc.engine.kernel import arguments, block as one_block
from rigidmc.engine.kernel import layout as K
from rigidmc.physics.integrators import scheme_of
from rigidmc.physics.integrators.rk4 import RK4

if sys.argv[1] == "import only":
    print(json.dumps({"home": os.path.dirname(one_block.__file__)}))
    sys.exit()

class Own(NamedTuple):
    size: float
    def torque(self, t, l):
        return self.size * SIGN, t * l[1], 0.0

effect = {"damping": ViscousDamping(2.0), "own": Own(0.5), "none": None}[sys.argv[1]]
effects = (effect,) if effect else ()
block = np.zeros((K.EFFECTS + len(effects), K.LANES))
block[:K.EXTRA] = np.array([0.6, 0.0, 0.8, 0.0, 1.0, 2.0, 3.0])[:, None]
block[K.BODY:K.EFFECTS] = np.array(MassProperties.of((1.0, 1.2, 1.5), (0.1, 0.2, 0.3))[:9])[:, None]
block[K.EFFECTS:] = effect[0] if effect else 0.0
compile_helper.threads_available = lambda: 1  # no second process: what is counted is compiled here
lowered, lower = [], machine_code.lower
machine_code.lower = lambda *given: lowered.append(given) or lower(*given)
steps = arguments.StepRange(0.01, 1, 4, 4, 0, 0, 4)
program.Program(ProgramSpec(scheme_of(RK4()), effects)).advance(block, steps)
misses = len(lowered)
hits = len(machine_code._addresses) - misses
state, home = block[:K.EXTRA, 0].tolist(), os.path.dirname(one_block.__file__)
print(json.dumps({"state": state, "hits": hits, "misses": misses, "home": home}))
"""


@pytest.fixture
def place(tmp_path):
    """A folder with a copy of the package and nothing else.

    What Python has compiled of it is copied, but for the effects: a test changes one, not its date.
    """
    shutil.copytree(Path(rigidmc.__file__).parent, tmp_path / "rigidmc")
    shutil.rmtree(tmp_path / "rigidmc" / "physics" / "effects" / "__pycache__", ignore_errors=True)
    return tmp_path


def ran(place, effect="damping", sign=1, **settings):
    """(the output of a process with that effect, its log)."""
    settings |= {"PYTHONPATH": str(place), "PYTHONDONTWRITEBYTECODE": "1"}
    code = RUN.replace("SIGN", str(sign))
    out, log = python(code, effect, cache=place / "cache", cwd=place, **settings)
    found = json.loads(out)
    assert Path(found["home"]).is_relative_to(place)
    return found, log


PIECES = 6  # gather, scatter, initialise, march, assess, and the loop over members


def kernels_in(folder, kind="o"):
    """The files of machine code, or with "bc" of LLVM code."""
    return sorted(folder.rglob(f"*.{kind}"))


def edit(place, path, old, new):
    """Change a source; not even its date differs."""
    source = place / "rigidmc" / path
    text, stamp = source.read_text(), source.stat()
    assert old in text
    source.write_text(text.replace(old, new))
    os.utime(source, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))


WITH_DAMPING = 3  # of the pieces: initialise, march, assess


def test_a_changed_source_changes_the_kernels_that_read_it(place):
    first, log = ran(place)
    assert (first["hits"], first["misses"], log) == (0, PIECES, "")
    assert len(kernels_in(place / "cache")) == PIECES
    kernel = kernels_in(place / "cache")[0]
    ours = place / "cache" / "rigidmc-kernels"
    forgotten, young, unmarked, linked = (ours / (digit * 32) for digit in "0123")
    kept = [ours / "thesis", place / "cache" / "thesis", place / "cache" / ("4" * 32), unmarked]
    for folder in (forgotten, young, *kept):
        folder.mkdir()
        (folder / "kernel.o").touch()
        if folder != unmarked:
            (folder / "made-by-rigidmc").touch()
    linked.symlink_to(kept[1])
    unread = kernel.with_name("unread.bc")
    unread.touch()
    for folder in (forgotten, *kept):
        for file in folder.iterdir():
            os.utime(file, (0, 0))
    os.utime(unread, (0, 0))

    damping = "physics/effects/damping.py", "return scale(-self.rate, l)"
    edit(place, *damping, "return scale(+self.rate, l)")
    changed, _ = ran(place)
    assert (changed["hits"], changed["misses"]) == (PIECES - WITH_DAMPING, WITH_DAMPING)
    assert changed["state"] != first["state"]
    # A process that stores kernels deletes those that none has read for a month.
    assert all(folder.exists() for folder in (young, linked, *kept))
    assert all((folder / "kernel.o").exists() for folder in (young, *kept))
    assert not forgotten.exists() and not unread.exists()

    # Back again, and the old kernel is still there: loaded, not compiled, whatever has changed in
    # files that no kernel of this program reads.
    edit(place, damping[0], "return scale(+self.rate, l)", damping[1])
    edit(place, "cli/scenes.py", "import", "# a comment\nimport")
    edit(place, "physics/effects/gravity.py", "import math", "import math  # a comment")
    back, _ = ran(place)
    assert (back["hits"], back["misses"]) == (PIECES, 0)
    assert back["state"] == first["state"]

    # A function that all kernels read: all are stale.
    edit(place, "physics/dynamics/so3.py", "from", "# a comment\nfrom")
    other, _ = ran(place)
    assert (other["hits"], other["misses"]) == (0, PIECES)


# Prints what was compiled for each kernel beyond the sources in its stamp.
TRACED = """
import json, os
from collections import defaultdict
from rigidmc.engine import compile_helper
from rigidmc.engine.compiler import compose, frozen, lowering, machine_code
from rigidmc.engine.compiler.source_stamps import closure_of
from rigidmc.processes.helpers import PACKAGE
import rigidmc as rm

plain, translate = machine_code.lower, lowering._translate
signature_of = compose.InlinedFunction.signature_of
files, calls, stack, homes = defaultdict(set), defaultdict(set), [None], {}

def kernel(function, *types):
    stack.append((function, types[0]))
    homes[stack[-1]] = {cls.__module__ for cls in frozen.classes_of(types[0])}
    try:
        return plain(function, *types)
    finally:
        stack.pop()

def inlined(self, context, args, kws):
    key = self.function, tuple(args), tuple(kws.items())
    calls[stack[-1]].add(key)
    stack.append(key)
    try:
        return signature_of(self, context, args, kws)
    finally:
        stack.pop()

def translated(function):
    files[stack[-1]].add(os.path.relpath(function.__code__.co_filename, PACKAGE))
    return translate(function)

machine_code.lower, lowering._translate = kernel, translated
compose.InlinedFunction.signature_of = inlined
machine_code.read = lambda entry: None
compile_helper.threads_available = lambda: 1
body = rm.Body.from_moments((1, 2, 2.8), mass=1.0, centre=(0, 0, 0.1))
scene = rm.Scene(body, (rm.Gravity(9.81), rm.ViscousDamping(0.1)), rm.Start(omega=(0.1, 1, 2)))
run = {"dt": 0.01, "t_end": 0.1, "members": 2}
exec(os.environ["RUNS"])
base = set(closure_of("rigidmc.engine.compiler.kernels"))
counts, missed = [], []
for root in homes:
    reached = [root]
    for key in reached:
        reached.extend(calls[key] - {*reached})
    read = set().union(*(files[key] for key in reached))
    stamped = base | {*closure_of(root[0].__module__, *homes[root])}
    counts.append(len(read))
    missed.append([root[0].__name__, sorted(read - stamped)])
print(json.dumps([counts, [each for each in missed if each[1]]]))
"""
RUNS = (
    "rm.simulate(scene, 'rk8', save=('flips', 'energy', 'attitude'), **run)",
    "rm.simulate(scene, 'strang', save=('nutation', 'omega'), wrt=('effects.gravity.g',), **run)",
    "rm.solve_lagrange_top((1.0, 1.0, 0.5), 1.0, (0.0, 0.0, 5.0), (0.96, 0.28, 0.0, 0.0), [1.0])",
    "rm.simulate(rm.Scene(rm.Body((1, 2, 3)), (), scene.start), 'exact', save=('omega',), **run)",
    "rm.simulate(rm.Scene(rm.Body((1, 2, 3)), (), scene.start), 'closed', **run)",
    "[rm.simulate(scene, name, save=('energy',), **run) for name in ('rk4', 'cf4', 'rkmk4')]",
    "rm.simulate(scene, 'gbs12', save=('megno',), **run)",
)


@pytest.mark.parametrize(
    "runs", [RUNS[0], *(pytest.param(each, marks=pytest.mark.slow) for each in RUNS[1:])]
)
def test_the_stamp_of_a_kernel_has_every_source_compiled_for_it(runs, tmp_path):
    """A kernel is compiled from up to 17 files beyond Numba's; its stamp has 38 or more."""
    counts, missed = json.loads(python(TRACED, cache=tmp_path, RUNS=runs)[0])
    assert max(counts) > 10 and missed == []


def test_another_processor_needs_no_typing_and_lowering(place):
    """LLVM code is the same for all processors with vectors of this width."""
    first, _ = ran(place)
    for kernel in kernels_in(place / "cache"):
        kernel.unlink()
    again, _ = ran(place)
    assert again == first | {"hits": PIECES, "misses": 0}
    assert len(kernels_in(place / "cache")) == PIECES

    features = llvm.get_host_cpu_features()
    few = features.flatten().replace("+avx512f", "+avx512f,-prefer-256-bit").replace("+aes", "-aes")
    codes = kernels_in(place / "cache", "bc")
    other, _ = ran(place, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES=few)
    assert other == again and kernels_in(place / "cache", "bc") == codes
    assert len(kernels_in(place / "cache")) == 2 * PIECES

    for code in (*codes, *kernels_in(place / "cache")):
        code.write_bytes(code.read_bytes()[:100])
    assert ran(place)[0] == first


WARNING = "rigidmc WARNING cannot use the kernel cache"
REAL = numba.float64(numba.float64)


def twice(x):
    return 2.0 * x


def thrice(x):
    return 3.0 * x


def computed(function, x):
    """What compiled code computes in a process that has compiled nothing."""
    machine_code._addresses.clear()
    machine_code._llvm_code.clear()
    pointer = ctypes.c_void_p
    call = ctypes.CFUNCTYPE(ctypes.c_int32, pointer, pointer, ctypes.c_double)
    result, error = ctypes.c_double(), pointer()
    address = machine_code.address_of(function, REAL)
    call(address)(ctypes.byref(result), ctypes.byref(error), x)
    return result.value


@pytest.fixture
def small(monkeypatch, caplog):
    """What compiles a small function with a cache in a folder; the lines of the log."""
    monkeypatch.setattr(disk_cache, "_TOLD", set())
    monkeypatch.setattr(machine_code, "_addresses", {})

    def compiled(folder):
        monkeypatch.setenv("RIGIDMC_CACHE_DIR", str(folder))
        assert computed(twice, 1.5) == 3.0
        return [f"{one.name} {one.levelname} {one.getMessage()}" for one in caplog.records]

    return compiled


def test_without_a_folder_there_is_a_warning_and_no_cache(small, tmp_path):
    (tmp_path / "file").write_text("")
    (line,) = small(tmp_path / "file" / "cache")
    assert line.startswith(WARNING) and "\n" not in line
    assert not kernels_in(tmp_path)


@pytest.mark.parametrize("mode", [0o500, 0o770, 0o707])
def test_a_folder_that_is_read_only_or_not_private_is_refused(small, tmp_path, mode):
    if mode == 0o500 and os.getuid() == 0:
        pytest.skip("root may write anywhere")
    (tmp_path / "cache").mkdir(mode=0o700)
    (tmp_path / "cache").chmod(mode)
    (line,) = small(tmp_path / "cache")
    assert line.startswith(WARNING)
    assert mode == 0o500 or "not private" in line


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_a_folder_that_is_not_private_is_not_touched(tmp_path, monkeypatch):
    """Before: a pipe named pace blocked each run, and a link pace.NUMBER emptied its target."""
    shared, mine = tmp_path / "shared", tmp_path / "mine"
    monkeypatch.setenv("RIGIDMC_CACHE_DIR", str(shared))
    monkeypatch.setattr(disk_cache, "_TOLD", set())
    for place in (shared, shared / "rigidmc-kernels"):
        place.mkdir()
        os.mkfifo(place / "pace")
        mine.write_text("mine")
        (place / f"pace.{os.getpid()}").symlink_to(mine)
        place.chmod(0o777)
    there = sorted(map(str, tmp_path.rglob("*")))
    assert compile_time._pace() == 1.0
    compile_time._learn(2.0)
    with pytest.raises(PermissionError, match="not private"):
        disk_cache.kernel_folder()
    assert computed(twice, 1.5) == 3.0
    assert sorted(map(str, tmp_path.rglob("*"))) == there and mine.read_text() == "mine"


def test_a_private_folder_is_accepted_silently(small, tmp_path):
    (tmp_path / "cache").mkdir(mode=0o700)
    assert small(tmp_path / "cache") == []
    assert len(kernels_in(tmp_path / "cache")) == 1


def own_of_script():
    """The class of the script, by the same lines."""
    (lines,) = re.findall(r"^(class Own.*?)\n\n", RUN, re.S | re.M)
    script = {"__name__": "__main__", "NamedTuple": NamedTuple, "SIGN": 1}
    exec(lines, script)
    return script["Own"]


def test_a_class_of_a_script_has_no_stamp():
    """Code of a class without a stamp is never stored; two scripts have classes of one name."""
    own = own_of_script()
    assert frozen.stamp_of(own) is None
    signature = numba.float64(numba.typeof(frozen.frozen(own(0.5))))
    assert not disk_cache.entry_of([signature]).is_lasting


@pytest.mark.slow  # 12 s: two processes, each of which compiles
def test_a_user_effect_works_and_is_never_taken_from_the_cache(place):
    """Two classes of one name, defined in two scripts, have different physics."""
    first, log = ran(place, "own", sign=1)
    assert log == ""
    other, _ = ran(place, "own", sign=-1)
    assert (first["hits"], other["hits"]) == (0, 3)
    # code without effects: enter, leave, and the loop over members
    assert len(kernels_in(place / "cache")) == 3
    assert first["state"] != other["state"]
    body = MassProperties.of((1.0, 1.2, 1.5), (0.1, 0.2, 0.3))
    q, l = (0.6, 0.0, 0.8, 0.0), (1.0, 2.0, 3.0)
    for i in range(4):
        l = step(RK4(), body, (own_of_script()(0.5),), 0.01 * i, 0.01, (), q, l, ())[1]
    assert apart(l, first["state"][4:]) < 4e-15  # measured 0


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The files of LLVM code and of machine code of a small function."""
    monkeypatch.setenv("RIGIDMC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(disk_cache, "_TOLD", set())
    monkeypatch.setattr(machine_code, "_addresses", {})
    assert computed(twice, 1.5) == 3.0
    return [file for kind in ("bc", "o") for file in kernels_in(tmp_path / "cache", kind)]


@pytest.mark.parametrize("level", [0, 1])
def test_a_kernel_with_any_flipped_bit_is_not_loaded(kept, caplog, level):
    """Without the checksum at its end 269 of 300 such files were loaded, and one run in seven
    crashed.
    """
    file, some = kept[level], random.Random(5)
    data, entry = file.read_bytes(), disk_cache.Entry(file.name, True)
    bad = [data[:cut] for cut in (0, 1, 31, 32, 33, len(data) // 2, len(data) - 1)]
    bad += [data + b"x", b"\0" * len(data), data[32:], kept[1 - level].read_bytes()]
    for _ in range(300):
        torn = bytearray(data)
        torn[some.randrange(len(data))] ^= 1 << some.randrange(8)
        bad.append(bytes(torn))
    for torn in bad:
        file.write_bytes(torn)
        assert disk_cache.read(entry) is None and not file.exists()
    for other in kept:
        other.unlink(missing_ok=True)
    assert computed(twice, 1.5) == 3.0 and disk_cache.read(entry) and not caplog.records


def test_code_of_another_kernel_is_refused(kept):
    """A file under another name, with the sum that it had."""
    for other, file in zip(kept, reversed(kept), strict=True):
        entry = disk_cache.Entry(f"0{file.name}", True)
        other.with_name(entry.name).write_bytes(file.read_bytes())
        assert disk_cache.read(entry) is None


def test_a_kernel_for_another_cpu_is_not_loaded(kept, monkeypatch):
    """CPUs with the same Python, x86-64 and ARM among them, may share a folder."""
    entry = machine_code.kernel_entry(twice, REAL)
    assert [entry.name, machine_code._of_processor(entry).name] == [file.name for file in kept]
    here, changes = machine_code._codegen().magic_tuple(), []
    for place, word in enumerate(("aarch64-unknown-linux-gnu", "neoverse-n1", "+neon")):
        told = *here[:place], word, *here[place + 1 :]
        other = SimpleNamespace(magic_tuple=lambda told=told: told)
        changes.append((machine_code, "_codegen", lambda other=other: other))
    changes.append((machine_code, "vector_bits", lambda: 2 * vector_bits()))
    changes.append((llvm, "get_process_triple", lambda: "aarch64-unknown-linux-gnu"))
    for change in changes:
        with monkeypatch.context() as patch:
            patch.setattr(*change)
            now = machine_code.kernel_entry(twice, REAL)
            assert not disk_cache.is_stored(machine_code._of_processor(now))
            assert disk_cache.is_stored(now) == (change[1] == "_codegen")
    assert disk_cache.is_stored(entry)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO, errno.EROFS])
@pytest.mark.parametrize("what", ["written", "read"])
def test_a_cache_that_fails_costs_one_line(kept, caplog, monkeypatch, code, what):
    folder, real, failed = kept[0].parent, open, []

    def failing(path, *mode, **named):
        if str(folder) in str(path) and (what == "written") == (mode[:1] == ("wb",)):
            failed.append(path)
            raise OSError(code, os.strerror(code), path)
        return real(path, *mode, **named)

    monkeypatch.setattr("builtins.open", failing)
    for _ in range(2):
        assert computed(twice if what == "read" else thrice, 1.0) in (2.0, 3.0)
    assert len(failed) >= 2 and len(caplog.records) == 1
    assert str(folder.parent) in caplog.text and os.strerror(code) in caplog.text
    assert {file.suffix for file in folder.iterdir()} <= {"", ".bc", ".o"}

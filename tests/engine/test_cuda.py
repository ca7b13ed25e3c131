"""Members on graphics processors, without one.

What a device would run is compiled to PTX and read. The same kernel, compiled for this processor,
goes through the same launches by a stand-in for the driver (`tests.tools.fake_cuda`), and has to
give the bits that another machine recorded. None of this says that a device was at hand.
"""

import math
import os
import re
import shutil
import sys
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple
from unittest.mock import Mock

import llvmlite.binding as llvm
import pytest
import xarray as xr

import rigidmc as rm
from bench import device as device_bench
from bench.__main__ import main as bench_main
from bench.bits import QUICK, sums
from bench.gpu import APPROXIMATE, NO_SPILL, ROUNDED, assembled, inspected, march_of, scenes, tool
from rigidmc.engine import linked
from rigidmc.engine.compiler import disk_cache
from rigidmc.engine.compiler import kernels as pieces
from rigidmc.engine.cuda import devices as cuda_device
from rigidmc.engine.cuda import program as cuda
from rigidmc.engine.cuda import ptx as ptx_code
from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.program_spec import NO_DERIVATIVES
from rigidmc.errors import NoRoom
from rigidmc.files.outputs import content_of
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.monitors import Monitors
from rigidmc.protocols import effect
from rigidmc.runs import price, resources
from rigidmc.runs.assemble import derivatives_on
from rigidmc.runs.directory import checkpoints, cluster
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.resume import resume
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.resources import block_of, block_of_shard, moved_at_once, movers
from rigidmc.studies import bits
from rigidmc.studies.bits import cases
from tests.engine.kernel.test_last_interval import scene as shortened
from tests.engine.test_bits import EXACT, NAMES, changed
from tests.tools.commands import invoke
from tests.tools.fake_cuda import fake as fake
from tests.tools.plans import plan_of, program_of
from tests.tools.same import assert_same

pytestmark = [
    pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning"),
    pytest.mark.skipif(bool(pieces.config.DISABLE_JIT), reason="nothing is compiled"),
]
# a case of test_bits.py, so that its code is there
HEAVY = next(one.scene for one in cases(("rk4",), ("heavy",)) if one.name == "heavy, rk4, 0.05")
SCENE = HEAVY.with_run(dt=0.02, members=70)


def quick_if(quick, names):
    """Parameters of a test of these names, of which most are for slow tests."""
    return [one if one in quick else pytest.param(one, marks=pytest.mark.slow) for one in names]


# each takes 10 to 18 s
SOME = quick_if(("rk4",), QUICK)
GROWING = next(one for one in cases(("strang",), ("heavy",)) if "works" in one.name).scene
# of runs that monitor nothing
ALONE = {"integrator": "rk4", "dt": 0.02, "t_end": 2.0, "members": 70, "save": ("momentum",)}


def assert_alike(scene, fake):
    """Assert that a device gives the bits of the processor; return them."""
    here, driver = rm.simulate(scene), fake()
    there = rm.simulate(scene, device="cuda")
    assert driver.launches
    assert_same(here, there)
    return here


def test_works_and_the_growth_of_tangents_have_the_bits_of_the_processor(fake):
    """Those of tests/engine/test_bits.py, without its events and statistics: they take 9 s to
    compile, and the launches below watch others."""
    scene = replace(GROWING, observables=())
    scene = scene.with_run(save=("attitude", "momentum", "energy", "work", "megno"))
    assert {"work", "lyapunov"} <= set(assert_alike(scene, fake).data_vars)


@pytest.mark.slow
def test_the_launches_give_the_recorded_bits(fake):
    driver = fake()
    assert not changed(sums((0,), QUICK, device="cuda"))
    assert driver.launches


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name != "closed"])
def test_the_launches_of_every_integrator_give_the_recorded_bits(name, fake):
    fake()
    assert not changed(sums((0,), (name,), device="cuda"))


@pytest.mark.slow
@pytest.mark.parametrize("settings", [
    {"integrator": "strang", "save": ("omega", "flips", "omega_mean", "omega_variance")},
    {"integrator": "rk4", "turn": 0.05, "save": ("omega", "flips", "omega_mean")},
], ids=["equal steps", "own steps"])  # fmt: skip
def test_a_shorter_last_interval_has_the_same_bits(settings, fake):
    assert_alike(shortened().with_run(members=70, **settings), fake)


WRT = "start.omega.size", "start.omega.angle", "body.moments.1", "effects.gravity.g"


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["rk4", "rk8"])
def test_derivatives_have_the_bits_of_the_processor(integrator, fake):
    """Two passes of two here; with rk8 four of one there."""
    save = "omega", "attitude", "flips"
    assert_alike(SCENE.with_run(integrator=integrator, save=save, wrt=WRT), fake)


@pytest.mark.parametrize(("integrator", "passes"), [("rk4", (2, 2)), ("rk8", (1, 4))])
def test_derivatives_fit_in_the_registers_of_a_device(integrator, passes):
    plan = plan_of(SCENE.with_run(integrator=integrator, wrt=WRT))
    assert derivatives_on("cpu", plan)[:2] == (2, 2)
    assert derivatives_on("cuda", plan)[:2] == passes
    assert derivatives_on("cuda", plan._replace(derivatives=NO_DERIVATIVES)) == NO_DERIVATIVES


@pytest.mark.slow
def test_the_comparison_sees_one_bit(fake, monkeypatch):
    """A kernel that fuses one more product with a sum is not the processor's."""
    fake()
    made = linked.link_kernel

    def fusing(*given, **named):
        text = re.sub(r"= fmul <1", "= fmul contract <1", str(made(*given[:3])))
        return llvm.parse_assembly(re.sub(r"= fadd <1", "= fadd contract <1", text))

    monkeypatch.setattr(linked, "link_kernel", fusing)
    assert changed(sums((0,), QUICK, names=NAMES[-2:], device="cuda"))


def kernels(*integrators, names=(*NAMES, *(f"heavy, {name}, 0.05" for name in NO_SPILL))):
    """{label: program} of the cases of `bench.bits` by these integrators, nothing compiled."""
    some = (one for one in cases(integrators) if one.scene.run.integrator in integrators)
    return {one.name: program_of(one.scene, "cuda") for one in some if one.name in names}


def targets(programs):
    """(label, program, capability): all capabilities for the first, the last for the others.

    What LLVM selects for a capability differs by operations, not by scenes.
    """
    for i, (label, program) in enumerate(programs.items()):
        for capability in cuda_device.TARGETS[-1 if i else 0 :]:
            yield label, program, capability


# one of each precision: the free one and that with steps of its own compile 9 kernels more
BOTH = "heavy, rk4, 0.05", "heavy, rk4, 0.05, float32"


@pytest.mark.parametrize(
    ("name", "cases"),
    [
        ("rk4", {"names": BOTH}),
        *(pytest.param(one, {}, marks=pytest.mark.slow, id=one) for one in QUICK),
    ],
)
def test_ptx_has_only_operations_of_ieee_754(name, cases, fake):
    """Rounded to nearest, and fused where the processor's code fuses them. No function is called
    that is not part of the code."""
    fake(compiled=False)
    for label, program, capability in targets(kernels(name, **cases)):
        ptx = program.code_for("{}.{}".format(*capability))
        assert f".target sm_{capability[0]}{capability[1]}" in ptx
        assert ".visible .entry members(" in ptx
        assert not APPROXIMATE.findall(ptx), label
        modes = {mode for _, mode in ROUNDED.findall(ptx)}
        assert modes == {".rn"}, (label, modes)
        called = set(re.findall(r"call\.uni[^;]*?\b(\w+),?\s*\(", ptx))
        assert called <= set(program.kernel_keys), (label, called)
    assert APPROXIMATE.search("\tsqrt.approx.f64 %fd1, %fd2;")
    assert ROUNDED.findall("\tfma.f64 %fd1, %fd2, %fd3, %fd4;") == [("fma", "")]


OF_LLVM = re.compile(r"= (?:tail )?(?:call [^@]*@llvm\.(fma|sqrt)\.|f(add|sub|mul|div) )")


@pytest.mark.parametrize("name", [*SOME, "rk8"])
def test_ptx_has_the_operations_of_the_processor(name, fake):
    """As many fused multiply-adds, divisions and roots in the steps, and as many products and sums
    together: in PTX 2 x is x + x, and 1/x is rcp, with the same bits."""
    fake(compiled=False)
    sort = {"fma": 0, "div": 1, "rcp": 1, "sqrt": 2}
    for label, program, capability in targets(kernels(name)):
        _, text = pieces.llvm_of(program.kernel_keys["march"])
        here = by_sort(sort, (one or other for one, other in OF_LLVM.findall(text)))
        machine = ptx_code.machine_for(capability)
        module = llvm.parse_assembly(linked.MACHINE.sub("", text))
        ptx = machine.emit_assembly(linked.optimise(module, machine))
        there = by_sort(sort, (kind for kind, _ in ROUNDED.findall(ptx)))
        assert here == there and here[0] > 0, label


def by_sort(sort, kinds):
    """How many fused multiply-adds, divisions, roots, and others."""
    counts = Counter(sort.get(kind, 3) for kind in kinds)
    return [counts[i] for i in range(4)]


def loops(function):
    """The lines of each innermost loop of a function of PTX."""
    lines, found = function.splitlines(), []
    places = {line[:-1]: i for i, line in enumerate(lines) if re.fullmatch(r"\$L\w+:", line)}
    for i, line in enumerate(lines):
        to = re.search(r"\bbra\S*\s+(\$L\w+);", line)
        if to and places.get(to[1], i) < i:
            found.append(lines[places[to[1]] : i + 1])
    return found


# exact has the most registers
MOST = quick_if(("rk4", "exact"), NO_SPILL)


@pytest.mark.parametrize("name", MOST)
def test_steps_touch_no_memory(name, fake):
    """The state stays in registers from the first step of a launch to the last look."""
    fake(compiled=False)
    label = f"heavy, {name}, 0.05" if name != "exact" else EXACT  # with the most registers
    (scene,) = (one.scene for one in cases((name,)) if one.name == label)
    # The steps are those of any observables, which take 5 s to compile if they are events.
    scene = replace(scene.with_run(save=("attitude", "omega_last")), observables=())
    text = program_of(scene, "cuda").code_for("9.0")
    memory = [
        len([line for line in loop if re.search(r"\b(ld|st)\.", line)])
        for loop in loops(march_of(text))
    ]
    assert sorted(memory) == [0, 7], (label, memory)  # 7: the trace of what is watched


@pytest.mark.parametrize("every", [SCENE.run.every, (0.1, 0.14, 1.0)], ids=["even", "listed"])
def test_launches_are_short_and_change_no_bit(every, fake, monkeypatch):
    """A run in many launches, with room for one save, and on two devices by three threads."""
    scene = SCENE.with_run(every=every)
    alone = rm.simulate(scene)
    driver = fake(devices=2)
    monkeypatch.setattr(cuda, "LAUNCH", 1e-5)
    monkeypatch.setattr(cuda, "SAVED", 8)
    ds = rm.simulate(scene, device="cuda", threads=3, block=32)
    assert_same(alone, ds)
    assert len(driver.launches) > 12  # measured 253
    assert driver.used == {0, 1}
    # what is left are the numbers of programs
    assert driver.most > 10_000 and driver.taken < 4_000  # measured 27,545 to 80,907, and 0


def test_a_run_begun_on_a_device_goes_on_without_one(fake, tmp_path):
    """And the other way round: shards of both have the same names, which have their sums."""
    folders = [tmp_path / name for name in ("cpu", "cuda", "both")]
    fake()
    for folder in folders:
        create(SCENE.with_run(members=9000), folder, 1e3)
    resume(folders[0])
    resume(folders[1], device="cuda")
    resume(folders[2], only=range(1), device="cuda")
    resume(folders[2])
    names = [sorted(path.name for path in (folder / "shards").iterdir()) for folder in folders]
    assert names[0] == names[1] == names[2] and len(names[0]) > 2


@effect(units={"size": "N m"})
class Branching(NamedTuple):
    """An effect that no vector can run."""

    size: float

    def torque(self, q):
        if q[0] > 0.5:
            return (self.size, 0.0, 0.0)
        return (0.0, self.size * q[1], 0.0)


@effect(units={"size": "N m"})
class Foreign(NamedTuple):
    """An effect that calls the C library, with one number at a time."""

    size: float

    def torque(self, t):
        if t > 0.5:
            return (self.size, 0.0, 0.0)
        return (0.0, math.erf(t), 0.0)


ON_LINUX = pytest.mark.skipif(tool("ptxas") is None, reason="ptxas is for Linux on x86 alone")


@ON_LINUX
@pytest.mark.parametrize("name", quick_if(("rk4",), NO_SPILL))
def test_the_steps_spill_no_register(name):
    """`python -m bench gpu` has the table of all integrators and effects."""
    row = inspected("nothing", name, scenes(True)["nothing"], (), (9, 0))
    assert row["spills"] == 0 and 64 < row["registers"] < 256  # measured 132, 235, 200, 204
    assert row["fma"] > 50 and row["modes"] == [".rn"]


@pytest.mark.slow
@ON_LINUX
def test_one_derivative_of_rk4_spills_no_register():
    """`python -m bench derivatives` has the registers of more derivatives, and of rk8."""
    heavy, wrt = scenes(True)["gravity"], ("start.omega.1",)
    row = inspected("gravity", "rk4", heavy, (), (9, 0), wrt)
    assert row["spills"] == row["spills in steps"] == 0 and row["registers"] < 256  # measured 218
    assert row["modes"] == [".rn"] and not row["approximate"]


@ON_LINUX
def test_machine_code_fuses_no_other_products(fake):
    """A step of rk8 has no division, which takes fused multiply-adds of its own."""
    row = inspected("gravity", "rk8", scenes(True)["gravity"], (), (9, 0))
    steps, sass = row["steps"], row["sass"]
    assert (sass["DFMA"], sass["DMUL"]) == (steps["fma"], steps["mul"])  # measured 675, 179
    assert sass["DADD"] == steps["add"] + steps.get("sub", 0)  # measured 8
    assert steps["fma"] > 600


@pytest.mark.parametrize(
    "fault, error, words",
    [
        ({"devices": 0}, rm.NoDevice, "finds no GPU"),
        ({"memory": 2**14}, NoRoom, r"1 blocks of 32 members at once need .* GB are free"),
        # another process took it
        ({"memory": 2**14, "shown": 2**30}, rm.NoDevice, "out of memory"),
        ({"fail_at": 1}, rm.NoDevice, "cuStreamSynchronize failed: CUDA_ERROR_LAUNCH_FAILED"),
    ],
)
def test_faults_are_one_message(fault, error, words, fake, tmp_path):
    fake(**fault)
    with pytest.raises(error, match=words):
        rm.simulate(SCENE, device="cuda", block=32, threads=1, output=tmp_path / "a.nc")
    assert not list(tmp_path.iterdir())


def test_words_of_devices(fake, monkeypatch):
    fake(devices=2)
    found = {word: resolve_device(word) for word in ("auto", "cuda:1", "cpu", None)}
    assert found == {"auto": "cuda", "cuda:1": "cuda:1", "cpu": "cpu", None: "cpu"}
    with pytest.raises(AttributeError, match=r"rigidmc\.device was removed: give device= to"):
        rm.device("cuda")
    with pytest.raises(rm.NoDevice, match="cuda:2: the devices are cuda:0 to cuda:1"):
        rm.simulate(SCENE, device="cuda:2")
    words = r"device = .*expected cpu, cuda, cuda:NUMBER or auto"
    for word in ("gpu", "cuda:x", "CUDA", ""):
        with pytest.raises(rm.OptionError, match=words):
            rm.simulate(SCENE, device=word)
    fake(devices=0)
    assert resolve_device("auto") == "cpu"


def test_without_the_driver(monkeypatch):
    """And without the package that finds it."""
    cuda_device.devices.cache_clear()
    missing = SimpleNamespace(cuInit=Mock(side_effect=RuntimeError("libcuda.so.1 is missing")))
    monkeypatch.setattr(cuda_device, "_library", lambda: missing)
    words = r"the NVIDIA driver is missing or too old: libcuda\.so\.1"
    with pytest.raises(rm.NoDevice, match=words):
        rm.simulate(SCENE, device="cuda")
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "cuda.bindings", None)
    with pytest.raises(rm.NoDevice, match=r"pip install 'rigidmc\[cuda\]'"):
        rm.simulate(SCENE, device="cuda")


def test_old_devices_are_refused(fake, monkeypatch):
    fake()
    monkeypatch.setattr(cuda_device, "TARGETS", ((9, 1),))
    with pytest.raises(rm.NoDevice, match=r"compute capability 9\.0; code requires 9\.1"):
        rm.simulate(SCENE, device="cuda")


def test_code_that_no_device_has_is_refused(fake):
    fake(compiled=False)
    scene = rm.Scene(SCENE.body, (Foreign(0.1),), SCENE.start).with_run(**ALONE)
    with pytest.raises(rm.OptionError, match="calls erf, which GPUs do not have"):
        rm.simulate(scene, device="cuda")


def test_an_effect_that_branches_runs_on_a_device(fake):
    assert_alike(rm.Scene(SCENE.body, (Branching(0.1),), SCENE.start).with_run(**ALONE), fake)


def test_the_code_is_kept(fake, monkeypatch, tmp_path):
    """In memory, and in the disk cache, from which nothing damaged is taken."""
    monkeypatch.setenv("RIGIDMC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(disk_cache, "_texts", {})
    fake(compiled=False)
    program = kernels("rk4")["heavy, rk4, 0.05"]
    assert program.missing() == ["kernel"]
    text = program.code_for("9.0")
    name = program._entry("9.0").name
    (file,) = tmp_path.rglob(name)
    for whole in (True, False):
        disk_cache._texts.clear()
        assert not program.missing()
        with monkeypatch.context() as patch:
            if whole:
                patch.setattr(cuda, "ptx_of", None)  # which is not asked for
            assert program.code_for("9.0") == text
        file.write_bytes(file.read_bytes().replace(b"fma.rn", b"fma.rz", 1))
    file.unlink()
    assert not program.missing() and program.code_for("9.0") == text and not file.exists()


def test_doctor_compares_and_measures(fake, monkeypatch):
    fake()
    shown = invoke("doctor").output
    assert "cuda:0           Fake 0, compute capability 9.0, 132 multiprocessors" in shown
    some = bits.cases(("rk4",), ("heavy",))[:1]
    monkeypatch.setattr(bits, "cases", lambda: some)
    monkeypatch.setattr(bits, "speeds", lambda word: [("free, rk4", 7.5e10, 7.5e10 * 196)])
    found = invoke("doctor --cuda-check")
    assert found.exit_code == 0
    assert "same bits       heavy, rk4, 0.05" in found.output
    assert "75.00 G steps/s, 44 % of the float64 peak  free, rk4" in found.output
    monkeypatch.setattr(bits, "digest", lambda scene, device=None: object())
    assert invoke("doctor --cuda-check").exit_code == 4


def test_speeds_are_of_steps_that_watch_nothing(monkeypatch):
    """Events that are watched cost a device five times what heavy steps of rk4 cost."""
    runs = list[PreparedRun]()
    monkeypatch.setattr(bits, "cost_per_step", lambda run, _: runs.append(run) or 1.0)
    assert [steps for _, steps, _ in bits.speeds("cpu")] == 4 * [1e9]
    has_attitude = [False, True, False, False]
    assert [run.plan.monitors for run in runs] == [Monitors(has_attitude=a) for a in has_attitude]


@pytest.mark.slow
def test_the_bench_measures_a_device(fake, capsys):
    fake()
    rows = device_bench.run(True)
    kinds = Counter(row["kind"] for row in rows)
    assert {"card", "bits", "target", "speed", "block", "whole"} <= set(kinds)
    assert all(row["same"] for row in rows if row["kind"] == "bits")
    (speed,) = (row for row in rows if row["kind"] == "speed")
    assert speed["speed"] > 0.0 and (speed["registers"], speed["threads"]) == (176, 128)
    (block,) = (row for row in rows if row["kind"] == "block")
    assert (block["threads"], block["resident"], block["limit"]) == (32, 256, None)
    device_bench.report(rows)
    assert "free, momentum alone" in capsys.readouterr().out


@pytest.mark.slow
@ON_LINUX
def test_the_bench_limits_the_registers_of_a_thread(fake):
    """Also those of the steps, which the kernel calls."""
    fake(compiled=False)
    text = kernels("rk4", names=("free, rk4, 0.05",))["free, rk4, 0.05"].code_for("9.0")
    assert device_bench.limited(text, None) == text
    found = assembled(device_bench.limited(text, 80), (9, 0))
    assert 64 < found["registers"] <= 80  # measured 80, and 255 without a limit


def test_the_bench_keeps_its_rows_without_a_device(fake, monkeypatch, tmp_path):
    fake(devices=0)
    assert device_bench.run(True) == []
    monkeypatch.setattr(sys, "argv", ["bench", "device", "--output", str(tmp_path)])
    monkeypatch.setattr(os, "environ", dict(os.environ))
    (tmp_path / "device.json").write_text("kept")
    bench_main()
    assert (tmp_path / "device.json").read_text() == "kept"


@pytest.mark.slow
def test_commands_take_a_device(fake, monkeypatch, tmp_path):
    """`run`, `show` and a study; what follows is on the processor again."""
    driver = fake()
    scene = tmp_path / "tops.toml"
    scene.write_text(SCENE.dumps())
    words = ("run", scene, "--members", 96, "--shard-size", 0.001, "-o")
    assert invoke(*words, f"{tmp_path}/there/", "--device", "cuda").exit_code == 0
    assert driver.launches
    moved = len(driver.launches)
    assert invoke(*words, f"{tmp_path}/here/").exit_code == 0 and len(driver.launches) == moved
    names = [sorted(p.name for p in (tmp_path / x / "shards").iterdir()) for x in ("here", "there")]
    assert names[0] == names[1]

    monkeypatch.setattr(price, "DEVICE_BLOCK", 32)
    monkeypatch.setattr(price, "LONG", 0.01)
    shown = invoke("show", scene, "--device", "cuda:0").output
    assert "ns per member-step on one GPU" in shown
    assert "Fake 0, blocks of 128 threads, 256 resident per multiprocessor" in shown

    alike = "sensitivity", scene, "--of", "mean(nutation_max)", "--families", 16, "-o"
    for where, more in (("here", ()), ("there", ("--device", "cuda"))):
        file = tmp_path / f"{where}.nc"
        assert invoke(*alike, file, *more).exit_code == 0
    files = [xr.open_dataset(tmp_path / f"{where}.nc") for where in ("here", "there")]
    with files[0] as here, files[1] as there:
        assert here.total.values.tobytes() == there.total.values.tobytes()
    assert len(driver.launches) > moved


MEASURED = "--of", "mean(nutation_max)"
SIDES = "--x", "start.omega.size=4:6", "--y", "start.attitude.theta=0.3:0.6"


@pytest.mark.parametrize("words", [
    ("run", "scene"),
    ("run", "scene", "--until", "mean(nutation_max) +- 50 %", "--most", 64),
    pytest.param(
        ("map", "scene", *SIDES, *MEASURED, "--resolution", 2, "--members", 8),
        marks=pytest.mark.slow,
    ),
    pytest.param(
        ("rare", "scene", "--of", "p(nutation_max >= 0.4)", "--members", 32, "--repetitions", 2),
        marks=pytest.mark.slow,
    ),
], ids=("run", "until", "map", "rare"))  # fmt: skip
def test_commands_move_members_on_the_device(words, fake, monkeypatch, tmp_path):
    """In memory and in a run directory, and only there where --device says so."""
    driver = fake()
    monkeypatch.setattr(price, "DEVICE_BLOCK", 32)
    monkeypatch.setattr(price, "LONG", 0.01)
    scene = tmp_path / "tops.toml"
    scene.write_text(SCENE.dumps())
    command = [scene if word == "scene" else word for word in words]
    folders = [()] if "--until" in words else [(), ("-o", f"{tmp_path}/run/")]
    for where in folders:
        moved = len(driver.launches)
        found = invoke(*command, *where, "--device", "cuda")
        assert found.exit_code in (0, 4, 5), found.output
        assert len(driver.launches) > moved
    moved = len(driver.launches)
    assert invoke(*command).exit_code in (0, 4, 5)
    assert len(driver.launches) == moved


@pytest.mark.parametrize(
    "word, code, rule",
    [
        ("gpu", 3, "device = 'gpu': expected cpu, cuda, cuda:NUMBER or auto"),
        ("cuda:1", 74, "cuda:1: the devices are cuda:0 to cuda:0; nothing was written"),
    ],
)
def test_a_wrong_device_is_one_message(word, code, rule, fake, tmp_path):
    fake()
    found = invoke("run dzhanibekov --device", word, "-o", tmp_path / "a.nc")
    assert found.exit_code == code and rule in found.output and "Traceback" not in found.output
    assert not list(tmp_path.iterdir())


def test_a_device_that_is_lost_leaves_a_run_that_goes_on(fake, tmp_path):
    scene = tmp_path / "tops.toml"
    scene.write_text(SCENE.dumps())
    words = ("run", scene, "--members", 9000, "--shard-size", 0.001, "-o", f"{tmp_path}/run/")
    fake(fail_at=3)
    found = invoke(*words, "--device", "cuda", "--threads", 1)
    assert found.exit_code == 74 and "CUDA_ERROR_LAUNCH_FAILED" in found.output
    assert invoke("resume", tmp_path / "run").exit_code == 0
    with rm.open(tmp_path / "run") as ds:
        alone = rm.simulate(SCENE, members=9000)
        assert ds.momentum.values.tobytes() == alone.momentum.values.tobytes()


def test_a_run_on_a_device_goes_on_on_the_processor_from_where_it_was_cut(
    fake, tmp_path, monkeypatch
):
    """The state of a block is brought from the device when it is kept."""
    fake()
    monkeypatch.setattr(checkpoints, "EVERY", 0.0)
    monkeypatch.setattr(checkpoints, "COSTS", 0.0)
    monkeypatch.setattr(os, "fsync", lambda file: None)
    monkeypatch.setattr(cuda, "GROWTH", 1.0)  # of 16 steps is each launch
    keep, copies = checkpoints.Checkpoints.keep, []

    def copying(this, job):
        keep(this, job)
        copies.append(tmp_path / f"cut{len(copies)}")
        shutil.copytree(tmp_path / "run", copies[-1])

    monkeypatch.setattr(checkpoints.Checkpoints, "keep", copying)
    create(SCENE, tmp_path / "run", 1e3)
    resume(tmp_path / "run", threads=1, device="cuda")
    assert len(copies) >= 2
    alone = rm.simulate(SCENE)
    monkeypatch.setattr(checkpoints.Checkpoints, "keep", keep)
    for path in ("run", *(copy.name for copy in copies[:4])):
        resume(tmp_path / path)
        with rm.open(tmp_path / path) as ds:
            assert ds.momentum.values.tobytes() == alone.momentum.values.tobytes(), path


def test_a_cluster_moves_members_on_devices(fake, tmp_path, monkeypatch):
    """What a worker is asked names the device."""
    driver = fake()
    create(SCENE, tmp_path / "run", 1e3)
    texts = tuple(content_of(str(tmp_path / "run"), name) for name in cluster.FILES)
    how = cluster.Resume(device="cuda")
    done = cluster.shard(0, str(tmp_path / "run"), texts, how)
    assert driver.launches and sum(done.flagged.values()) == 70


def test_blocks_fill_devices_and_no_memory(fake):
    """Few members are one block for each device; many saves make blocks small, shards are one."""
    fake(devices=2)
    scene = SCENE.with_run(save=("omega", "flips"))
    few = prepare_scene(scene.with_run(members=1000))
    many = prepare_scene(scene.with_run(members=10**7))
    wide = prepare_scene(scene.with_run(members=10**7, every=0.02))
    blocks = [block_of(one, 16, "cuda", False) for one in (few, many)]
    block = block_of(wide, 16, "cuda", True)
    assert blocks == [512, 156_256] and movers(16, "cuda") == 2
    saved = block * wide.layout.numbers * 8
    assert 0.98 * resources.DEVICE_SLAB < saved <= resources.DEVICE_SLAB
    assert block_of_shard(many.layout, 137 * 4064) == 137 * 4064  # which has no large divisor
    assert block_of_shard(wide.layout, 137 * 4064) <= block
    assert moved_at_once(few.members.size, 16, "cuda") == resources.WAVE
    assert moved_at_once(many.members.size, 16, "cuda") == 5e6

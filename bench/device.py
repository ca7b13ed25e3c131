"""GPUs: their bits, their speed, whole runs, and CUDA C and JAX on the same card.

Without a GPU there are no rows. `python -m bench gpu` inspects the code that runs there.
"""

import contextlib
import os
import re
import tempfile
import time
from functools import cached_property
from unittest import mock

import numpy as np

import rigidmc as rm
from bench import harness
from bench.device_peers import peers
from bench.gpu import scenes
from rigidmc.engine.cuda import program as cuda
from rigidmc.engine.cuda.devices import THREADS, _library, call_driver, devices
from rigidmc.engine.inspection import step_operations
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import StepRange
from rigidmc.engine.program import NO_NOISE, NO_SAVES
from rigidmc.physics.integrators import integrators_for
from rigidmc.runs.assemble import make_program
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.resume import resume
from rigidmc.runs.prepare import prepare_scene
from rigidmc.studies import bits

WORD = "cuda:0"
INTEGRATORS = "rk4", "rk8", "strang", "exact"
# {moving: (its motion, saved observables)}; momentum alone unless an attitude is needed
MOVING = {
    "free, momentum alone": ("free", ("energy",)),
    "free, momentum alone, flips monitored": ("free", ("energy", rm.Flips(2))),
    "free": ("free", ("energy", "attitude")),
    "heavy": ("heavy", ("energy",)),
    "heavy, a passage monitored": ("heavy", ("energy", rm.Passage(3, 0.6, "leaves"))),
}
MEMBERS = 2**17, 2**19, 2**21
TILE = 2**14  # members that are drawn; a block repeats them
LAUNCHES = 10, 50, 200  # [ms]
ENDLESS = 2**40  # steps: more than are ever made
# No steps, and the kernels of srkn6 and aba1064
LEFT_OUT = "closed", "suzuki4", "srkn11", "aba864"
LIMITS = None, 128, 80  # largest number of registers of a thread
ENTRY = re.compile(r"(\.visible \.entry members\([^)]*\))")


class Steps:
    """The steps of members on a GPU, and the numbers of their block, ready to be timed.

    what : a key of MOVING;  limit : largest number of registers of a thread, None for no limit
    wrt : parameters of derivatives;  at_once : derivatives in a pass
    """

    def __init__(self, what, integrator, limit=None, wrt=(), at_once=1):
        motion, save = MOVING[what]
        self.labels = {"what": what, "integrator": integrator}
        scene = bits.plain_steps(motion).with_run(integrator=integrator, save=save, wrt=wrt)
        self._run = run = prepare_scene(scene)
        plan = run.plan
        passes = plan.derivatives._replace(at_once=at_once, passes=len(wrt) // at_once)
        self.program = make_program(plan, WORD, derivatives=passes if wrt else None)
        self.program.code = limited(self.program.code, limit)  # for this run alone, not loaded
        self.operations = step_operations(plan.scheme, plan.model.effects, plan.has_attitude).all
        self.module = self.program._stream().module

    @cached_property
    def _tile(self):
        block, _ = self._run.initial(0, TILE)
        block[layout.STEPS] = 1.0
        return block

    def speed(self, members, enough):
        """Measure member-steps per second on the GPU, over at least `enough` s.

        The clock runs from launch to launch, once launches last at least half their limit. Copies
        to the GPU and back, and the first short launches, are not timed.
        """
        block = np.tile(self._tile, (1, -(-members // TILE)))[:, :members]
        random = NO_NOISE._replace(members=np.arange(members))
        order, dt = NO_SAVES._replace(order=np.arange(members)), self._run.plan.grid.dt
        frame = StepRange(dt, 1, ENDLESS, ENDLESS, 0, 0, ENDLESS)
        first, began, before = 0, None, None
        for step in self.program.through(block, frame, random, order):
            now = time.perf_counter()
            if began is not None and now - began >= enough:
                return members * (step - first) / (now - began)
            if began is None and before is not None and now - before >= 0.5 * cuda.LAUNCH:
                began, first = now, step
            before = now
        raise AssertionError("endless steps have ended")

    def facts(self):
        """Return {name: number} of the code, as the driver reports it."""
        told = {"registers": "NUM_REGS", "local": "LOCAL_SIZE_BYTES"}
        kind, name = _library().CUfunction_attribute, "CU_FUNC_ATTRIBUTE_"
        with self.module.entered():
            found = {
                word: int(
                    call_driver("cuFuncGetAttribute", getattr(kind, name + one), self.module.kernel)
                )
                for word, one in told.items()
            }
        return {**found, "threads": self.module.threads, "resident": self.module.resident}

    def take_blocks(self, threads):
        """Set the number of threads in a block of PTX from here on."""
        function = "cuOccupancyMaxActiveBlocksPerMultiprocessor"
        with self.module.entered():
            blocks = int(call_driver(function, self.module.kernel, threads, 0))
        self.module.threads, self.module.resident = threads, blocks * threads


def limited(text, limit):
    """Limit the registers of a PTX kernel; `ptxas` applies the limit to the functions it calls."""
    if limit is None:
        return text
    made, many = ENTRY.subn(rf"\1\n.maxnreg {limit}", text)
    assert many == 1
    return made


def same_bits(quick):
    """Return the rows of all cases: whether the bits of GPU and CPU agree."""
    some = bits.cases(("rk4",), ("free",)) if quick else bits.cases()
    with mock.patch.object(bits, "cases", lambda: some):
        rows = [
            {"kind": "bits", "case": name, "same": same}
            for name, same in bits.compare_devices(WORD)
        ]
    right = sum(row["same"] for row in rows)
    return [*rows, harness.target("cases with the bits of the processor", len(rows), right)]


def same_derivatives(quick):
    """Return the rows of all cases with derivatives: whether GPU and CPU agree in all variables."""
    rows = []
    for case in bits.cases(("rk4",), ("free",)) if quick else bits.cases():
        scene = bits.with_derivatives(case)
        here, there = (rm.simulate(scene, checks=False, device=one) for one in ("cpu", WORD))
        values = [(here[name].values, there[name].values) for name in here.data_vars]
        same = all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in values)
        rows.append({"kind": "bits of derivatives", "case": case.name, "same": same})
    right, what = sum(row["same"] for row in rows), "cases whose derivatives have these bits"
    return [*rows, harness.target(what, len(rows), right)]


def derivatives(quick):
    """Return the rows of the cost of derivatives, in plain steps on the same GPU."""
    rows, members, enough = [], TILE if quick else 2**19, 0.01 if quick else 0.3
    parameters = "body.moments.1", "body.moments.2.mean", "body.moments.3"
    names = integrators_for(bits.plain_steps("heavy").effects)
    moving = [("free", "exact"), *(("heavy", name) for name in names if name not in LEFT_OUT)]
    for what, name in moving[1:2] if quick else moving:
        plain = Steps(what, name).speed(members, enough)
        fewer = ((1, 1), (2, 2)) if name in INTEGRATORS and not quick else ()
        for count, at_once in (*fewer, (3, 3), (3, 1)):
            steps = Steps(what, name, None, parameters[:count], at_once)
            speed = steps.speed(members, enough)
            rows.append({"kind": "derivatives", **steps.labels, "count": count, "at_once": at_once,
                         "members": members, "speed": speed, "ratio": plain / speed,
                         **steps.facts()})  # fmt: skip
    return rows


def speeds(quick, peak):
    """Return the rows of steps per second, by motion, integrator and members at once."""
    rows, enough = [], 0.01 if quick else 0.3
    for what in list(MOVING)[: 1 if quick else None]:
        allowed = integrators_for(bits.plain_steps(MOVING[what][0]).effects)
        names = [name for name in INTEGRATORS if name in allowed]
        for name in names[: 1 if quick else None]:
            steps = Steps(what, name)
            for members in (TILE,) if quick else MEMBERS:
                speed = steps.speed(members, enough)
                share = speed * steps.operations / peak
                rows.append({"kind": "speed", **steps.labels, "members": members, "speed": speed,
                             "operations": steps.operations, "share": share,
                             **steps.facts()})  # fmt: skip
    return rows


def launches(quick):
    """Return the rows of steps per second, by the duration of a launch."""
    rows, members = [], TILE if quick else 2**19
    for what, name in (("heavy", "rk4"), ("free, momentum alone", "exact"))[: 0 if quick else None]:
        steps = Steps(what, name)
        for long in LAUNCHES:
            with mock.patch.object(cuda, "LAUNCH", long / 1e3):
                speed = steps.speed(members, 0.8)
            rows.append({"kind": "launch", **steps.labels, "milliseconds": long,
                         "members": members, "speed": speed})  # fmt: skip
    return rows


def blocks(quick):
    """Return the rows of steps per second, by threads of a block and registers of a thread."""
    rows, members, enough = [], TILE if quick else 2**20, 0.01 if quick else 0.15
    for what in ("free, momentum alone", "heavy")[: 1 if quick else None]:
        for limit in LIMITS[: 1 if quick else None]:
            steps = Steps(what, "rk4", limit)
            for threads in sorted(THREADS)[: 1 if quick else None]:
                steps.take_blocks(threads)
                speed = steps.speed(members, enough)
                rows.append({"kind": "block", **steps.labels, "limit": limit,
                             "members": members, "speed": speed, **steps.facts()})  # fmt: skip
    return rows


def whole(what, members, run):
    """Return the row of a run from the call to its result, with its bytes if it is in memory."""
    began = time.perf_counter()
    result = run()
    took = time.perf_counter() - began
    row = {"kind": "whole", "what": what, "members": members, "seconds": took}
    return {**row, "bytes": result.nbytes} if result is not None else row


def whole_runs(quick):
    """Return the rows of whole runs; the first run loads the code."""
    many, large, huge = (2**12, 2**12, 2**14) if quick else (2**20, 10**7, 10**8)
    free = scenes(True)["nothing"].with_run(integrator="rk4", t_end=10.0)
    heavy = bits.plain_steps("heavy").with_run(integrator="rk4", checks=False, t_end=10.0)
    nine = free.with_run(members=many, every=0.1, save=("omega", "attitude", "energy", "l2"))
    last = heavy.with_run(every=10.0, save=("attitude",), keep="final")

    def written():
        scene = last.with_run(members=huge)
        with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
            resume(create(scene, os.path.join(folder, "run"), device=WORD), device=WORD)

    def here(scene):
        return lambda: rm.simulate(scene, device=WORD)

    saves = "free, 1,000 steps, 100 saves of 9 values, in memory"
    ends = "heavy, 1,000 steps, the last attitude"
    return [
        whole(f"{saves}, with loading", many, here(nine)),
        whole(saves, many, here(nine)),
        whole(f"{ends}, in memory", large, here(last.with_run(members=large))),
        whole(f"{ends}, in memory", huge, here(last.with_run(members=huge))),
        whole(f"{ends}, to a run directory", huge, written),
    ]


def driver():
    """Return the version of NVIDIA's driver, None where Linux does not report it."""
    with contextlib.suppress(OSError), open("/proc/driver/nvidia/version") as file:
        if found := re.search(r"Kernel Module.*?\s(\d+\.[\d.]+)\s", file.read()):
            return found[1]
    return None


def card(one):
    """Return the row of a GPU."""
    version = "{}.{}".format(*one.driver)
    capability = "{}.{}".format(*one.capability)
    return {"kind": "card", "name": one.name, "capability": capability, "driver": driver(),
            "cuda": version, "multiprocessors": one.processors, "clock": one.clock,
            "peak": one.peak}  # fmt: skip


def run(quick):
    """Return all rows of the bench, [] without a GPU."""
    try:
        first = devices()[0]
    except rm.NoDevice as none:
        print(none)
        return []
    return [
        card(first),
        *same_bits(quick),
        *same_derivatives(quick),
        *speeds(quick, first.peak),
        *derivatives(quick),
        *launches(quick),
        *blocks(quick),
        *whole_runs(quick),
        *peers(quick),
    ]


def report(rows):
    kinds = {}
    for row in rows:
        kinds.setdefault(row["kind"], []).append(row)
    for row in kinds.get("card", ()):
        print(f"{row['name']}, {row['multiprocessors']} multiprocessors, driver {row['driver']}")
    labels, facts = ("what", "integrator", "members"), ("registers", "local", "threads", "resident")
    ratios = "share", "ratio"
    for kind, title, more in (
        ("speed", "steps a second; share of the peak in float64", ("share", *facts)),
        ("launch", "steps a second by the time of a launch", ("milliseconds",)),
        ("block", "steps a second by threads and registers", ("limit", *facts)),
        ("derivatives", "steps a second with derivatives", ("count", "at_once", "ratio", *facts)),
    ):
        if some := kinds.get(kind):
            head = [*labels, "G steps/s", *more]
            harness.table(title, head, [
                [*(row[word] for word in labels), f"{row['speed'] / 1e9:.2f}",
                 *(round(row[word], 2) if word in ratios else row[word] for word in more)]
                for row in some
            ])  # fmt: skip
    if some := kinds.get("whole"):
        lines = [
            [row["what"], f"{row['members']:,}", f"{row['seconds']:.1f}",
             f"{row['bytes'] / row['seconds'] / 1e9:.1f}" if "bytes" in row else ""]
            for row in some
        ]  # fmt: skip
        harness.table("whole runs", ["", "members", "s", "GB/s"], lines)
    if some := kinds.get("peer"):
        lines = [
            [row["name"], f"{row['members']:,}", f"{row['speed'] / 1e9:.2f}",
             f"{row['error']:.1e}" if "error" in row else "not compared"]
            for row in some
        ]  # fmt: skip
        harness.table("others: rk4", ["", "members", "G steps/s", "other than rigidmc"], lines)
    harness.report_targets(rows)

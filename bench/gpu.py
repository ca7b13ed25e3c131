"""The GPU code of every integrator, and the device resources that it uses.

The package compiles the code as for a GPU, `ptxas` assembles it and `nvdisasm` reads it, if they
are installed (packages nvidia-cuda-nvcc-cu12 and nvidia-cuda-nvdisasm). Nothing is run:
`python -m bench device` measures runs.
"""

import glob
import os
import re
import shutil
import subprocess
import sysconfig
import tempfile
import time
from collections import Counter
from typing import NamedTuple
from unittest import mock

import rigidmc as rm
from bench import harness
from rigidmc.engine.cuda import program as cuda
from rigidmc.engine.cuda.devices import Device
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import is_random
from rigidmc.physics.integrators import integrators_for
from rigidmc.protocols import cross, effect, into_body, scale
from rigidmc.runs.assemble import make_program
from rigidmc.runs.prepare import prepare_scene

CAPABILITIES = (8, 0), (9, 0)
ROUNDED = re.compile(r"^\s+(fma|add|sub|mul|div|rcp|sqrt)((?:\.\w+)*)\.f(?:64|32)\s", re.M)
APPROXIMATE = re.compile(r"\.(approx|ftz|full)\b|\.contract|\b(ex2|lg2|sin|cos|tanh|rsqrt)\.")
NO_SPILL = "rk4", "rk8", "strang", "exact"
TOLD = "registers", "local", "spills", "spills in steps"
NOBODY = Device(0, "no device", (9, 0), 132, 1.98e9, 2**37, (13, 0))


@effect(units={"stiffness": "N m"})
class TorsionSpring(NamedTuple):
    """A custom effect."""

    stiffness: float

    def torque(self, q):
        return scale(self.stiffness, cross((1.0, 0.0, 0.0), into_body(q, (1.0, 0.0, 0.0))))


def scenes(quick):
    """Return {acting effects: scene}, with events and statistics."""
    body = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
    start = rm.Start(omega=(0.1, 0.2, 5.0), attitude=(1.0, 0.0, 0.0, 0.0))
    every = tuple(kind(*kind.example) for kind in EFFECTS.values() if not is_random(kind))
    acting = {
        "nothing": (),
        "gravity": (rm.Gravity(9.81),),
        "all effects": every,
        "bath": (rm.Gravity(9.81), rm.Bath(0.5, 1.0)),
        "custom effect": (TorsionSpring(1.0),),
    }
    for word in ("all effects",) if quick else ():
        del acting[word]
    run = {"dt": 0.01, "t_end": 1.0, "every": 0.5, "checks": False}
    bodies = {"all effects": body.with_pivot_at_centre()}  # as bodies on an orbit require
    return {
        word: rm.Scene(bodies.get(word, body), effects, start).with_run(**run)
        for word, effects in acting.items()
    }


def tool(name):
    """Return the path of `ptxas` or `nvdisasm`, None if it is missing."""
    pattern = os.path.join(sysconfig.get_paths()["purelib"], "nvidia", "*", "bin", name)
    return next(iter(glob.glob(pattern)), shutil.which(name))


def march_of(text):
    """Return the PTX of the steps."""
    body = text[text.rindex(".func march") :]
    return body[: body.index("\n}")]


def sass_of(cubin):
    """Count {float64 instruction: number} of the steps in machine code; {} without `nvdisasm`."""
    if (reader := tool("nvdisasm")) is None:
        return {}
    text = subprocess.run([reader, cubin], capture_output=True, text=True, check=True).stdout
    body = text[text.index("$members$march:") :].partition(".type")[0]
    return dict(Counter(re.findall(r"\b(DFMA|DMUL|DADD|MUFU\.\w+)\b", body)))


def assembled(text, capability):
    """Return {name: bytes, registers, instructions} from assembling PTX; {} without an
    assembler."""
    if (assembler := tool("ptxas")) is None:
        return {}
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
        source = os.path.join(folder, "members.ptx")
        with open(source, "w", encoding="ascii") as file:
            file.write(text)
        target = "-arch=sm_{}{}".format(*capability)
        cubin = os.path.join(folder, "members.cubin")
        told = subprocess.run(
            [assembler, target, "-v", source, "-o", cubin],
            capture_output=True, text=True, check=True,
        ).stderr  # fmt: skip
        sass = sass_of(cubin)
    entry = re.search(r"properties for members\n\s*(\d+) bytes stack frame, (\d+) \D+(\d+)", told)
    steps = re.search(r"properties for march\n\s*\d+ \D+(\d+) bytes spill stores, (\d+)", told)
    return {
        "registers": int(re.search(r"Used (\d+) registers", told)[1]),
        "local": int(entry[1]),
        "spills": int(entry[2]) + int(entry[3]),
        "spills in steps": int(steps[1]) + int(steps[2]),
        "sass": sass,
    }


def inspected(what, name, scene, watched, capability, wrt=()):
    """Return the row of a kernel; wrt : parameters of its derivatives."""
    scene = scene.with_run(integrator=name, save=("omega", "attitude", *watched), wrt=wrt)
    with mock.patch.object(cuda, "select_devices", lambda number: (NOBODY,)):
        program = make_program(prepare_scene(scene).plan, "cuda", compiled=False)
        began = time.perf_counter()
        text = program.code_for("{}.{}".format(*capability))
    counts = Counter(kind for kind, _ in ROUNDED.findall(text))
    return {
        "kind": "ptx",
        "integrator": name,
        "acting": what,
        "watched": bool(watched),
        "capability": "sm_{}{}".format(*capability),
        "derivatives": len(wrt),
        "seconds": time.perf_counter() - began,
        "fma": counts["fma"],
        "add and mul": counts["add"] + counts["sub"] + counts["mul"],
        "div": counts["div"] + counts["rcp"],
        "sqrt": counts["sqrt"],
        "approximate": len(APPROXIMATE.findall(text)),
        "steps": dict(Counter(kind for kind, _ in ROUNDED.findall(march_of(text)))),
        "modes": sorted({mode for _, mode in ROUNDED.findall(text)}),
        **assembled(text, capability),
    }


def run(quick):
    rows = []
    for what, scene in scenes(quick).items():
        for name in integrators_for(scene.effects):
            if name == "closed" or (quick and name not in NO_SPILL):
                continue
            for watched in ((), ("flips", "omega_max")):
                for capability in CAPABILITIES:
                    rows.append(inspected(what, name, scene, watched, capability))
    plain = [row for row in rows if row["integrator"] in NO_SPILL and not row["watched"]]
    few = [row for row in plain if row["acting"] in ("nothing", "gravity", "custom effect")]
    inexact = sum(row["approximate"] > 0 or row["modes"] != [".rn"] for row in rows)
    targets = [harness.at_most("kernels with an approximate instruction", 0, inexact)]
    if tool("ptxas"):
        what = "kernels of rk4, rk8, strang, exact that spill: free, heavy, with a custom effect"
        targets.append(harness.at_most(what, 0, sum(row["spills"] > 0 for row in few)))
        what = "kernels that spill in their steps, all effects at once apart"
        others = [row for row in rows if row["acting"] != "all effects"]
        targets.append(harness.at_most(what, 0, sum(r["spills in steps"] > 0 for r in others)))
    return [*rows, *targets]


def report(rows):
    blank = dict.fromkeys(TOLD, "")
    found = [blank | r for r in harness.of_kind(rows, "ptx") if r["capability"] == "sm_90"]
    harness.show(
        "code for devices of compute capability 9.0",
        found,
        "integrator {integrator} | acting {acting} | events {events} | fma {fma}"
        " | add, mul {add and mul} | div {div} | sqrt {sqrt} | registers {registers}"
        " | local [B] {local} | spills [B] {spills} | in steps [B] {spills in steps}"
        " | s {seconds:.1f}",
        events=lambda row: "yes" if row["watched"] else "",
    )
    harness.show(
        "machine code of the steps: compute capability 9.0, with divisions and roots written out",
        [row for row in found if row.get("sass") and not row["watched"]],
        "integrator {integrator} | acting {acting} | PTX: fma {steps[fma]} | add, mul {sums}"
        " | SASS: DFMA {DFMA} | DMUL {DMUL} | DADD {DADD}",
        sums=lambda row: sum(row["steps"].get(kind, 0) for kind in ("add", "sub", "mul")),
        DFMA=lambda row: row["sass"].get("DFMA", 0),
        DMUL=lambda row: row["sass"].get("DMUL", 0),
        DADD=lambda row: row["sass"].get("DADD", 0),
    )
    harness.report_targets(rows)

"""What a live page computes with: the run of its members, and their code in WebAssembly."""

import base64
import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import StepRange, record_type
from rigidmc.engine.wasm.fused import EXACT, LANES, ONE, RELAXED
from rigidmc.engine.wasm.program import STACK, WasmProgram
from rigidmc.errors import OptionError
from rigidmc.planning.initial import noise_keys
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.scene.scene import Scene

SAVED = ("attitude", "momentum", "energy_drift", "l2_drift")  # the order in which the page reads
PLACES = 3  # saves: at the start, after a call, and before the first of a call
Floats = NDArray[np.float64]


class LiveRun(NamedTuple):
    """A run whose steps a page makes.

    run : prepared, with a fixed step;  block : its members (rows, width)
    start : the numbers they are built from
    """

    run: PreparedRun
    block: Floats
    start: dict[str, Floats]


def live_run(scene: Scene, members: int) -> LiveRun:
    """Prepare a run of the first members of a scene, with a fixed step and without limits."""
    chosen: dict[str, Any] = {"save": SAVED, "members": members, "checks": False, "wrt": ()}
    if scene.run.integrator == "closed":
        chosen["integrator"] = "rk8"
    if scene.run.dtype != "float64":
        raise OptionError("live pages compute in float64", at="run.dtype", value=scene.run.dtype)
    run = prepare_scene(scene.with_run(**chosen))
    block, start = run.initial(0, members)
    if run.plan.has_member_steps:  # the step of the member with the most
        step = float(run.plan.grid.dt / block[layout.STEPS].max())
        fixed = {"integrator": run.scene.run.integrator, "dt": step, "turn": None}
        run = prepare_scene(run.scene.with_run(**fixed))
        block, start = run.initial(0, members)
    if run.units is not None:
        rule = "this body needs scaled units, in which a page cannot move numbers"
        raise OptionError(rule, at="live")
    return LiveRun(run, block, start)


def engine_data(live: LiveRun, members: int) -> dict[str, Any]:
    """Return the engine of a page: two modules, their memory, and where things are in it."""
    from rigidmc.runs.assemble import make_program

    run, block = live.run, live.block
    program = make_program(run.plan, "wasm", compiled=False)
    assert isinstance(program, WasmProgram)  # scenes with closed forms were given an integrator
    indices = np.arange(block.shape[1])
    noise = noise_keys(run.plan.model.effects, run.plan.run.seed, run.plan.indices(0, indices.size))
    steps = StepRange(run.plan.grid.dt, 1, 1, 1, 0, 0, 1)
    image = program.image(block, steps, noise, PLACES, indices)
    kind = record_type(program.dtype)
    fields: Any = kind.fields
    names = ("h", "slots", "stride", "total", "first", "last", "out")
    return {
        "fast": packed(program.module_of(RELAXED)),
        "exact": packed(program.module_of(EXACT)),
        "image": packed(image.content[STACK:]),
        "fuses": ONE,
        "stack": STACK,
        "frame": image.frame,
        "block": image.block,
        "out": image.out,
        "width": block.shape[1],
        "members": members,
        "lanes": LANES,
        "values": program.saved_values,
        "status": layout.STATUS,
        "rows": {
            "attitude": layout.ATTITUDE,
            "momentum": layout.MOMENTUM,
            "body": layout.BODY,
        },
        "fields": {name: (fields[name][1], fields[name][0].str[1:]) for name in names},
    }


def packed(content: bytes) -> str:
    """Return bytes compressed, as text."""
    return base64.b64encode(zlib.compress(content, 9)).decode()


def doubles(values: Any) -> str:
    """Return float64 numbers as text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()

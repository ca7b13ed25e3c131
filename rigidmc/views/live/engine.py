"""What a live page computes with: the run of its members, and their code in WebAssembly."""

import base64
import zlib
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import StepRange, record_type
from rigidmc.engine.wasm.fused import EXACT, LANES, ONE, RELAXED
from rigidmc.engine.wasm.program import STACK, WasmProgram
from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.integrators import TurnBounds, scheme_of
from rigidmc.planning.initial import noise_keys
from rigidmc.planning.plan import Plan
from rigidmc.planning.steps import make_time_grid
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.settled import with_settings
from rigidmc.scene.scene import Scene

# the order in which the page reads
SAVED = ("attitude", "momentum", "energy_drift", "l2_drift", "energy")
PLACES = 3  # saves: at the start, after a call, and before the first of a call
# a faster start halves the step until a step turns no farther than this times the scene's own step,
# or 0.1 rad
SLACK, LEAST_TURN = 1.3, 0.1
SMOOTH_TURN = 0.2  # of a step [rad], if a tolerance chooses it: of 2 rad the charts are polygons


class LiveRun(NamedTuple):
    """A run whose steps a page makes.

    run : prepared, with a fixed step;  block : its members (rows, width)
    start : the numbers they are built from
    """

    run: PreparedRun
    block: Array
    start: dict[str, Array]


def live_run(scene: Scene, members: int) -> LiveRun:
    """Prepare a run of the first members of a scene, with a fixed step and without limits."""
    chosen: dict[str, Any] = {"save": SAVED, "checks": False, "wrt": ()}
    if scene.run.integrator == "closed":
        chosen["integrator"] = "rk8"
    if scene.run.dtype != "float64":
        raise OptionError("live pages compute in float64", at="run.dtype", value=scene.run.dtype)
    first = scene.run.first
    run = prepare_scene(with_settings(scene, range(first, first + members), chosen))
    block, start = run.initial(first, members)
    omega = block[layout.MOMENTUM : layout.EXTRA, :members] / start["moments"][:, :members]
    rate = np.linalg.norm(omega, axis=0).max()
    if run.plan.scheme is None:  # the tolerance chose the closed form
        dt = min(run.plan.grid.dt, SMOOTH_TURN / rate) if rate > 0.0 else run.plan.grid.dt
        chosen |= {"integrator": "rk8", "tolerance": None, "dt": float(dt)}
        run = prepare_scene(with_settings(scene, range(first, first + members), chosen))
        block, start = run.initial(first, members)
    turn = rate * run.plan.grid.dt
    if scene.run.tolerance is not None and turn > SMOOTH_TURN:
        chosen["every"] = float(run.plan.grid.dt / np.ceil(turn / SMOOTH_TURN))
        run = prepare_scene(with_settings(scene, range(first, first + members), chosen))
        block, start = run.initial(first, members)
    if run.plan.has_member_steps:  # the step of the member with the most
        step = float(run.plan.grid.dt / block[layout.STEPS].max())
        fixed = {"integrator": run.scene.run.integrator, "dt": step, "turn": None}
        run = prepare_scene(run.scene.with_run(**fixed))
        block, start = run.initial(first, members)
    if run.plan.has_cuts:
        raise OptionError("the steps of a page do not end at switching times", at="live")
    if run.units is not None:
        rule = "this body needs scaled units, in which a page cannot move numbers"
        raise OptionError(rule, at="live")
    return LiveRun(run, block, start)


def even_end(run: PreparedRun) -> float:
    """Return an end time that a scene file with the step of a page reaches by steps of this very
    length, or of a half, a quarter, ... of it: of a last interval that is shorter, none is left."""
    grid, settings = run.plan.grid, run.scene.run
    if not grid.is_shortened:
        return settings.t_end
    assert isinstance(settings.every, float)
    for intervals in count(grid.head // grid.stride):
        end = intervals * settings.every
        # the product may be rounded so that its parts are no such steps
        if make_time_grid(end, grid.dt, settings.every).dt == grid.dt:
            break
    return end


def moved_plans(live: LiveRun) -> dict[str, Plan]:
    """Return the plan of a page's run, "own", and its plans for starts that sliders have moved.

    The schemes of some integrators hold for bodies with two equal moments alone, or up to a rate of
    free motion. "unequal" and "equal" hold for all starts whose steps a page makes.
    """
    plan = live.run.plan
    if plan.turn_rate is None:
        return {"own": plan}
    inverse, l = live.block[layout.BODY : layout.BODY + 3], live.block[layout.MOMENTUM :][:3]
    fastest = float((inverse.max(0) * np.sqrt((l**2).sum(0))).max())
    # a page makes steps of at most this turn (live.js); torques may double the rate
    rate = max(plan.turn_rate, SLACK * max(LEAST_TURN / plan.grid.dt, fastest)) * 2.0
    plans = {"own": plan}
    for name, is_symmetric in (("unequal", False), ("equal", True)):
        turns = TurnBounds(rate * plan.grid.dt, plan.angle, is_symmetric)
        scheme = scheme_of(plan.kind, turns, plan.model.effects)._replace(name=plan.run.integrator)
        plans[name] = plan._replace(scheme=scheme, turn_rate=rate)
    return plans


def engine_data(live: LiveRun, members: int) -> dict[str, Any]:
    """Return the engine of a page: for each form of its integrator two modules, their memory, and
    where things are in it."""
    variants, keys, places = list[dict[str, Any]](), list[Any](), dict[str, int]()
    plans = moved_plans(live)
    for name, plan in plans.items():
        assert plan.scheme is not None  # scenes with closed forms were given an integrator
        key = repr(plan.scheme.integrator), plan.scheme.substeps.tobytes()
        if key not in keys:
            keys.append(key)
            variants.append(_variant(live, plan))
        places[name] = keys.index(key)
    kind = record_type(np.dtype(float))
    fields: Any = kind.fields
    names = ("h", "slots", "stride", "total", "first", "last", "out")
    return {
        "variants": variants,
        "forms": places,
        "turn_rates": {name: plan.turn_rate for name, plan in plans.items()},
        "slack": SLACK,
        "least_turn": LEAST_TURN,
        "fuses": ONE,
        "stack": STACK,
        "width": live.block.shape[1],
        "members": members,
        "lanes": LANES,
        "values": live.run.layout.values,
        "status": layout.STATUS,
        "rows": {"attitude": layout.ATTITUDE, "momentum": layout.MOMENTUM, "body": layout.BODY},
        "fields": {name: (fields[name][1], fields[name][0].str[1:]) for name in names},
    }


def _variant(live: LiveRun, plan: Plan) -> dict[str, Any]:
    """Return the modules of a form of the integrator, and their memory; a page fills the block."""
    from rigidmc.runs.assemble import make_program

    program = make_program(plan, "wasm", compiled=False)
    assert isinstance(program, WasmProgram)
    indices = np.arange(live.block.shape[1])
    noise = noise_keys(
        plan.model.effects,
        plan.run.seed,
        live.run.members.indices(live.run.members.first, indices.size),
    )
    steps = StepRange(plan.grid.dt, 1, 1, 1, 0, 0, 1)
    image = program.image(np.zeros_like(live.block), steps, noise, PLACES, indices)
    return {
        "fast": packed(program.module_of(RELAXED)),
        "exact": packed(program.module_of(EXACT)),
        "image": packed(image.content[STACK:]),
        "frame": image.frame,
        "block": image.block,
        "out": image.out,
    }


def packed(content: bytes) -> str:
    """Return bytes compressed, as text."""
    return base64.b64encode(zlib.compress(content, 9)).decode()


def doubles(values: Any) -> str:
    """Return float64 numbers as text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()

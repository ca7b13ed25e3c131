"""The cost of a run or a study, predicted before its first step from timings of its first members
on this machine."""

import itertools
import math
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rigidmc.engine.cuda.devices import is_gpu, resolve_device
from rigidmc.engine.inspection import step_operations, torque_operations
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import StepRange
from rigidmc.engine.kernel.layout import LANES
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program import NO_SAVES
from rigidmc.engine.program_spec import NO_DERIVATIVES
from rigidmc.files.outputs import Path, folder_beside
from rigidmc.inputs.amounts import count_text, two_digits
from rigidmc.physics.effects import EFFECTS, label_effects
from rigidmc.physics.effects.protocol import from_numbers, is_random, user_parameters
from rigidmc.physics.integrators import integrators_for
from rigidmc.physics.integrators.splitting import Langevin, ScoredLangevin
from rigidmc.physics.observables.flips import Flips
from rigidmc.physics.observables.passage import Passage
from rigidmc.planning.monitors import Monitors, places_of
from rigidmc.planning.tolerance.costs import Costs
from rigidmc.planning.tolerance.pilot import pilot
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.resources import DEVICE_BLOCK, WAVE, block_of, in_words, moved_at_once, needs
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.user_parts.registry import origin_of
from rigidmc.scene.vector_distributions import Cone

LAUNCHED = 0.2  # seconds of launches that are long compared with the first, shorter ones


def cost_per_step(
    run: PreparedRun, device: str = "cpu", members: int = 256, seconds: float = 0.05
) -> float:
    """Measure the time per member-step [ns] on one thread, on the first members of a run.

    On GPUs: the time on one GPU, with as many members as a block has, without copying them.
    """
    program, plan = run.program(device), run.plan
    assert program is not None, "closed forms make no steps"
    on_device, rounds = is_gpu(device), int(plan.has_member_steps)
    members = DEVICE_BLOCK if on_device else members
    noise = plan.noise(run.members.indices(run.members.first, members))
    staged, _ = run.initial(run.members.first, members)
    staged[layout.STEPS] = 1.0
    order = NO_SAVES._replace(order=np.arange(staged.shape[1]))

    def timed(steps: int) -> float:
        block = staged.copy()
        if rounds:
            block[layout.STEPS] = steps
        began = time.perf_counter()
        frame = StepRange(plan.grid.dt, steps if rounds else 1, steps, steps, rounds, 0, steps)
        program.advance(block, frame, noise, order)
        return time.perf_counter() - began

    best, steps = math.inf, 16
    if on_device:
        timed(steps)  # the driver compiles the code at its first launch, for seconds
        while (took := timed(2 * steps) - timed(steps)) < LAUNCHED:
            steps *= 2
        return 1e9 * took / (members * steps)
    for _ in range(12):
        took = timed(steps)
        best = min(best, took / (members * steps))
        steps = int(min(1e6, max(16, steps * seconds / 4 / max(took, 1e-9))))
        seconds -= took
        if seconds < 0:
            break
    return 1e9 * best


REHEARSED = 8192  # members: two blocks for each of two threads
ROUNDS = 10
LATE = 0.5  # seconds after which no further round starts, from the fourth on


def predicted_seconds(
    run: PreparedRun, threads: int, device: str | None, output: Path | None
) -> float:
    """Predict how long a run with a chosen integrator will take [s].

    Runs of 8192 members and of three times as many give the cost per member. Their results go to
    memory or to a file of the same kind, which a kernel timing omits.
    """
    members, device = run.members.size, resolve_device(device)
    size = WAVE if is_gpu(device) else REHEARSED
    if members < 8 * size:
        if not is_gpu(device):
            assert run.choice is not None
            return members / run.choice.members_per_second(threads)
        return _of_a_member(run, device) * moved_at_once(members, threads, device)
    seconds = _rehearsed(run, threads, device, output, size)
    small = float(np.median(seconds[size][1:]))  # the first run warms up
    large = float(np.median(seconds[3 * size]))
    # the difference omits the fixed cost of a run
    each = max(large - small, 0.2 * large) / (2 * size)
    return large + each * (members - 3 * size)


def _rehearsed(
    run: PreparedRun, threads: int, device: str, output: Path | None, size: int
) -> dict[int, list[float]]:
    """Return {members: [seconds of each run]} for `size` members and three times as many."""
    first, block = run.members.first, block_of(run, threads, device, output is not None)
    began, datasets = time.perf_counter(), []
    taken: dict[int, list[float]] = {size: [], 3 * size: []}
    with folder_beside(output) if output else tempfile.TemporaryDirectory() as folder:
        for i in range(ROUNDS):
            count = size * (1 + 2 * (i % 2))
            few = run.with_members(range(first, first + count))
            file = os.path.join(folder, f"{i}.nc") if output else None
            datasets.append(few.run(threads=threads, device=device, output=file, block=block))
            taken[count].append(origin_of(datasets[-1])["run_seconds"])
            if i >= 3 and time.perf_counter() - began > LATE:
                break
        for dataset in datasets:  # closed only now, or the next run would reuse warm memory
            dataset.close()
    return taken


ENOUGH = 0.1  # seconds of a rehearsal that suffices to time a member
AMPLE = 2.0  # seconds of a rehearsal that is not repeated with more members
LONG = 0.25  # seconds: a block that takes longer is rehearsed for part of its steps
Reduce = Callable[[xr.Dataset], object]  # a study of the members of a result
SAVES = 128  # least number of saves in that part; a spectrum needs 64


class Price(NamedTuple):
    """The expected cost of a study.

    members, steps : number of members, and mean steps of each; 0 steps in closed form
    seconds : of the run and the study, predicted by a rehearsal;  threads : of the run
    disk : bytes of the run directory, 0 if there is none
    """

    members: int
    steps: float
    seconds: float
    threads: int
    disk: int

    def __str__(self) -> str:
        each = "in closed form"
        if self.steps:
            total = two_digits(self.members * self.steps)
            each = f"x {self.steps:,.0f} steps, {total} in all"
        disk = f", {in_words(self.disk)} of disk" if self.disk else ""
        return (
            f"{count_text(self.members, 'member')} {each}:"
            f" about {self.seconds:.2g} s on {count_text(self.threads, 'thread')}{disk}"
        )


def price(
    scene: Scene,
    reduce: Reduce,
    threads: int | None = None,
    folder: str | None = None,
    device: str | None = None,
) -> Price:
    """Return the Price of a study, measured on the first members of its scene.

    reduce : the study's evaluation of a result, which must accept few members
    folder : the run directory of its members, where the rehearsal writes; if the rehearsal is
        killed there, `resume` deletes its files
    """
    threads = threads or threads_available()
    run = prepare_scene(scene)
    members = run.members.size
    return Price(
        members,
        run.plan.mean_steps if run.plan.scheme else 0.0,
        _seconds(run, reduce, threads, folder, resolve_device(device)),
        threads,
        needs(run, members, LANES, threads).file if folder else 0,
    )


def _seconds(
    run: PreparedRun, reduce: Reduce, threads: int, folder: str | None, device: str
) -> float:
    """Predict how long all members and their study will take [s].

    Ever more members are run and studied. The last two times give the cost per member; their
    difference omits the fixed cost of a study.
    """
    scene, members, share = run.scene, run.members.size, 1.0
    block = 0.0 if run.plan.scheme is None else LANES * _of_a_member(run, device)
    if block > LONG:
        saves = run.plan.grid.saves - 1
        kept = max(SAVES, math.ceil(saves * LONG / block))
        if kept >= saves:  # the time of such a study is the time of its steps
            return block * max(1.0, members / LANES / threads)
        scene, share = _until_save(scene, run.layout.axes.times[kept]), kept / saves
    # a GPU takes as long for one member as for a wave of members
    count = min(WAVE if is_gpu(device) else LANES, members)
    before = 0, 0.0
    part = folder and os.path.join(folder, "rehearsal")
    with folder_beside(part) if part else tempfile.TemporaryDirectory() as place:
        file = os.path.join(place, "rehearsal.nc") if folder else None
        _studied(scene, count, reduce, threads, file, device)  # compiles
        while True:
            took = _studied(scene, count, reduce, threads, file, device)
            # one time alone holds the fixed cost of a study: 0.1 s of a bootstrap, for 256 members
            # of 100,000, would promise 40 s where 1.5 s are true
            if count == members or took >= (ENOUGH if before[0] else AMPLE):
                break
            before, count = (count, took), min(4 * count, members)
    each = max(took - before[1], 0.2 * took) / (count - before[0])
    return (took + each * (members - count)) / share


def _until_save(scene: Scene, end: float) -> Scene:
    """Return the scene of a run that ends at one of its saves."""
    every = scene.run.every
    if isinstance(every, tuple):
        every = tuple(t for t in every if t <= end) or None
    return scene.with_run(t_end=float(end), every=every)


def _of_a_member(run: PreparedRun, device: str) -> float:
    """Return the seconds of a member's steps on one thread."""
    return 1e-9 * cost_per_step(run, device) * run.plan.mean_steps


def _studied(
    scene: Scene, count: int, reduce: Reduce, threads: int, file: str | None, device: str
) -> float:
    """Return the seconds to run the first `count` members of a scene and study them."""
    few = scene.with_run(members=count)
    began = time.perf_counter()
    with prepare_scene(few).run(threads=threads, output=file, force=True, device=device) as dataset:
        reduce(dataset)
    return time.perf_counter() - began


# A body on an orbit has to turn about its centre of mass; a step costs the same anywhere.
_BODY = Body.from_moments((1.0, 1.4, 2.0), centre=(0.0, 0.0, 0.0))
_START = Start(omega=(0.5, 0.7, 0.5), attitude=(1.0, 0.0, 0.0, 0.0))


def step_costs() -> dict[str, dict[str, float]]:
    """Measure {integrator: {"free": ns, "heavy": ns}} of one step on one thread of this machine,
    for asymmetric bodies that turn by 0.1 rad."""
    measured: dict[str, dict[str, float]] = {}
    for word, effects in (("free", ()), ("heavy", (EFFECTS["gravity"](1.0),))):
        scene = Scene(_BODY, effects, _START).with_run(t_end=1.0, save=("attitude",))
        costs = Costs(pilot(scene, 1))
        for name in integrators_for(effects):
            if name != "closed":
                measured.setdefault(name, {})[word] = costs.step(name, 10, "float64")
    return measured


def some_of(run: PreparedRun, kept: Iterable[int]) -> PreparedRun:
    """Return the run with only the effects in `kept`, by index, and nothing saved or monitored; the
    scheme stays."""
    plan, kept = run.plan, tuple(kept)
    assert plan.scheme is not None, "closed forms make no steps"
    integrator: Any = plan.scheme.integrator
    if isinstance(integrator, ScoredLangevin):
        integrator = integrator.langevin
    if isinstance(integrator, Langevin):  # it has one mark for each effect
        integrator = integrator._replace(
            pushes=tuple(integrator.pushes[i] for i in kept),
            flows=tuple(integrator.flows[i] for i in kept),
        )
    effects = tuple(plan.model.effects[i] for i in kept)
    nothing: dict[str, Any] = {"names": (), "retained": {}, "recorded": {}, "monitored": ()}
    bare = plan._replace(
        model=plan.model._replace(effects=effects),
        recording=plan.recording._replace(**nothing, has_work=False, observables=()),
        scheme=plan.scheme._replace(integrator=integrator),
        works=(),
        monitors=Monitors(has_attitude=plan.has_attitude),
        places=places_of(effects, False, Monitors(), False),
        nodes=0,
        wrt=(),
        derivatives=NO_DERIVATIVES,
    )
    return PreparedRun(bare, run.layout, run.members, None, run.sampler)


def prices(run: PreparedRun) -> tuple[float, Any, dict[str, Any], float, float]:
    """Measure what effects add to a step, for the ledger of saved work.

    Returns (ns without them, measured; operations without them; {label: operations that it adds};
    ns of noise, measured; ns predicted).

    The prediction assumes that all operations cost as much as in a step without effects; a
    division or a root counts as the number of operations that `rigidmc.engine.inspection` reports.
    """
    effects, attitude = run.plan.model.effects, run.plan.has_attitude
    every = tuple(range(len(effects)))

    def operations(kept: Sequence[int]) -> Any:
        part = some_of(run, kept).plan
        assert part.scheme is not None
        return step_operations(part.scheme, part.model.effects, attitude)

    free, none, complete = cost_per_step(some_of(run, ())), operations(()), operations(every)
    added = {
        label: complete.less(operations(every[:i] + every[i + 1 :]))
        for i, (label, _) in enumerate(label_effects(effects))
    }
    random, noise = tuple(i for i in every if is_random(effects[i])), 0.0
    if random:  # random numbers use integer operations, which are not counted
        counted = free * operations(random).slots / none.slots
        noise = max(0.0, cost_per_step(some_of(run, random)) - counted)
    return free, none, added, noise, free * complete.slots / none.slots + noise


def monitored_prices(rounds: int = 5) -> dict[str, dict[str, float]]:
    """Measure {"free" | "heavy": {label: ns that a monitor adds to a step of rk4 with attitude on
    one thread}}, with "" for the step itself, for a body that nearly spins about its middle axis;
    medians of interleaved rounds."""
    body = Body.from_moments((1.0, 2.0, 3.0), mass=1.0, centre=(0.0, 0.0, 0.3))
    start = Start(omega=Cone(2, 1.0, 0.05), attitude="uniform")
    names = (
        "nutation", "precession", "megno", "omega_max", "energy_mean", "energy_variance",
    )  # fmt: skip
    saves: dict[str, tuple[Any, ...]] = {
        "": (),
        "flips": (Flips(2),),
        "passage": (Passage(3, 0.01, "reaches"),),
        **{name: (name,) for name in names},
    }
    prices: dict[str, dict[str, float]] = {}
    for word, effects in (("free", ()), ("heavy", (EFFECTS["gravity"](1.0),))):
        scene = Scene(body, effects, start).with_run(dt=0.02, t_end=20.0)
        runs = {
            label: prepare_scene(scene.with_run(save=("attitude", *some)))
            for label, some in saves.items()
        }
        taken: dict[str, list[float]] = {label: [] for label in runs}
        for _ in range(rounds):
            for label, run in runs.items():
                taken[label].append(cost_per_step(run, seconds=0.1))
        cost = {label: float(np.median(ns)) for label, ns in taken.items()}
        prices[word] = {label: ns - cost[""] * (label != "") for label, ns in cost.items()}
    return prices


def effect_prices() -> dict[str, Any]:
    """Measure what effects cost on one thread.

    Returns {effect: (operations of its torque, ns of a step with it alone, ns that it adds to a
    step with gravity)}, and ns of steps without it: "free" of the momentum alone, "with attitude",
    "with gravity", by rk4; "strang", to which random effects are added, and "rk8", to which effects
    with moving parts are added, both with gravity.
    """

    def cost(effects: tuple[Any, ...], save: str = "omega", integrator: str = "rk4") -> float:
        scene = Scene(_BODY, effects, _START).with_run(
            integrator=integrator, dt=0.1, t_end=1.0, save=(save,), checks=False
        )
        return cost_per_step(prepare_scene(scene))

    gravity = EFFECTS["gravity"](1.0)
    costs: dict[str, Any] = {
        "free": cost(()),
        "with attitude": cost((), "attitude"),
        "with gravity": cost((gravity,)),
        "strang": cost((gravity,), integrator="strang"),
        "rk8": cost((gravity,), integrator="rk8"),
    }
    for name, kind in EFFECTS.items():
        effect = from_numbers(kind, itertools.repeat(0.1))
        effect = kind(*effect[: len(user_parameters(kind))])  # the run sets the hidden ones
        if is_random(kind):
            integrator, base = "strang", "strang"
        elif "rk4" in integrators_for((effect,)):
            integrator, base = "rk4", "with gravity"
        else:
            integrator, base = "rk8", "rk8"
        alone = cost((effect,), integrator=integrator)
        beside = cost((gravity, effect), integrator=integrator) - costs[base]
        costs[name] = torque_operations(effect), alone, beside
    return costs

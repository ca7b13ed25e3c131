"""A way of integrating a pilot, with its cost on this machine and its errors.

What steps, starts and saves cost on this machine, measured on one thread.

What effects and observables add to the cost of a step: measured, and as their operations say.
"""

import itertools
import math
import time
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.inspection import step_operations, torque_operations
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import Run, Saves
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program import NO_SAVES, Program
from rigidmc.physics.effects import EFFECTS, labelled
from rigidmc.physics.effects.protocol import blank, filled, is_random
from rigidmc.physics.integrators import Form, accepting, keeps_remainders
from rigidmc.physics.integrators.splitting import Langevin
from rigidmc.physics.observables.flips import Flips
from rigidmc.physics.observables.passage import Passage
from rigidmc.physics.observables.protocol import size
from rigidmc.planning.block_size import BLOCK, DEVICE_BLOCK
from rigidmc.planning.closed_form import closed_values
from rigidmc.planning.initial import noise, stage
from rigidmc.planning.job import program_of
from rigidmc.planning.monitors import Watch
from rigidmc.planning.plan import Plan, prepare
from rigidmc.planning.scheme import form_of
from rigidmc.planning.steps import Array, Clock
from rigidmc.planning.tolerance.deviation import upper_quantile
from rigidmc.planning.tolerance.pilot import OBSERVED, Pilot, pilot
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import rows
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Cone


class Way(NamedTuple):
    """One way of integrating a pilot.

    steps : of the fastest member of the pilot;  mean_steps, dt : mean over its members;  turn : of
        steps of their own [rad], None if all have the same;  errors : {quantity: (members,)};  ns :
        time per member and step on one thread [ns]
    """

    integrator: str
    dtype: str
    steps: int
    mean_steps: float
    dt: float
    turn: float | None
    errors: dict[str, Array]
    ns: float

    @property
    def upper(self) -> float:
        """The error that 99 % of all members stay below, with 95 % certainty."""
        return upper_quantile(self.errors["state"])

    @property
    def step(self) -> str:
        """The length of a step, in words."""
        if self.integrator == "closed":
            return "at every save"
        if self.turn is None:
            return f"at dt = {self.dt:.4g} s ({self.steps:,} steps)"
        steps = f"{self.mean_steps:,.1f} steps in the mean, {self.steps:,} of the fastest member"
        return f"at turn = {self.turn:.4g} rad ({steps})"

    def with_precision(self) -> str:
        """The integrator, and its precision if that is not double."""
        return self.integrator + (" in float32" if self.dtype == "float32" else "")


LONG = 0.2  # seconds of launches that are long beside the first, shorter ones


def cost_per_step(scene: Scene, plan: Plan, members: int = 256, seconds: float = 0.05) -> float:
    """Nanoseconds per member-step on one thread, measured on the first members of the scene.

    On graphics processors: on one of them, with as many members as a block has, and without what
    copies of them take.
    """
    program = program_of(scene, plan)
    assert program is not None, "closed forms make no steps"
    on_device, own = plan.device != "cpu", int(plan.member_steps)
    members = DEVICE_BLOCK if on_device else members
    random = noise(scene, plan.indices(plan.first, members))
    staged, _ = stage(scene, plan.first, members, plan.carried, more=plan.watch.rows)
    order = NO_SAVES._replace(order=np.arange(staged.shape[1]))

    def timed(steps: int) -> float:
        block = staged.copy()
        if own:
            block[layout.STEPS] = steps
        began = time.perf_counter()
        run = Run(plan.dt, steps if own else 1, steps, steps, own, 0, steps)
        program.advance(block, run, random, order)
        return time.perf_counter() - began

    best, steps = math.inf, 16
    if on_device:
        while (took := timed(2 * steps) - timed(steps)) < LONG:
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


class Costs:
    """Nanoseconds per member of a pilot on one thread, measured once for each compiled program."""

    def __init__(self, pilot: Pilot) -> None:
        self.pilot, run = pilot, pilot.scene.run
        self._known: dict[Hashable, float] = {}
        self.saves = 1 if run.every is None else max(1, math.ceil(run.t_end / run.every))

    def step(self, integrator: str, steps: int, dtype: str) -> float:
        """Per member and step, without saves; of `closed` per member and save."""
        if integrator == "closed":
            return self._once("closed", self._closed)
        scene = self.pilot.stepped(steps)[0].with_run(integrator=integrator)
        h = scene.run.t_end / steps
        form, *_ = form_of(scene, h)
        compensated = keeps_remainders(scene.integrator, scene.effects, dtype)
        key = type(form.integrator), form.integrator, len(form.parts), dtype
        return self._once(
            key, lambda: self._stepped(form, dtype, OBSERVED, compensated=compensated)
        )

    def start(self) -> float:
        """Per member, to draw its start."""

        def draw() -> float:
            available = rows(*self.pilot.scene.quantities())
            count = min(BLOCK, available or BLOCK)
            began = time.perf_counter()
            stage(self.pilot.scene, 0, count, self.pilot.carried)
            return 1e9 * (time.perf_counter() - began) / count

        return self._once("start", lambda: min(draw() for _ in range(3)))

    def save(self) -> float:
        """Per member and save."""

        def record() -> float:
            scene = self.pilot.scene.with_run(integrator="rk4")
            form, *_ = form_of(scene, 1.0)
            observables = tuple(o for n, o in scene.recorded().items() if n != "work")
            plain, saving = (
                self._stepped(form, "float64", observables, stride=stride) for stride in (32, 1)
            )
            return max(0.0, saving - plain)

        return self._once("save", record)

    def _once(self, key: Hashable, measure: Callable[[], float]) -> float:
        if key not in self._known:
            self._known[key] = measure()
        return self._known[key]

    def _closed(self) -> float:
        scene, count = self.pilot.scene, min(512, max(layout.LANES, self.pilot.members))
        saves, taken = min(self.saves, 50), []
        times = np.linspace(0.0, scene.run.t_end, saves + 1)
        for _ in range(3):
            block, start = stage(scene, 0, count, self.pilot.carried)
            began = time.perf_counter()
            closed_values(scene, block, start, times, Clock(times[1], saves, times[1]))
            taken.append(time.perf_counter() - began)
        return 1e9 * min(taken) / (count * saves)

    def _stepped(
        self,
        form: Form,
        dtype: str,
        observables: tuple[Any, ...],
        stride: int | None = None,
        compensated: bool = False,
    ) -> float:
        """Per member and step; `stride` : steps between saves, None for the last only.

        The steps are short, whatever the form's are: members that a long step of an explicit
        method throws off are frozen, and then a step seems to take next to no time.
        """
        h = 1e-6 * self.pilot.scene.run.t_end / self.pilot.base
        effects = blank(self.pilot.scene.effects)
        program = Program(form, effects, observables, self.pilot.carried, compensated, dtype)
        own = int(self.pilot.member_steps and stride is None)
        few, steps = self.pilot.block, 32
        block = np.ascontiguousarray(np.tile(few, -(-512 // few.shape[1]))[:, :512])
        order, width = np.arange(512), block.shape[1] if observables else 0
        values = sum(size(o.dims) for o in observables)
        best, spent = math.inf, -1.0
        while spent < 0.03:
            saves = Saves(np.empty((steps + 1) * values * width), width, 0, order)
            moved, span, slots = block.copy(), h, 1
            if own:
                moved[layout.STEPS], span, slots = steps, h * steps, steps
            began = time.perf_counter()
            run = Run(span, slots, stride or steps, steps, own, 0, steps)
            program.advance(moved, run, saves=saves)
            took = time.perf_counter() - began
            if spent >= 0.0:  # the first may have compiled
                best = min(best, took / (steps * block.shape[1]))
            spent = max(spent, 0.0) + (took if spent >= 0.0 else 0.0)
            if stride is None and took < 0.003:
                steps *= 2
        return 1e9 * best

    def per_member(self, way: Way) -> float:
        """One member to t_end, with its saves [ns]."""
        saves = 0.0 if way.integrator == "closed" else self.saves * self.save()
        return way.ns * way.mean_steps + saves + self.start()

    def members_per_second(self, way: Way, threads: int | None = None) -> float:
        """Members to t_end per second on all threads."""
        return 1e9 * (threads or threads_available()) / self.per_member(way)


def step_costs() -> dict[str, dict[str, float]]:
    """{integrator: {"free": ns, "heavy": ns}} of one step on one thread of this machine: asymmetric
    bodies that turn by 0.1 rad."""
    body = Body.from_moments((1.0, 1.4, 2.0), centre=(0.1, 0.2, 0.3))
    start = Start(omega=(0.5, 0.7, 0.5), attitude=(1.0, 0.0, 0.0, 0.0))
    measured: dict[str, dict[str, float]] = {}
    for word, effects in (("free", ()), ("heavy", (EFFECTS["gravity"](1.0),))):
        scene = Scene(body, effects, start).with_run(t_end=1.0, save=("attitude",))
        costs = Costs(pilot(scene, 1))
        for name in accepting(effects):
            if name != "closed":
                measured.setdefault(name, {})[word] = costs.step(name, 10, "float64")
    return measured


def some_of(scene: Scene, plan: Plan, kept: Iterable[int]) -> tuple[Scene, Plan]:
    """The scene with only the effects in `kept`, by index, and its Plan: the step's form stays."""
    assert plan.form is not None, "closed forms make no steps"
    kept = tuple(kept)
    integrator: Any = plan.form.integrator
    if isinstance(integrator, Langevin):  # marks of each effect
        integrator = integrator._replace(
            pushes=tuple(integrator.pushes[i] for i in kept),
            flows=tuple(integrator.flows[i] for i in kept),
        )
    effects = tuple(scene.effects[i] for i in kept)
    bare = replace(scene, effects=effects, observables=()).with_run(save=())
    form = plan.form._replace(integrator=integrator)
    return bare, plan._replace(form=form, labels=(), watch=Watch())


def prices(scene: Scene, plan: Plan) -> tuple[float, Any, dict[str, Any], float, float]:
    """What effects add to a step, the ledger of work left out: (ns without them, measured;
    operations without them; {label: operations that it adds}; ns of noise, measured; ns predicted).

    The prediction takes all operations to cost as much as those of a step without effects; a
    division or a root counts as many as `rigidmc.engine.inspection` tells.
    """
    every = tuple(range(len(scene.effects)))

    def operations(kept: Sequence[int]) -> Any:
        part, plan_of_part = some_of(scene, plan, kept)
        assert plan_of_part.form is not None
        return step_operations(plan_of_part.form, part.effects, plan.carried)

    free, none, whole = cost_per_step(*some_of(scene, plan, ())), operations(()), operations(every)
    added = {
        label: whole.less(operations(every[:i] + every[i + 1 :]))
        for i, (label, _) in enumerate(labelled(scene.effects))
    }
    random, noise = tuple(i for i in every if is_random(scene.effects[i])), 0.0
    if random:  # random numbers are made from integers, which no count of operations tells
        counted = free * operations(random).slots / none.slots
        noise = max(0.0, cost_per_step(*some_of(scene, plan, random)) - counted)
    return free, none, added, noise, free * whole.slots / none.slots + noise


def observable_prices(
    scene: Scene, watched: dict[str, tuple[Any, ...]], rounds: int = 5
) -> dict[str, float]:
    """{label: ns that it adds to a step of rk4 with attitude on one thread}, "" for the step
    itself; medians of interleaved rounds.

    watched : {label: what is named in `save`}
    """
    scenes = {
        label: scene.with_run(save=("attitude", *some))
        for label, some in {"": (), **watched}.items()
    }
    plans = {label: prepare(one) for label, one in scenes.items()}
    taken: dict[str, list[float]] = {label: [] for label in scenes}
    for _ in range(rounds):
        for label, one in scenes.items():
            taken[label].append(cost_per_step(one, plans[label], seconds=0.1))
    bare = float(np.median(taken[""]))
    return {"": bare} | {label: float(np.median(t)) - bare for label, t in taken.items() if label}


def watched_prices(rounds: int = 5) -> dict[str, dict[str, float]]:
    """{"free" | "heavy": `observable_prices`} of what can be watched, of a body that nearly spins
    about its middle axis."""
    body = Body.from_moments((1.0, 2.0, 3.0), mass=1.0, centre=(0.0, 0.0, 0.3))
    start = Start(omega=Cone(2, 1.0, 0.05), attitude="uniform")
    names = (
        "nutation", "precession", "megno", "omega_max", "energy_mean", "energy_variance",
    )  # fmt: skip
    watched: dict[str, tuple[Any, ...]] = {
        "flips": (Flips(2),),
        "passage": (Passage(3, 0.01, "reaches"),),
        **{name: (name,) for name in names},
    }
    scenes = {
        word: Scene(body, effects, start).with_run(dt=0.02, t_end=20.0)
        for word, effects in (("free", ()), ("heavy", (EFFECTS["gravity"](1.0),)))
    }
    return {word: observable_prices(scene, watched, rounds) for word, scene in scenes.items()}


def effect_prices() -> dict[str, Any]:
    """{effect: (operations of its torque, ns of a step with it alone, ns that it adds to one with
    gravity)}, and of steps without it: "free" of the momentum alone, "with attitude", "with
    gravity", by rk4; "strang", to which random effects are added. On one thread."""
    body = Body.from_moments((1.0, 1.4, 2.0), centre=(0.1, 0.2, 0.3))
    start = Start(omega=(0.5, 0.7, 0.5), attitude=(1.0, 0.0, 0.0, 0.0))

    def cost(effects: tuple[Any, ...], save: str = "omega", integrator: str = "rk4") -> float:
        scene = Scene(body, effects, start).with_run(
            integrator=integrator, dt=0.1, t_end=1.0, save=(save,), checks=False
        )
        return cost_per_step(scene, prepare(scene))

    gravity = EFFECTS["gravity"](1.0)
    found: dict[str, Any] = {
        "free": cost(()),
        "with attitude": cost((), "attitude"),
        "with gravity": cost((gravity,)),
        "strang": cost((gravity,), integrator="strang"),
    }
    for name, kind in EFFECTS.items():
        integrator, base = ("strang", "strang") if is_random(kind) else ("rk4", "with gravity")
        effect = filled(kind, itertools.repeat(0.1))
        if is_random(kind):
            effect = kind(*effect[: len(kind._fields) - len(kind.hidden)])
        alone = cost((effect,), integrator=integrator)
        beside = cost((gravity, effect), integrator=integrator) - found[base]
        found[name] = torque_operations(effect), alone, beside
    return found

"""What effects and observables add to the cost of a step: measured, and as their operations say."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigidmc.effects import EFFECTS, labelled
from rigidmc.effects.parameters import filled
from rigidmc.effects.protocol import is_random
from rigidmc.engine.operations import step_operations, torque_operations
from rigidmc.integrators.splitting import Langevin
from rigidmc.observables.flips import Flips
from rigidmc.observables.passage import Passage
from rigidmc.planning.plan import Plan, prepare
from rigidmc.planning.tolerance.costs import cost_per_step
from rigidmc.planning.watch import Watch
from rigidmc.scene.body import Body
from rigidmc.scene.laws import Cone
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start


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
    division or a root counts as many as `rigidmc.engine.operations` tells.
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

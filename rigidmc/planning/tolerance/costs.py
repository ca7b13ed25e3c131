"""What a step costs on this machine, and what each effect adds to it: measured, and as its operations say."""

import itertools
import time
from dataclasses import replace

import numpy as np

from rigidmc.effects import EFFECTS, labelled
from rigidmc.effects.parameters import filled
from rigidmc.effects.protocol import is_random
from rigidmc.engine import layout
from rigidmc.engine.frame import Run
from rigidmc.engine.operations import step_operations, torque_operations
from rigidmc.engine.program import NOWHERE
from rigidmc.integrators.splitting import Langevin
from rigidmc.observables import Flips, Passage
from rigidmc.planning.job import program_of
from rigidmc.planning.plan import prepare
from rigidmc.planning.stage import noise, stage
from rigidmc.planning.watch import Watch
from rigidmc.scene.body import Body
from rigidmc.scene.laws import Cone
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start


def cost_per_step(scene, plan, members=256, seconds=0.05):
    """Nanoseconds per member-step on one thread of this machine, measured on the scene's own first members."""
    program, random = program_of(scene, plan), noise(scene, plan.first)
    best, steps = np.inf, 16
    for _ in range(12):
        block, _ = stage(scene, plan.first, members, plan.carried, more=plan.watch.rows)
        order = NOWHERE._replace(order=np.arange(block.shape[1]))
        if plan.own:
            block[layout.STEPS] = steps
        began = time.perf_counter()
        program.advance(
            block,
            Run(plan.dt, steps if plan.own else 1, steps, steps, int(plan.own), 0, steps),
            random,
            order,
        )
        took = time.perf_counter() - began
        best = min(best, took / (members * steps))
        steps = int(min(1e6, max(16, steps * seconds / 4 / max(took, 1e-9))))
        seconds -= took
        if seconds < 0:
            break
    return 1e9 * best


def some_of(scene, plan, kept):
    """The scene with those of its effects whose index is in `kept`, and its Plan: the form of the step stays."""
    effects = tuple(scene.effects[i] for i in kept)
    made = plan.form.integrator
    if isinstance(made, Langevin):  # marks of each effect
        made = made._replace(
            pushes=tuple(made.pushes[i] for i in kept), flows=tuple(made.flows[i] for i in kept)
        )
    bare = replace(scene, effects=effects, observables=()).with_run(save=())
    return bare, plan._replace(form=plan.form._replace(integrator=made), labels=(), watch=Watch())


def prices(scene, plan):
    """What effects add to a step: (ns without them, measured; operations without them; {label: operations that it adds}; ns of noise, measured;
    ns predicted), the ledger of work left out.

    The prediction takes all operations to cost what those without effects do, a division or a root as many as `rigidmc.engine.operations` tells.
    """
    every = tuple(range(len(scene.effects)))

    def operations(kept):
        part, made = some_of(scene, plan, kept)
        return step_operations(made.form, part.effects, plan.carried)

    free, none, whole = cost_per_step(*some_of(scene, plan, ())), operations(()), operations(every)
    added = {
        label: whole.less(operations(every[:i] + every[i + 1 :]))
        for i, (label, _) in enumerate(labelled(scene.effects))
    }
    random, noise = tuple(i for i in every if is_random(scene.effects[i])), 0.0
    if random:  # numbers from whole ones, which no count of operations tells
        noise = max(
            0.0,
            cost_per_step(*some_of(scene, plan, random))
            - free * operations(random).slots / none.slots,
        )
    return free, none, added, noise, free * whole.slots / none.slots + noise


def observable_prices(scene, watched, rounds=5):
    """{label: ns that it adds to a step of rk4 with attitude on one thread}, "" for the step itself; medians of interleaved rounds.

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


def watched_prices(rounds=5):
    """{"free" | "heavy": `observable_prices`} of what can be watched, of a body that nearly spins about its middle axis."""
    body = Body.from_moments((1.0, 2.0, 3.0), mass=1.0, centre=(0.0, 0.0, 0.3))
    start = Start(omega=Cone(2, 1.0, 0.05), attitude="uniform")
    watched = {
        "flips": (Flips(2),), "passage": (Passage(3, 0.01, "reaches"),),
        **{name: (name,) for name in ("nutation", "precession", "megno", "omega_max", "energy_mean", "energy_variance")},
    }  # fmt: skip
    scenes = {
        word: Scene(body, effects, start).with_run(dt=0.02, t_end=20.0)
        for word, effects in (("free", ()), ("heavy", (EFFECTS["gravity"](1.0),)))
    }
    return {word: observable_prices(scene, watched, rounds) for word, scene in scenes.items()}


def effect_prices():
    """{effect: (operations of its torque, ns of a step with it alone, ns that it adds to one with gravity)}, and of steps without it:
    "free" of the momentum alone, "with attitude", "with gravity", by rk4; "strang", to which random effects are added. On one thread."""
    body = Body.from_moments((1.0, 1.4, 2.0), centre=(0.1, 0.2, 0.3))
    start = Start(omega=(0.5, 0.7, 0.5), attitude=(1.0, 0.0, 0.0, 0.0))

    def cost(effects, save="omega", integrator="rk4"):
        scene = Scene(body, effects, start).with_run(
            integrator=integrator, dt=0.1, t_end=1.0, save=(save,), checks=False
        )
        return cost_per_step(scene, prepare(scene))

    gravity = EFFECTS["gravity"](1.0)
    made = {
        "free": cost(()),
        "with attitude": cost((), "attitude"),
        "with gravity": cost((gravity,)),
    }
    made["strang"] = cost((gravity,), integrator="strang")
    for name, kind in EFFECTS.items():
        by, base = ("strang", "strang") if is_random(kind) else ("rk4", "with gravity")
        effect = filled(kind, itertools.repeat(0.1))
        if is_random(kind):
            effect = kind(*effect[: len(kind._fields) - len(kind.hidden)])
        made[name] = (
            torque_operations(effect),
            cost((effect,), integrator=by),
            cost((gravity, effect), integrator=by) - made[base],
        )
    return made

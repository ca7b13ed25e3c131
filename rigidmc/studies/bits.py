"""Runs whose bits are compared across vector widths, CPUs and GPUs.

Free, heavy and driven tops, and tops in a bath, with every integrator: with events, statistics,
noise, work, the growth of tangents, individual steps of members, and float32.
"""

import hashlib
from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.inspection import step_operations
from rigidmc.physics.effects import Bath, Gravity, RotatingField, SpaceTorque, ViscousDamping
from rigidmc.physics.integrators import integrators_for
from rigidmc.physics.observables import Flips, Passage
from rigidmc.planning.saves import first_and_last
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.price import cost_per_step
from rigidmc.runs.simulate import simulate
from rigidmc.scene.body import Body
from rigidmc.scene.distributions import normal, uniform
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Cone, GibbsMomentum, Sphere

MEMBERS = 37  # of a run: not a multiple of any vector width
# Parameters of the start, the body and the effects, by kind of motion
DERIVATIVES = {
    "free": ("start.momentum.size", "body.moments.1", "body.moments.2.mean"),
    "heavy": ("start.omega.size", "body.moments.3", "effects.gravity.g"),
    "driven": ("start.omega.1.mean", "body.mass", "effects.rotating_field.rate"),
    "in a bath": ("start.momentum.kT", "body.moments.1.low", "effects.bath.kT"),
}


class BitCase(NamedTuple):
    """A run: its name, its kind of motion, its scene."""

    name: str
    motion: str
    scene: Scene


def cases(
    integrators: Collection[str] | None = None, motions: Collection[str] | None = None
) -> list[BitCase]:
    """Return the runs, by default with all integrators and of all motions."""
    chosen = list[BitCase]()
    for motion, scene in _motions().items():
        if motions is not None and motion not in motions:
            continue
        for name in integrators_for(scene.effects):
            if name != "closed" and (integrators is None or name in integrators):
                # midpoint solves for less than 0.5 rad
                dt = 0.02 if name == "midpoint" else 0.05
                chosen.append(_case(motion, scene, f"{name}, {dt}", integrator=name, dt=dt))
        if motion in ("heavy", "driven"):
            name = "rk4, 0.1 steps of their own"
            chosen.append(_case(motion, scene, name, integrator="rk4", turn=0.1))
        if motion == "heavy":
            single = {"integrator": "rk4", "dt": 0.05, "dtype": "float32"}
            chosen.append(_case(motion, scene, "rk4, 0.05, float32", **single))
            save = (*scene.run.save, "work", "megno")
            more = {"integrator": "strang", "dt": 0.05, "save": save}
            chosen.append(_case(motion, scene, "strang, 0.05, works and a tangent", **more))
    return chosen


def with_derivatives(case: BitCase) -> Scene:
    """Return the scene of a run that also differentiates; its values must have the same bits."""
    return case.scene.with_run(wrt=DERIVATIVES[case.motion])


def _case(motion: str, scene: Scene, name: str, **settings: Any) -> BitCase:
    return BitCase(f"{motion}, {name}", motion, scene.with_run(**settings))


def _motions() -> dict[str, Scene]:
    """Return {kind of motion: scene}, without integrators."""
    body = Body.from_moments(
        (uniform(1.0, 1.2), normal(1.4, 0.01), 2.0),
        mass=uniform(1.0, 2.0),
        centre=(0.1, 0.2, normal(0.3, 0.05)),
    )
    free = Start(momentum=Sphere(uniform(1.0, 2.0)), attitude="uniform")
    heavy = Start(
        omega=Cone(3, uniform(4.0, 6.0), normal(0.1, 0.02)),
        attitude=(uniform(0.0, 6.0), normal(0.5, 0.1), 0.0),
    )
    driven = Start(omega=(normal(0.0, 1.0), 0.5, 1.0), attitude="uniform")
    bathed = Start(momentum=GibbsMomentum(1.0), attitude="uniform")
    pulls = (
        Gravity(2.0),
        ViscousDamping(0.1),
        SpaceTorque((0.0, 0.2, 0.1)),
        RotatingField((0.1, 0.0, 0.2), (0.3, 0.0, 0.1), 1.5),
    )
    monitored = Passage(3, 0.6, "leaves"), "nutation", "energy_mean"
    scenes: dict[str, tuple[Any, Start, tuple[Any, ...]]] = {
        "free": ((), free, (Flips(2), "omega_max")),
        "heavy": ((Gravity(9.81),), heavy, monitored),
        "driven": (pulls, driven, ("omega_max",)),
        "in a bath": ((Gravity(1.0), Bath(0.5, uniform(0.5, 1.0))), bathed, ("energy_variance",)),
    }
    return {
        word: Scene(body, effects, start).with_run(
            t_end=2.0,
            every=0.5,
            members=MEMBERS,
            seed=5,
            save=("attitude", "momentum", "energy", *more),
        )
        for word, (effects, start, more) in scenes.items()
    }


def digest(scene: Scene, threads: int | None = 1, device: str | None = None) -> str:
    """Return the sha256 of all variables of the result of a scene, except derivatives."""
    # the scenes of the cases are what is compared
    result = simulate(first_and_last(scene), threads=threads, device=device, checks=False)
    # `drift_law` follows from sums that are compared already
    values = result.drop_dims("parameter", errors="ignore").data_vars
    names = sorted(str(name) for name in values if name != "drift_law")
    parts = (np.ascontiguousarray(result[name].values) for name in names)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def compare_devices(word: str) -> Iterator[tuple[str, bool]]:
    """Yield (name, whether the GPU gives the same bits as this CPU) for every case.

    word : the device, see `rigidmc.engine.cuda.devices`
    """
    for case in cases():
        here = digest(case.scene)
        yield case.name, digest(case.scene, device=word) == here


def plain_steps(motion: str) -> Scene:
    """Return the scene of a motion for timing steps: it saves the energy and monitors nothing."""
    scene = _motions()[motion].with_run(dt=0.01, save=("energy",))
    return replace(scene, observables=())


def speeds(word: str) -> Iterator[tuple[str, float, float]]:
    """Yield (name, member-steps per second, operations per second) of a GPU.

    The members of a block stay on the GPU; saves and copies are excluded. Nothing is monitored,
    because monitoring costs more than the steps. Free members have no attitude.
    """
    for motion, name in (("free", "rk4"), ("heavy", "rk4"), ("free", "rk8"), ("free", "exact")):
        scene = plain_steps(motion).with_run(integrator=name)
        run = prepare_scene(scene)  # each is another scene
        plan, rate = run.plan, 1e9 / cost_per_step(run, resolve_device(word))
        each = step_operations(plan.scheme, scene.effects, plan.has_attitude).all
        yield f"{motion}, {name}", rate, rate * each

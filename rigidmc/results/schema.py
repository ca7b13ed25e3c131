"""The layout of a result: its variables, their dimensions and attributes. A Dataset in memory and a
netCDF file are the same."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.block import LOOK
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.engine.machine import UNCOMPILED, is_uncompiled
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import labelled
from rigidmc.physics.effects.protocol import Effect, facts, shape
from rigidmc.physics.observables import OBSERVABLES, outputs, title
from rigidmc.physics.observables.event_times import CENSORED, FOLLOWED, LAG, event_times
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.results.layout import Layout, Shape
from rigidmc.scene.conservation import booked, conservation
from rigidmc.scene.drifts import LAWS
from rigidmc.scene.once import once
from rigidmc.scene.quantities import is_shared, rows
from rigidmc.scene.scene import Scene
from rigidmc.version import VERSION


class Variable(NamedTuple):
    """One variable of a result: dimensions, type and attributes."""

    dims: tuple[str, ...]
    dtype: str
    attrs: dict[str, Any]


Coordinate = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]  # dimensions, values, attributes


def _by_member(long_name: str, units: str, dims: tuple[str, ...] = (), **more: Any) -> Variable:
    """A variable of floats by members."""
    return Variable((*dims, "member"), "f8", {"units": units, "long_name": long_name, **more})


def coordinates(plan: Shape, members: Sequence[int] | NDArray[Any] = ()) -> dict[str, Coordinate]:
    """Coordinates of a result as {name: (dims, values, attrs)}; members : their indices."""
    effects: dict[str, Coordinate] = {}
    if plan.labels:
        about = {"long_name": "effect of the scene"}
        effects["effect"] = (("effect",), np.array(plan.labels), about)
    thinned: dict[str, Coordinate] = {}
    if plan.thinned.size:
        about = {"units": "s", "long_name": "time of what is thinned"}
        thinned["thinned_time"] = (("thinned_time",), plan.times[plan.thinned], about)
    bins: dict[str, Coordinate] = {}
    for name, edges, units in plan.watch.bins:
        middles, width = 0.5 * (edges[1:] + edges[:-1]), edges[1] - edges[0]
        text = {"units": units, "long_name": "middle of the bin", "width": width}
        bins[name] = ((name,), middles, text)
    indices = np.asarray(members, np.int64)
    return {
        **effects,
        **bins,
        "member": (("member",), indices, {"long_name": "index of the member"}),
        "time": (("time",), plan.times.copy(), {"units": "s", "long_name": "time"}),
        **thinned,
        **{
            name: ((name,), np.array(labels), {"long_name": text})
            for name, (labels, text) in DIMENSIONS.items()
            if name in ("axis", "quat", *plan.watch.dims)
        },
    }


@once
def saved_variables(scene: Scene) -> dict[str, Variable]:
    """Variables of what is recorded at save times, see `rigidmc.physics.observables.keep`."""
    conserved, variables = conservation(scene), {}
    for name in scene.saved():
        kind = scene.observable(name)
        attrs = {"units": kind.units, "long_name": title(kind)}
        if kind.conserved:
            attrs["conserved"] = conserved[kind.conserved]
        if name == "work":
            # the energy tells the work of the other effects
            attrs["booked"] = ", ".join(booked(scene)) or "none"
        word, dims = scene.kept()[name], (*kind.dims, "member")
        if word == "full":
            variables[name] = Variable(("time", *dims), "f8", attrs)
        elif word == "thinned":
            variables[f"{name}_thinned"] = Variable(("thinned_time", *dims), "f8", attrs)
        elif word == "final":
            attrs |= {"long_name": f"{title(kind)}, at the end"}
            variables[f"{name}_final"] = Variable(dims, "f8", attrs)
    return variables


def is_rounded(scene: Scene, dims: tuple[str, ...], dtype: str) -> bool:
    """Whether files store only some digits of a variable: those of saves over time, but never of
    variables that a run could start from, nor of flagged members."""
    return (
        scene.run.digits is not None
        and dims[0] in ("time", "thinned_time")
        and dims[-1] == "member"
        and dtype == "f8"
    )


def flagged_variables(scene: Scene) -> dict[str, Variable]:
    """Variables of flagged members, all of whose saves are kept even if those of others are not."""
    names = [name for name, word in scene.kept().items() if word != "full"]
    if not names:
        return {}
    text = {"long_name": "index of a member whose status is not ok"}
    variables = {"flagged_member": Variable(("flagged",), "i8", text)}
    for name in names:
        kind = scene.observable(name)
        text = {"units": kind.units, "long_name": f"{title(kind)}, of flagged members"}
        variables[f"{name}_flagged"] = Variable(("time", *kind.dims, "flagged"), "f8", text)
    return variables


def bytes_of_a_member(scene: Scene, plan: Layout) -> tuple[int, int]:
    """Bytes of a member before compression: (of values that all members share, of others)."""
    same = other = 0
    variables = {**member_variables(scene, plan.carried), **saved_variables(scene)}
    sizes = {**lengths(plan), "member": 1}
    for name, (dims, dtype, _) in variables.items():
        count = math.prod(sizes[dim] for dim in dims)
        size = count * np.dtype(dtype).itemsize
        same, other = (same + size, other) if name in plan.constant else (same, other + size)
    return same, other


@once
def ensemble_variables(scene: Scene) -> dict[str, Variable]:
    """Variables of the ensemble as a whole."""
    variables = {}
    for label, one in scene.histograms():
        component = f", component {one.component + 1}" if one.of.endswith("]") else ""
        text = f"members by {title(scene.observable(one.name))}{component}"
        about = {"units": "1", "long_name": text}
        variables[label] = Variable(("time", f"{label}_bin"), "i8", about)
        for word in ("below", "above"):
            about = {"units": "1", "long_name": f"members {word} the bins of {label}"}
            variables[f"{label}_{word}"] = Variable(("time",), "i8", about)
    return variables


@once
def member_variables(scene: Scene, carried: bool) -> dict[str, Variable]:
    """Variables with one value per member, which every result has.

    carried : whether the attitude is followed
    """
    variables = {**_health_variables(scene), **_body_variables(scene)}
    for label, effect in labelled(scene.effects):
        for name, value in zip(effect._fields, effect, strict=True):
            size, turned = shape(effect, name), is_turned(scene, effect, name)
            if turned or not is_shared(*(value if size else (value,))):
                axes = ", principal axes of the member" if turned else ""
                units = facts(effect).units.get(name, "1")
                variables[f"{label}_{name}"] = parameter_variable(label, name, size, units, axes)
    lags: dict[str, float] = {}
    for label, one in scene.watched():
        lags |= (times := event_times(label, one))
        for name, (units, text, dims) in outputs(label, one).items():
            variables[name] = _by_member(text, units, dims, **_censored(name, times))
    if lags:
        variables[FOLLOWED] = _by_member(_FOLLOWED, "s")
    return {**variables, **_start_variables(scene, carried)}


# variables that results of earlier versions lack, and what stands for them
NEWER = {FOLLOWED: np.nan, "drift_law": np.int8(LAWS["not_judged"])}
_FOLLOWED = (
    "time until which the member was followed: t_end, or when it stopped or was last found to be ok"
)


def _censored(name: str, lags: Mapping[str, float]) -> dict[str, Any]:
    """The attributes of a variable that tell the meaning of nan; lags : of the times of events."""
    lag = lags.get(name)
    if lag is None:
        return {}
    return {CENSORED: FOLLOWED, **({LAG: lag} if lag else {})}


def is_turned(scene: Scene, effect: Effect, name: str) -> bool:
    """Whether a parameter is fixed in the body, and members have principal axes of their own: then
    a result has it in these, also if all members are given the same one."""
    fixed = name in facts(effect).in_body and name not in facts(effect).hidden
    if not fixed or scene.body.given != "tensor":
        return False
    return not all(isinstance(x, float) and x == 0.0 for x in getattr(effect, name))


def parameter_variable(
    label: str, name: str, size: int | None, units: str, axes: str = ""
) -> Variable:
    """The variable of a parameter of an effect that differs from member to member."""
    dims: tuple[str, ...] = () if size is None else ("axis",) if size == 3 else ("component",)
    return _by_member(f"{name} of {label}{axes}", units, dims)


def _health_variables(scene: Scene) -> dict[str, Variable]:
    """Drifts and status of the members."""
    conserved = conservation(scene)
    over = f"largest over every {LOOK}th step and all saves"
    drift = "relative to the start's energy (to 1e-3 of the energies in play where that is smaller)"
    energy = "|E - E(0)|"
    if "work" in scene.run.save:
        drift += " and the sizes of all works, or the largest kinetic energy where that is larger"
        energy = f"|E - E(0) - work of {', '.join(booked(scene)) or 'none'}|"
    momentum = f"relative change of |L|^2 (1 for a body that starts at rest and moves), {over}"
    values = np.array(list(STATUSES.values()), "i1")
    values.flags.writeable = False  # all results of a scene share it
    status = {
        "long_name": "health of the member; one that is not ok is frozen at its last good state, "
        "seen at the look before",
        "flag_values": values,
        "flag_meanings": " ".join(STATUSES),
    }
    law = {
        "long_name": "how the drifts of what is conserved go: by rounding, bounded, or one way, in "
        "the second half of the run never far below what they were in the first",
        "flag_values": np.array(list(LAWS.values()), "i1"),
        "flag_meanings": " ".join(LAWS),
    }
    step = {
        "long_name": "steps made when a member was found not to be ok, at most "
        f"{LOOK} after it happened; -1 for those that are",
        "units": "1",
    }
    return {
        "energy_drift_max": _by_member(
            f"{energy} {drift}, {over}", "1", conserved=conserved["energy_drift"]
        ),
        "l2_drift_max": _by_member(momentum, "1", conserved=conserved["l2"]),
        "drift_law": Variable(("member",), "i1", law),
        "status": Variable(("member",), "i1", status),
        "status_step": Variable(("member",), "i8", step),
        "status_time": _by_member(
            "time at which a member was found not to be ok; nan for those that are", "s"
        ),
    }


def _body_variables(scene: Scene) -> dict[str, Variable]:
    """Moments; steps of members that have their own; mass and centre if effects may need them."""
    text = "principal moments of inertia about the fixed point"
    variables = {"moments": _by_member(text, "kg m2", ("axis",))}
    turned = scene.body.given == "tensor"
    if turned:
        text = "attitude of the principal axes of the member in those of the mean tensor"
        variables["principal_axes"] = _by_member(text, "1", ("quat",))
    if scene.run.turn is not None and scene.run.integrator != "closed":
        about = {"long_name": "steps of the member, each as long as the others"}
        variables["steps"] = Variable(("member",), "i8", about)
    shared = is_shared(scene.body.mass, scene.body.centre) and not turned
    if any(implements(e, "energy") for e in scene.effects) or not shared:
        variables["mass"] = _by_member("mass", "kg")
        variables["centre"] = _by_member("centre of mass, principal axes", "m", ("axis",))
    return variables


def _start_variables(scene: Scene, carried: bool) -> dict[str, Variable]:
    """Spin, and attitude if it is followed, at t = 0."""
    spin = scene.start.which
    kind = OBSERVABLES[spin]
    name = f"start_{spin}"
    variables = {name: _by_member(f"{kind.long_name}, at t = 0", kind.units, ("axis",))}
    if carried:
        text = f"{OBSERVABLES['attitude'].long_name}, at t = 0"
        variables["start_attitude"] = _by_member(text, "1", ("quat",))
        if scene.start.by_euler_angles and not is_shared(scene.start.attitude):
            text = "Euler angles z-x-z (phi, theta, psi), at t = 0"
            variables["start_euler"] = _by_member(text, "rad", ("axis",))
    return variables


def attributes(scene: Scene, plan: Layout) -> dict[str, Any]:
    """Global attributes; the scene's TOML and the member range suffice for a rerun to the bit."""
    # a selection of the result has only the rows of its own members, so whatever was chosen by
    # looking at all of them is written down
    looked = {}
    if rows(*scene.quantities()) is not None:
        looked = {"turn_rate": plan.turn_rate, **plan.bounds()}
    text = _text(scene, **looked, **({} if plan.member_steps else {"dt": plan.dt}))
    steps = {"turn": scene.run.turn} if plan.member_steps else {"dt": plan.dt, "steps": plan.steps}
    if plan.head < plan.steps and not plan.member_steps:
        steps |= {"last_steps": plan.steps - plan.head, "last_dt": plan.last_dt}
    return {
        "Conventions": "CF-1.11",
        "title": scene.title,
        "source": f"rigidmc {VERSION}",
        "version": VERSION,
        "scene": text,
        "seed": scene.run.seed,
        "integrator": scene.run.integrator,
        **steps,
        "dtype": plan.dtype,
        "compensated": int(plan.compensated),
        **plan.bounds(),
        "parts_per_step": len(plan.form.parts) - 1 if plan.form else 0,
        **({"drawn": through} if (through := scene.drawn_through()) else {}),
        **(UNCOMPILED if plan.form is not None and is_uncompiled() else {}),
    }


@once
def _text(scene: Scene, /, **settings: Any) -> str:
    """The scene with other settings as TOML text."""
    return scene.with_run(**settings).dumps()


def lengths(plan: Shape) -> dict[str, Any]:
    """{dimension: size}; None for `flagged`, which grows."""
    bins = {name: edges.size - 1 for name, edges, _ in plan.watch.bins}
    times = {"time": plan.times.size, "thinned_time": plan.thinned.size}
    return {
        **bins,
        **times,
        "member": plan.members,
        "flagged": None,
        "effect": len(plan.labels),
        "component": 6,
        **{name: len(labels) for name, (labels, _) in DIMENSIONS.items()},
    }

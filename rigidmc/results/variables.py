"""The variables of a result: their dimensions, types and attributes."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel.block import ASSESS_INTERVAL
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.mechanics.euler_angles import TEXTBOOK, angle_names
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import Effect, facts, shape
from rigidmc.physics.observables import OBSERVABLES, outputs, title
from rigidmc.physics.observables.protocol import Growth
from rigidmc.physics.observables.saving import CENSORED, FOLLOWED, LAG, event_times
from rigidmc.scene.body import Body
from rigidmc.scene.derivatives import derivative_name, derivative_units
from rigidmc.scene.drifts import LAWS
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.recording import Recording, conservation, untracked_effects
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run
from rigidmc.scene.start import Start
from rigidmc.scene.start_tables import relative_components
from rigidmc.scene.vector_distributions import TensorRows


class Variable(NamedTuple):
    """One variable of a result: dimensions, type and attributes."""

    dims: tuple[str, ...]
    dtype: str
    attrs: dict[str, Any]


def _by_member(long_name: str, units: str, dims: tuple[str, ...] = (), **more: Any) -> Variable:
    """Return a float variable by members."""
    return Variable((*dims, "member"), "f8", {"units": units, "long_name": long_name, **more})


def saved_variables(effects: Sequence[Any], recording: Recording) -> dict[str, Variable]:
    """Return the variables recorded at save times, see `rigidmc.physics.observables.saving`."""
    conserved, variables = conservation(effects, recording.has_work), {}
    for name in recording.names:
        kind = recording.observable(name)
        attrs = {"units": kind.units, "long_name": title(kind)}
        if kind.conserved:
            attrs["conserved"] = conserved[kind.conserved]
        if name == "work":
            # the work of the other effects is in the energy
            attrs["booked"] = ", ".join(untracked_effects(effects)) or "none"
        word, dims = recording.retained[name], (*kind.dims, "member")
        if word == "full":
            variables[name] = Variable(("time", *dims), "f8", attrs)
        elif word == "thinned":
            variables[f"{name}_thinned"] = Variable(("thinned_time", *dims), "f8", attrs)
        elif word == "final":
            attrs |= {"long_name": f"{title(kind)}, at the end"}
            variables[f"{name}_final"] = Variable(dims, "f8", attrs)
    return variables


ROTATED = ("quat",)  # dimensions of attitudes, which change by a rotation


def derivative_variables(
    variables: Mapping[str, Variable],
    parameter_units: Sequence[str],
    rotated: Sequence[str] = ROTATED,
) -> dict[str, Variable]:
    """Return the variables with the derivatives of variables, {} without parameters.

    parameter_units : of each parameter, "" if unknown; units of derivatives are then unknown, too
    rotated : dimensions of attitudes

    The derivative of an attitude q is the vector of the rotation in body axes, 2 vec(q* dq/dp),
    with q* the conjugate of q.
    """
    derivatives: dict[str, Variable] = {}
    for name, (dims, dtype, attrs) in variables.items() if parameter_units else ():
        if dtype != "f8":  # labels and indices have no derivative
            continue
        units, text = attrs["units"], f"derivative of {attrs['long_name']}"
        if set(rotated) & {*dims}:
            units, text = "rad", f"{text}, as a rotation vector in body axes"
            dims = tuple("axis" if dim in rotated else dim for dim in dims)
        about = {"units": derivative_units(units, parameter_units), "long_name": text}
        if "" in parameter_units:
            del about["units"]
        derivatives[derivative_name(name)] = Variable(("parameter", *dims), "f8", about)
    return derivatives


def member_derivatives(
    variables: Mapping[str, Variable], recording: Recording, parameter_units: Sequence[str]
) -> dict[str, Variable]:
    """Return the variables by members with the derivatives of results over all steps; arguments as
    for `derivative_variables`.

    A mean of attitudes is not an attitude, so statistics of attitudes have derivatives of each
    component.
    """
    if not parameter_units:
        return {}
    some = {name: variables[name] for name in recording.differentiable}
    return derivative_variables(some, parameter_units, ())


def flagged_variables(recording: Recording) -> dict[str, Variable]:
    """Return the variables of flagged members, which keep all saves even if other members do
    not."""
    names = [name for name, word in recording.retained.items() if word != "full"]
    if not names:
        return {}
    text = {"long_name": "index of a member whose status is not ok"}
    variables = {"flagged_member": Variable(("flagged",), "i8", text)}
    for name in names:
        kind = recording.observable(name)
        text = {"units": kind.units, "long_name": f"{title(kind)}, of flagged members"}
        variables[f"{name}_flagged"] = Variable(("time", *kind.dims, "flagged"), "f8", text)
    return variables


def ensemble_variables(recording: Recording) -> dict[str, Variable]:
    """Return the variables of the whole ensemble."""
    variables = {}
    for label, histogram in recording.histograms:
        component = f", component {histogram.component + 1}" if histogram.of.endswith("]") else ""
        text = f"members by {title(recording.observable(histogram.name))}{component}"
        about = {"units": "1", "long_name": text}
        variables[label] = Variable(("time", f"{label}_bin"), "i8", about)
        for word in ("below", "above"):
            about = {"units": "1", "long_name": f"members {word} the bins of {label}"}
            variables[f"{label}_{word}"] = Variable(("time",), "i8", about)
    return variables


def member_variables(
    model: Model, run: Run, recording: Recording, has_attitude: bool
) -> dict[str, Variable]:
    """Return the variables with one value per member, which every result has.

    has_attitude : whether the run integrates the attitude
    """
    own_steps = run.turn is not None and run.integrator != "closed"
    variables = {
        **_health_variables(model.effects, recording.has_work),
        **_body_variables(model, own_steps),
    }
    for label, effect in label_effects(model.effects):
        for name, value in zip(effect._fields, effect, strict=True):
            size, turned = shape(effect, name), is_turned(model.body, effect, name)
            if turned or not is_shared(*(value if size else (value,))):
                axes = ", principal axes of the member" if turned else ""
                units = facts(effect).units.get(name, "1")
                variables[f"{label}_{name}"] = parameter_variable(label, name, size, units, axes)
    lags: dict[str, float] = {}
    for label, kind in recording.monitored:
        lags |= (times := event_times(label, kind))
        for name, (units, text, dims) in outputs(label, kind).items():
            method = {METHOD: kind.growth_method} if isinstance(kind, Growth) else {}
            more = _censored(name, times) | method
            variables[name] = _by_member(text, units, dims, **more)
    if lags:
        variables[FOLLOWED] = _by_member(_FOLLOWED, "s")
    return {**variables, **_start_variables(model.start, has_attitude)}


def describe_variables(
    model: Model, run: Run, recording: Recording, units: Sequence[str], has_attitude: bool
) -> dict[str, dict[str, Variable]]:
    """Return all variables of a result, in the groups of a `ResultLayout`.

    units : of the parameters of derivatives, see `derivative_variables`
    has_attitude : whether the run integrates the attitude
    """
    by_member = member_variables(model, run, recording, has_attitude)
    at_saves = saved_variables(model.effects, recording)
    of_flagged = flagged_variables(recording)
    return {
        "by_member": by_member | member_derivatives(by_member, recording, units),
        "at_saves": at_saves | derivative_variables(at_saves, units),
        "of_ensemble": ensemble_variables(recording),
        "of_flagged": of_flagged | derivative_variables(of_flagged, units),
    }


def variables_of(scene: Scene) -> dict[str, Variable]:
    """Return the variables by members of the results of a scene, without attitudes."""
    return member_variables(scene.model, scene.run, scene.recording, False)


# variables that results of earlier versions lack, and their replacements
NEWER = {FOLLOWED: np.nan, "drift_law": np.int8(LAWS["not_judged"])}
_FOLLOWED = (
    "time until which the member was followed: t_end, its stop, or its last passed health check"
)


def _censored(name: str, lags: Mapping[str, float]) -> dict[str, Any]:
    """Return the attributes that define the meaning of nan; lags : of the times of events."""
    lag = lags.get(name)
    if lag is None:
        return {}
    return {CENSORED: FOLLOWED, **({LAG: lag} if lag else {})}


# attribute of variables whose method has changed: results of another method are not alike
METHOD = "method"


def is_turned(body: Body, effect: Effect, name: str) -> bool:
    """Whether a parameter is fixed in the body and members differ in their principal axes. The
    result then has it in these axes, even if all members have the same parameter."""
    fixed = name in facts(effect).in_body and name not in facts(effect).hidden
    if not fixed or body.inertia_key != "tensor" or body.frame != "principal":
        return False
    return not all(isinstance(x, float) and x == 0.0 for x in getattr(effect, name))


def parameter_variable(
    label: str, name: str, size: int | None, units: str, axes: str = ""
) -> Variable:
    """Return the variable for a parameter of an effect that differs between members."""
    dims: tuple[str, ...] = () if size is None else ("axis",) if size == 3 else ("component",)
    return _by_member(f"{name} of {label}{axes}", units, dims)


def _health_variables(effects: Sequence[Any], has_work: bool) -> dict[str, Variable]:
    """Return the variables for drifts and status of the members."""
    conserved = conservation(effects, has_work)
    over = f"largest over every {ASSESS_INTERVAL}th step and all saves"
    drift = "relative to the energy at the start (at least 1e-3 of the energies in play)"
    energy = "|E - E(0)|"
    if has_work:
        drift += ", or to the largest kinetic energy if that is larger, plus the sum of all |work|"
        energy = f"|E - E(0) - work of {', '.join(untracked_effects(effects)) or 'none'}|"
    momentum = f"relative change of |L|^2 (1 for a body that starts at rest and moves), {over}"
    values = np.array(list(STATUSES.values()), "i1")
    values.flags.writeable = False  # all results of a scene share it
    status = {
        "long_name": "status of the member; a member that is not ok is frozen at the state of its "
        "last passed health check",
        "flag_values": values,
        "flag_meanings": " ".join(STATUSES),
    }
    law = {
        "long_name": "trend of the drifts of conserved quantities: rounding, bounded, or one way: "
        "in the second half of the run never far below the drift of the first",
        "flag_values": np.array(list(LAWS.values()), "i1"),
        "flag_meanings": " ".join(LAWS),
    }
    step = {
        "long_name": f"step of flagging, at most {ASSESS_INTERVAL} steps after the fault; -1 if ok",
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
        "status_time": _by_member("time of flagging; nan if ok", "s"),
    }


def _body_variables(model: Model, own_steps: bool) -> dict[str, Variable]:
    """Return the variables for moments; for steps that differ between members; for mass and centre
    if effects may need them."""
    text = "principal moments of inertia about the fixed point"
    variables = {"moments": _by_member(text, "kg m2", ("axis",))}
    turned = model.body.is_turned
    if turned:
        mean = "principal axes of the mean tensor"
        axes = mean if model.body.frame == "principal" else "axes in which the body is described"
        text = f"attitude of the member's principal axes in the {axes}"
        variables["principal_axes"] = _by_member(text, "1", ("quat",))
    if isinstance(model.body.moments, TensorRows):
        text = "elements xx, yy, zz, yz, zx, xy of the inertia tensor, described axes"
        variables["tensor"] = _by_member(text, "kg m2", ("component",))
    if own_steps:
        about = {"long_name": "number of steps of the member, all of equal length"}
        variables["steps"] = Variable(("member",), "i8", about)
    shared = is_shared(model.body.mass, model.body.centre) and not turned
    if any(implements(e, "energy") for e in model.effects) or not shared:
        variables["mass"] = _by_member("mass", "kg")
        axes = "principal axes" if model.body.frame == "principal" else "body axes"
        variables["centre"] = _by_member(f"centre of mass, {axes}", "m", ("axis",))
    return variables


def _start_variables(start: Start, has_attitude: bool) -> dict[str, Variable]:
    """Return the variables for spin, and attitude if the run integrates it, at t = 0."""
    spin = start.spin_name
    kind = OBSERVABLES[spin]
    name = f"start_{spin}"
    variables = {name: _by_member(f"{kind.long_name}, at t = 0", kind.units, ("axis",))}
    if has_attitude:
        text = f"{OBSERVABLES['attitude'].long_name}, at t = 0"
        variables["start_attitude"] = _by_member(text, "1", ("quat",))
        if start.has_euler_angles and not is_shared(start.attitude):
            text, more = "Euler angles z-x-z (phi, theta, psi), at t = 0", {}
            if start.sequence != TEXTBOOK or "attitude" in start.relative_to_orbit:
                text, more = _angles_text(start), {"sequence": start.sequence}
            variables["start_euler"] = _by_member(text, "rad", ("axis",), **more)
    for key in relative_components(start):
        text = f"{OBSERVABLES[key].long_name}, relative to the frame of the orbit, at t = 0"
        dims = ("quat",) if key == "attitude" else ("axis",)
        variables[f"start_relative_{key}"] = _by_member(text, OBSERVABLES[key].units, dims)
    return variables


def _angles_text(start: Start) -> str:
    """Describe the Euler angles of a start."""
    relative = "attitude" in start.relative_to_orbit
    frame = " relative to the frame of the orbit" if relative else ""
    names = ", ".join(angle_names(start.sequence))
    return f"Euler angles {start.sequence} ({names}){frame}, at t = 0"

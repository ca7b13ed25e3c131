"""The layout of a result: which variables, their dimensions and attributes. A Dataset in memory and a netCDF file are the same."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.effects import labelled
from rigidmc.effects.parameters import shape
from rigidmc.engine.cpu import LOOK
from rigidmc.engine.layout import STATUSES
from rigidmc.observables import OBSERVABLES, outputs
from rigidmc.observables.protocol import DIMENSIONS
from rigidmc.scene.conservation import booked, conservation
from rigidmc.scene.quantities import is_shared, rows
from rigidmc.version import VERSION


class Variable(NamedTuple):
    """One variable of a result: dimensions, type and attributes."""

    dims: tuple
    dtype: str
    attrs: dict[str, Any]


def coordinates(plan):
    """Coordinates of a result as {name: (dims, values, attrs)}."""
    effects = (
        {"effect": (("effect",), np.array(plan.labels), {"long_name": "effect of the scene"})}
        if plan.labels
        else {}
    )
    about = {"units": "s", "long_name": "time of what is thinned"}
    thinned = (
        {"thinned_time": (("thinned_time",), plan.times[plan.thinned], about)}
        if plan.thinned.size
        else {}
    )
    bins = {
        name: (
            (name,),
            0.5 * (edges[1:] + edges[:-1]),
            {"units": units, "long_name": "middle of the bin", "width": edges[1] - edges[0]},
        )
        for name, edges, units in plan.watch.bins
    }
    return {
        **effects,
        **bins,
        "member": (
            ("member",),
            np.arange(plan.first, plan.first + plan.members),
            {"long_name": "index of the member"},
        ),
        "time": (("time",), plan.times, {"units": "s", "long_name": "time"}),
        **thinned,
        **{
            name: ((name,), np.array(labels), {"long_name": text})
            for name, (labels, text) in DIMENSIONS.items()
        },
    }


def saved_variables(scene):
    """Variables of what is recorded at save times, see `rigidmc.observables.keep`: {name: Variable}."""
    kept, variables = conservation(scene), {}
    for name in scene.saved():
        kind = OBSERVABLES[name]
        attrs = {"units": kind.units, "long_name": kind.long_name}
        if kind.conserved:
            attrs["conserved"] = kept[kind.conserved]
        if name == "work":
            attrs["booked"] = (
                ", ".join(booked(scene)) or "none"
            )  # the others' work is told by energy
        word = scene.kept()[name]
        if word == "full":
            variables[name] = Variable(("time", *kind.dims, "member"), "f8", attrs)
        elif word == "thinned":
            variables[f"{name}_thinned"] = Variable(
                ("thinned_time", *kind.dims, "member"), "f8", attrs
            )
        elif word == "final":
            text = {"long_name": f"{kind.long_name}, at the end"}
            variables[f"{name}_final"] = Variable((*kind.dims, "member"), "f8", {**attrs, **text})
    return variables


def is_rounded(scene, dims, dtype):
    """Whether a variable has only so many digits in files: saves over time, never what a run could start from nor those of flagged members."""
    return (
        scene.run.digits is not None
        and dims[0] in ("time", "thinned_time")
        and dims[-1] == "member"
        and dtype == "f8"
    )


def flagged_variables(scene):
    """Variables of flagged members alone, of which all saves are kept though not of the others: {name: Variable}."""
    names = [name for name, word in scene.kept().items() if word != "full"]
    if not names:
        return {}
    found = {
        "flagged_member": Variable(
            ("flagged",), "i8", {"long_name": "index of a member whose status is not ok"}
        )
    }
    for name in names:
        kind = OBSERVABLES[name]
        text = {"units": kind.units, "long_name": f"{kind.long_name}, of flagged members"}
        found[f"{name}_flagged"] = Variable(("time", *kind.dims, "flagged"), "f8", text)
    return found


def bytes_of_a_member(scene, plan):
    """Bytes of a member in a result, before they are compressed: (of those that all have the same value, of the others)."""
    same = other = 0
    for name, (dims, dtype, _) in {
        **member_variables(scene, plan.carried),
        **saved_variables(scene),
    }.items():
        size = (
            int(np.prod([1 if d == "member" else length(d, plan) for d in dims]))
            * np.dtype(dtype).itemsize
        )
        same, other = (same + size, other) if name in plan.constant else (same, other + size)
    return same, other


def ensemble_variables(scene):
    """Variables of the ensemble as a whole: {name: Variable}."""
    found = {}
    for label, one in scene.histograms():
        text = f"members by {OBSERVABLES[one.name].long_name}{f', component {one.component + 1}' if one.of.endswith(']') else ''}"
        found[label] = Variable(("time", f"{label}_bin"), "i8", {"units": "1", "long_name": text})
        for word in ("below", "above"):
            found[f"{label}_{word}"] = Variable(
                ("time",), "i8", {"units": "1", "long_name": f"members {word} the bins of {label}"}
            )
    return found


def member_variables(scene, carried):
    """Variables with one value per member that every result has: {name: Variable}."""
    kept = conservation(scene)
    over = f"largest over every {LOOK}th step and all saves"
    drift = "relative to the start's energy (to 1e-3 of the energies in play where that is smaller)"
    energy = "|E - E(0)|"
    if "work" in scene.run.save:
        drift += " and the sizes of all works"
        energy = f"|E - E(0) - work of {', '.join(booked(scene)) or 'none'}|"
    variables = {
        "energy_drift_max": Variable(
            ("member",),
            "f8",
            {
                "units": "1",
                "long_name": f"{energy} {drift}, {over}",
                "conserved": kept["energy_drift"],
            },
        ),
        "l2_drift_max": Variable(
            ("member",),
            "f8",
            {
                "units": "1",
                "long_name": f"relative change of |L|^2 (absolute for a top that starts at rest), {over}",
                "conserved": kept["l2"],
            },
        ),
        "status": Variable(
            ("member",),
            "i1",
            {
                "long_name": "health of the member; one that is not ok is frozen at its last good state, seen at the look before",
                "flag_values": np.array(list(STATUSES.values()), "i1"),
                "flag_meanings": " ".join(STATUSES),
            },
        ),
        "status_step": Variable(
            ("member",),
            "i8",
            {
                "long_name": f"steps made when a member was found not to be ok, at most {LOOK} after it happened; -1 for those that are",
                "units": "1",
            },
        ),
        "status_time": Variable(
            ("member",),
            "f8",
            {
                "units": "s",
                "long_name": "time at which a member was found not to be ok; nan for those that are",
            },
        ),
        "moments": Variable(
            ("axis", "member"),
            "f8",
            {"units": "kg m2", "long_name": "principal moments of inertia about the fixed point"},
        ),
    }
    if scene.run.turn is not None and scene.run.integrator != "closed":
        variables["steps"] = Variable(
            ("member",), "i8", {"long_name": "steps of the member, each as long as the others"}
        )
    if any(hasattr(e, "energy") for e in scene.effects) or not is_shared(
        scene.body.mass, scene.body.centre
    ):
        variables["mass"] = Variable(("member",), "f8", {"units": "kg", "long_name": "mass"})
        variables["centre"] = Variable(
            ("axis", "member"), "f8", {"units": "m", "long_name": "centre of mass, principal axes"}
        )
    for label, effect in labelled(scene.effects):
        for name, value in zip(effect._fields, effect, strict=True):
            size = shape(effect, name)
            if not is_shared(*(value if size else (value,))):
                attrs = {
                    "units": getattr(effect, "units", {}).get(name, "1"),
                    "long_name": f"{name} of {label}",
                }
                dims: tuple[str, ...] = (
                    () if size is None else ("axis",) if size == 3 else ("component",)
                )
                variables[f"{label}_{name}"] = Variable((*dims, "member"), "f8", attrs)
    for label, one in scene.watched():
        for name, (units, text, dims) in outputs(label, one).items():
            variables[name] = Variable((*dims, "member"), "f8", {"units": units, "long_name": text})
    which = "omega" if scene.start.momentum is None else "momentum"
    kind = OBSERVABLES[which]
    variables[f"start_{which}"] = Variable(
        ("axis", "member"), "f8", {"units": kind.units, "long_name": f"{kind.long_name}, at t = 0"}
    )
    if carried:
        kind = OBSERVABLES["attitude"]
        variables["start_attitude"] = Variable(
            ("quat", "member"), "f8", {"units": "1", "long_name": f"{kind.long_name}, at t = 0"}
        )
        if scene.start.by_euler_angles and not is_shared(scene.start.attitude):
            attrs = {"units": "rad", "long_name": "Euler angles z-x-z (phi, theta, psi), at t = 0"}
            variables["start_euler"] = Variable(("axis", "member"), "f8", attrs)
    return variables


def attributes(scene, plan):
    """Global attributes; the scene's TOML and the member range are enough to run it again to the same bits."""
    # a selection of the result has the rows of its own members only: what was chosen by looking at all of them is written down
    looked = (
        {} if rows(*scene.quantities()) is None else {"turn_rate": plan.turn_rate, **plan.bounds()}
    )
    resolved = scene.with_run(**looked, **({} if plan.own else {"dt": plan.dt}))
    steps = {"turn": scene.run.turn} if plan.own else {"dt": plan.dt, "steps": plan.steps}
    return {
        "Conventions": "CF-1.11",
        "title": scene.title,
        "source": f"rigidmc {VERSION}",
        "version": VERSION,
        "scene": resolved.dumps(),
        "seed": scene.run.seed,
        "integrator": scene.run.integrator,
        **steps,
        "dtype": plan.dtype,
        "compensated": int(plan.compensated),
        **plan.bounds(),
        "parts_per_step": len(plan.form.parts) - 1 if plan.form else 0,
        **({"drawn": through} if (through := scene.drawn_through()) else {}),
    }


def length(dim, plan):
    """Size of a dimension."""
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
    }[dim]

"""What a run would take, before it is run; and what this machine is."""

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from rigidmc.effects import EFFECTS, labelled
from rigidmc.effects.parameters import given
from rigidmc.engine.cache import cache_folder
from rigidmc.engine.compile_time import listed, rounded, seconds
from rigidmc.engine.machine import this_machine, threads_available, vector_bits
from rigidmc.engine.operations import torque_operations, unpacked
from rigidmc.engine.program import lanes_for
from rigidmc.observables import OBSERVABLES
from rigidmc.planning.job import program_of
from rigidmc.planning.notes import notes
from rigidmc.planning.plan import prepare
from rigidmc.planning.tolerance.choose import resolved
from rigidmc.planning.tolerance.costs import cost_per_step
from rigidmc.planning.tolerance.effect_costs import prices, some_of
from rigidmc.runs.capacity import free_memory, in_words, sizes
from rigidmc.runs.shards import members_of
from rigidmc.scene.body import IDENTITY
from rigidmc.scene.conservation import conservation
from rigidmc.scene.laws import word_of
from rigidmc.scene.parameters import parameters
from rigidmc.scene.quantities import Distribution, Grid


def describe(scene, threads):
    """What a scene is, which effects are compiled, and what a run of it would take."""
    asked = scene
    scene, chosen = resolved(asked, threads)
    plan = prepare(scene, threads=threads)
    run = scene.run
    lines = [f"{scene.title}: {scene.summary}".rstrip(": ")]
    if scene.source:
        lines.append(f"source       {scene.source}")
    lines.append(
        f"body         moments {_words(scene.body.moments)} kg m2, mass {_words(scene.body.mass)} kg, centre {_words(scene.body.centre)} m"
    )
    if scene.body.axes != IDENTITY:
        lines.append(
            "             principal axes (columns) "
            + "; ".join(" ".join(f"{x:.4g}" for x in row) for row in scene.body.axes)
        )
    which = "omega" if scene.start.momentum is None else "momentum"
    words = {"uniform": "uniform on SO(3)", "ensemble": "of the momentum's ensemble"}
    attitude = (
        words[scene.start.attitude]
        if isinstance(scene.start.attitude, str)
        else _words(scene.start.attitude)
    )
    lines.append(
        f"start        {which} {_words(getattr(scene.start, which))} {OBSERVABLES[which].units}; attitude {attitude}"
    )
    if through := scene.drawn_through():
        lines.append(f"drawn        {through}")
    compiled = [
        f"{label}({', '.join(f'{k} = {_words(getattr(e, k))}' for k in given(e))})"
        for label, e in labelled(scene.effects)
    ]
    lines.append(
        f"compiled     {run.integrator}; effects: {', '.join(compiled) or 'none (free body)'}; {'with' if plan.carried else 'no'} attitude"
    )
    for effect in (e for e in scene.effects if type(e) not in EFFECTS.values()):
        how = (
            f"not packed: {why}"
            if (why := unpacked(effect))
            else "packed: members side by side, as the built-in ones"
        )
        lines.append(f"own effect   {type(effect).__name__}: {torque_operations(effect)}, {how}")
    kept = conservation(scene)
    booked = ", but its work is booked" if kept["energy"] != kept["energy_drift"] else ""
    lines.append(f"conserved    energy: {kept['energy']}{booked}; |L|^2: {kept['l2']}")
    parts = len(plan.form.parts) - 1 if plan.form else 1
    if plan.limits:
        lines.append(f"flagged      {_limits(plan.limits)}")
    pieces = f" of {parts} parts each" if parts > 1 else ""
    how = (
        f"dt = {plan.dt:.6g} s"
        if not plan.own
        else f"its own for each member, {plan.mean_steps:,.1f} in the mean of the pilot"
    )
    steps = "" if plan.own else f"{plan.steps:,}"
    lines.append(
        f"steps        {steps}{pieces}, {how}, t_end = {run.t_end:g} s, omega dt <= {plan.angle:.2g} rad".replace(
            "  ,", "  "
        )
    )
    kept = [f"{word} of {name}" for name, word in scene.kept().items() if word != "full"]
    less = f"; kept: {', '.join(kept)}, and all of flagged members" if kept else ""
    if plan.dtype == "float32":
        lines.append(f"float32      {single_precision(plan)}")
    lines.append(
        f"saves        {plan.times.size:,} times of {', '.join(run.save) or 'nothing'}{less}"
    )
    memory, lean, file = sizes(scene, plan, threads)
    free = free_memory()
    lines.append(f"members      {plan.members:,} in blocks of {plan.block:,} on {threads} threads")
    lines.append(
        f"memory       {in_words(memory)} as a Dataset in memory, {in_words(lean)} with -o FILE"
        + (f"; {in_words(free)} are free" if free is not None else "")
    )
    lines.append(
        f"file         {in_words(file)}"
        + (" before it is compressed" if run.compress or run.digits is not None else "")
    )
    shard = members_of(scene, plan)[1]
    lines.append(
        f"directory    {-(-plan.members // shard):,} shards of {shard:,} members with -o RUN/"
    )
    lines += chosen.lines(plan.members) if chosen else []
    if plan.form is None:
        return "\n".join([*lines, "cost         closed form at every save"])
    lines.append(f"code         {to_compile(program_of(scene, plan, ask=True))}")
    cost = cost_per_step(scene, plan)
    seconds = cost * 1e-9 * plan.members * plan.mean_steps / threads
    lines.append(
        f"cost         {cost:.2f} ns per member-step on one thread (measured now); about {seconds:.2g} s for the steps on {threads} threads"
    )
    quiet = cost
    if plan.watch.rows or "work" in run.save:
        quiet = cost_per_step(*some_of(scene, plan, range(len(scene.effects))))
    watched = [label for label, one in scene.watched() if not hasattr(one, "ensemble")]
    if watched:
        more = " and the ledger of work" * ("work" in run.save)
        lines.append(f"watched      {', '.join(watched)}{more}: {cost - quiet:.2f} ns of it")
    if scene.effects:
        free, none, added, noise, predicted = prices(scene, plan)
        each = "".join(f", {label} {more}" for label, more in added.items())
        each += f", noise {noise:.2f} ns" if noise else ""
        if "work" in run.save and not watched:
            each += f", ledger of work {cost - quiet:.2f} ns"
        lines.append(
            f"price        {free:.2f} ns without effects ({none}){each}: {predicted:.2f} ns predicted, {quiet / predicted:.2f} of that measured"
        )
    lines.append(f"parameters   {', '.join(parameters(scene))}")
    lines += [f"note         {note}" for note in notes(asked, plan)]
    return "\n".join(lines)


def to_compile(program):
    """What of a program is to be compiled, and how long that takes, in words."""
    missing = program.missing()
    if not missing:
        return "nothing to compile"
    known = seconds(program.label, missing, program.effects, program.theirs())
    return f"to be compiled, on first use: {listed(program.label, missing)}: about {rounded(known)} s (done now, to measure the cost)"


def single_precision(plan):
    """What float32 costs, in words."""
    turned = plan.angle * plan.mean_steps
    error = (
        6e-8 * turned
    )  # median of 64 heavy tops by rk4: 9.6e-7, 4.0e-6, 2.0e-5 after 16, 63, 250 rad, whatever the step
    words = f"rounding a body's numbers to 6e-8 misplaces it by {error:.1e} rad in a turn of {turned:.3g} rad, whatever the step"
    if not plan.compensated:
        error = max(
            error, 1.5e-8 * plan.mean_steps
        )  # rk4 over 10 s without remainders: 7.2e-6 in 512 steps, 1.9e-3 in 131,072
        words += f"; sums cannot keep their remainders here: about 1.5e-8 more for each step, {1.5e-8 * plan.mean_steps:.1e} in all"
    return f"about {max(0.0, -np.log10(max(error, 6e-8))):.0f} digits at t_end in regular motion: {words}"


def _limits(limits):
    """What flags a member, in words."""
    words = {
        "energy": "energy drifts by",
        "l2": "|L|^2 drifts by",
        "lz": "L_z drifts by",
        "turn": "|omega| dt is",
    }
    units = {"turn": " rad"}
    parts = [
        f"{word} more than {getattr(limits, name):.2g}{units.get(name, '')}"
        for name, word in words.items()
        if getattr(limits, name) < np.inf
    ]
    return (
        f"a member, where {'its ' + ', '.join(parts) + ', or ' if parts else ''}it turns non-finite"
    )


def machine_facts():
    """Facts of this machine and installation that decide speed and bits."""
    folder = cache_folder()
    cached = [
        os.path.join(top, f)
        for top, _, files in os.walk(folder)
        for f in files
        if f.endswith(".nbc")
    ]
    facts = {
        "cpu": _cpu(),
        "cores": f"{threads_available()} usable of {os.cpu_count()}",
        "code": f"generated for {this_machine()[1]}",
        "vectors": f"{vector_bits()} bit, {vector_bits() // 64} float64 lanes; {lanes_for('float64')} members are worked on side by side",
        "threads": threads_available(),
        "kernel cache": f"{folder} ({len(cached)} kernels, {sum(map(os.path.getsize, cached)) / 1e6:.1f} MB)",
        "python": sys.version.split()[0],
        "system": platform.platform(),
    }
    for package in (
        "rigidmc",
        "numpy",
        "numba",
        "llvmlite",
        "xarray",
        "netCDF4",
        "scipy",
        "pydantic",
        "matplotlib",
    ):
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "not installed"
    return facts


def _cpu():
    try:
        with open("/proc/cpuinfo") as file:
            return next(
                line.split(":", 1)[1].strip() for line in file if line.startswith("model name")
            )
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _words(value):
    """A quantity or a tuple of them for people."""
    if hasattr(value, "_fields"):
        return f"{word_of(value)}({', '.join(f'{k} = {v}' if isinstance(v, int) else f'{k} = {_words(v)}' for k, v in value._asdict().items() if v is not None)})"
    if isinstance(value, tuple):
        return "(" + ", ".join(_words(v) for v in value) + ")"
    if isinstance(value, Grid):
        return f"grid({value.low:g} to {value.high:g}, {value.count})"
    if isinstance(value, Distribution):
        parameters = (
            value.parameters
            if value.name in ("normal", "uniform")
            else [f"{k} = {v:g}" for k, v in value.parameters]
        )
        return (
            f"{value.name}({', '.join(p if isinstance(p, str) else f'{p:g}' for p in parameters)})"
        )
    return f"{value:.6g}" if isinstance(value, float) else f"one of {value.size:,} rows"

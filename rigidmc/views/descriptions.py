"""Descriptions of scenes and bodies as text: `rigidmc show` and `rigidmc body`.

For a scene: its parts, the kernels to compile, and the time, memory and disk of a run. For a body:
mass, centre of mass, tensor, principal axes and the stability of rotations.
"""

from typing import Any

import numpy as np

from rigidmc.engine.compile_time import list_kernels, seconds, seconds_text
from rigidmc.engine.cuda.devices import is_gpu
from rigidmc.engine.inspection import torque_operations, why_scalar
from rigidmc.engine.program import Program
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics import inertia
from rigidmc.mechanics.euler_angles import TEXTBOOK, angle_names
from rigidmc.mechanics.impossible import can_exist
from rigidmc.physics.effects import EFFECTS, label_effects
from rigidmc.physics.effects.protocol import user_parameters
from rigidmc.physics.integrators.protocol import has_extra_state
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.physics.observables.protocol import EnsembleObservable
from rigidmc.planning.model_notes import body_notes
from rigidmc.planning.plan import Plan
from rigidmc.planning.saves import sparse_saves
from rigidmc.planning.scheme import Limits
from rigidmc.results.labels import count_text, units_text, with_units
from rigidmc.runs.assemble import derivatives_on, make_program
from rigidmc.runs.directory.shards import shard_members, shorten_shards
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.price import cost_per_step, prices, some_of
from rigidmc.runs.resources import BASE, block_of, free_memory, in_words, moved_at_once, needs
from rigidmc.scene.body import IDENTITY, Body
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.parameters import parameter_names
from rigidmc.scene.quantities import Grid
from rigidmc.scene.sampling import drawn_through
from rigidmc.scene.save_times import SaveTimes
from rigidmc.scene.scene import Scene
from rigidmc.scene.vector_distributions.protocol import VectorDistribution


def describe_scene(scene: Scene, threads: int, device: str = "cpu") -> str:
    """Describe a scene, the kernels to compile, and the time, memory and disk of a run."""
    run = prepare_scene(scene, scene.run.members)
    lines = [
        *_physics(run.scene),
        *_compiled(run),
        *_steps(run, scene.run.every, device),
        *_room(run, threads, device),
    ]
    if (chosen := run.choice) is not None:
        seconds = run.members.size / chosen.members_per_second(threads)
        lines += chosen.lines(run.members.size, seconds)
    if run.plan.scheme is None:
        return "\n".join([*lines, "cost         closed form at every save"])
    lines += _cost(run, threads, device)
    lines.append(f"parameters   {', '.join(parameter_names(run.scene.model))}")
    lines += [f"note         {note}" for note in run.notes]
    return "\n".join(lines)


def outline(scene: Scene) -> list[str]:
    """Describe a scene without measuring; the first line is the title."""
    lines = _physics(scene)
    if scene.run.integrator == "auto":  # the choice needs measurements
        return lines
    run = prepare_scene(scene, scene.run.members)
    prices = [
        f"{label} {torque_operations(effect)}"
        for label, effect in label_effects(scene.effects)
        if type(effect) in EFFECTS.values()
    ]
    price = [f"price        {'; '.join(prices)}"] if prices else []
    members = [f"members      {run.members.size:,}, seed {scene.run.seed}"]
    return [*lines, *_compiled(run), *price, *_steps(run, scene.run.every), *members]


def body_lines(body: Body) -> list[str]:
    """Describe moments, mass, centre of mass and principal axes."""
    lines = [
        f"body         moments {_words(body.moments)} kg m², mass {_words(body.mass)} kg,"
        f" centre {_words(body.centre)} m"
    ]
    if body.axes != IDENTITY:
        rows = "; ".join(" ".join(f"{x:.4g}" for x in row) for row in body.axes)
        lines.append(f"             principal axes (columns) {rows}")
    return lines + _axes_lines(body)


def _axes_lines(body: Body) -> list[str]:
    """Describe the axes of the scene, if these differ from the principal axes."""
    if body.axes == IDENTITY and not body.is_turned:
        return []
    # the nanoseconds are measured by `python -m bench axes`
    steps = "; steps are in the principal axes, and turning adds 3 ns to a save or monitored step"
    steps = steps if body.frame == "described" else ""
    return [f"axes         start, effects and results are in the {body.frame} axes{steps}"]


def _physics(scene: Scene) -> list[str]:
    """Describe title, source, body and start."""
    lines, start = [f"{scene.title}: {scene.summary}".rstrip(": ")], scene.start
    if scene.source:
        lines.append(f"source       {scene.source}")
    lines += body_lines(scene.body)
    name = "omega" if start.momentum is None else "momentum"
    spin = f"{name} {_words(getattr(start, name))} {units_text(OBSERVABLES[name].units)}"
    named = {"uniform": "uniform on SO(3)", "ensemble": "from the momentum's ensemble"}
    attitude = start.attitude
    attitude = named[attitude] if isinstance(attitude, str) else _words(attitude)
    if start.sequence != TEXTBOOK:
        attitude += f" rad ({start.sequence}: {', '.join(angle_names(start.sequence))})"
    if "attitude" in start.relative_to_orbit:
        attitude += " from the frame of the orbit"
    if name in start.relative_to_orbit:
        spin += " relative to the frame of the orbit"
    lines.append(f"start        {spin}; attitude {attitude}")
    if through := drawn_through(scene.model, scene.run):
        lines.append(f"drawn        {through}")
    return lines


def _compiled(run: PreparedRun) -> list[str]:
    """Describe the integrator, the effects and the conserved quantities."""
    scene, facts = run.scene, run.plan.conserved
    effects = [
        f"{label}({', '.join(f'{k} = {_words(getattr(e, k))}' for k in user_parameters(e))})"
        for label, e in label_effects(scene.effects)
    ]
    words = ", ".join(effects) or "none (free body)"
    attitude = "with" if run.plan.has_attitude else "without"
    lines = [f"compiled     {scene.run.integrator}; effects: {words}; {attitude} attitude"]
    for effect in scene.effects:
        if type(effect) not in EFFECTS.values():
            why = why_scalar(effect)
            how = f"not packed: {why}" if why else "packed: members side by side, as if built-in"
            operations = torque_operations(effect)
            lines.append(f"custom       {type(effect).__name__}: {operations}, {how}")
    booked = ", but its work is recorded" if facts["energy"] != facts["energy_drift"] else ""
    lines.append(f"conserved    energy: {facts['energy']}{booked}; |L|^2: {facts['l2']}")
    return lines


def _steps(prepared_run: PreparedRun, every: SaveTimes | None, device: str = "cpu") -> list[str]:
    """Describe the limits that flag a member, the steps and the saved variables.

    every : as in the scene
    """
    layout, plan, units = prepared_run.layout, prepared_run.plan, prepared_run.units
    plan = plan if units is None else units.back(plan)
    scene, run, grid = layout.scene, layout.scene.run, plan.grid
    lines = [f"flagged      {_limits(plan.limits)}"] if plan.limits else []
    parts = len(plan.scheme.substeps) - 1 if plan.scheme else 1
    pieces = f" of {parts} parts each" if parts > 1 else ""
    end = f"t_end = {run.t_end:g} s, omega dt <= {plan.angle:.2g} rad"
    if plan.has_member_steps:
        length = f"different for each member, {plan.mean_steps:,.1f} on average in the pilot"
        lines.append(f"steps        {f'{pieces.strip()}, ' if pieces else ''}{length}, {end}")
    else:
        less = ""
        if grid.is_shortened and plan.scheme:
            less = f" (last {grid.steps - grid.head:,}: {grid.last_dt:.6g} s)"
        lines.append(f"steps        {grid.steps:,}{pieces}, dt = {grid.dt:.6g} s{less}, {end}")
    if plan.run.dtype == "float32":
        lines.append(f"float32      {single_precision(plan)}")
    keep = [
        f"{word} of {name}" for name, word in layout.recording.retained.items() if word != "full"
    ]
    less = f"; kept: {', '.join(keep)}, and everything of flagged members" if keep else ""
    saved = ", ".join(run.save) or "nothing"
    if every is None and run.every is not None:
        less = f", {run.every:.6g} s apart: chosen to plot, unless run.every is set"
    elif isinstance(every, str):
        less = f", {run.every:.6g} s apart: {every}{less}"
    lines.append(f"saves        {saved} at {count_text(grid.saves, 'time')}{less}")
    if plan.wrt:
        made = derivatives_on(device, plan)
        parameters = count_text(len(plan.wrt), "parameter")
        each = f"{count_text(made.passes, 'pass', 'passes')} of {made.at_once}"
        lines.append(f"derivatives  {parameters}: {each}; d_NAME by {', '.join(plan.wrt)}")
    if (sparse := sparse_saves(scene.model, run)) is not None:
        name, turn = sparse
        lines.append(
            f"             {name} {turn.who()} between saves: lines through the saves misrepresent"
            f" the motion; use every <= {turn.every:g} s"
        )
    return lines


def _room(run: PreparedRun, threads: int, device: str) -> list[str]:
    """Describe members, blocks, memory and files."""
    members, settings = run.members.size, run.scene.run
    size = block_of(run, threads, device, False)
    memory, with_file, file = needs(run, members, size, threads)
    free = free_memory()
    has = f"; {in_words(free)} free" if free is not None else ""
    packed = settings.compress or settings.digits is not None
    block, shard = shard_members(run)
    few = shorten_shards(run, block, shard, device=device)[1]
    shards = count_text(-(-members // few), "shard")
    shards += f" of {count_text(few, 'member')} with -o RUN/"
    if few != shard:
        shards += f", limited by time; {-(-members // shard):,} of {shard:,} with --shards"
    return [
        f"members      {members:,} in blocks of {size:,} on {count_text(threads, 'thread')}",
        f"memory       {in_words(memory)} as a Dataset in memory, {in_words(with_file)} with"
        f" -o FILE, including {in_words(BASE)} for interpreter and libraries{has}",
        f"file         {in_words(file)}{' before compression' if packed else ''}",
        f"directory    {shards}",
    ]


def _cost(run: PreparedRun, threads: int, device: str) -> list[str]:
    """Describe the kernels to compile, the time per step, and the cost of observables and
    effects."""
    plan, recorded = run.plan, run.plan.recording
    program = make_program(plan, device, compiled=False)
    assert program is not None  # the caller handles closed forms
    lines = [f"code         {to_compile(program)}"]
    cost = cost_per_step(run, device)
    total = cost * 1e-9 * moved_at_once(run.members.size, threads, device) * plan.mean_steps
    made = run.program(device)
    assert made is not None
    place, every = made.places(threads)
    digits = ".3g" if is_gpu(device) else ".2f"
    lines.append(
        f"cost         {cost:{digits}} ns per member-step on {place} (measured now);"
        f" about {total:.2g} s for the steps on {every}"
    )
    works, quiet, effects = recorded.has_work, cost, plan.model.effects
    if plan.monitors.rows or works:
        quiet = cost_per_step(some_of(run, range(len(effects))), device)
    monitored = [
        label for label, kind in recorded.monitored if not isinstance(kind, EnsembleObservable)
    ]
    if monitored:
        more = " and the ledger of work" if works else ""
        names = ", ".join(monitored)
        lines.append(f"monitored    {names}{more}: {cost - quiet:.2f} ns of this cost")
    if effects:
        free, none, added, noise, predicted = prices(run)
        each = "".join(f", {label} {operations}" for label, operations in added.items())
        each += f", noise {noise:.2f} ns" if noise else ""
        each += f", ledger of work {cost - quiet:.2f} ns" if works and not monitored else ""
        lines.append(
            f"price        {free:.2f} ns without effects ({none}){each}:"
            f" {predicted:.2f} ns predicted, measured {quiet / predicted:.2f} times that"
        )
    return lines


def to_compile(program: Program) -> str:
    """Describe the kernels of a program that are not in the cache, and their compile time."""
    missing = program.missing()
    if not missing:
        return "nothing to compile"
    pieces = list_kernels(program.label, missing)
    time = seconds_text(seconds(program.label, missing, program.effects, program.helper_share()))
    return f"to compile at first use: {pieces}: about {time} s (done now, to measure the cost)"


def single_precision(plan: Plan) -> str:
    """Describe the loss of accuracy with float32."""
    angle = plan.angle * plan.mean_steps
    # median of 64 heavy tops by rk4: 9.6e-7, 4.0e-6, 2.0e-5 after 16, 63, 250 rad at any step
    error = 6e-8 * angle
    words = (
        f"rounding the state to 6e-8 turns the body by {error:.1e} rad after {angle:.3g} rad of"
        " motion, at any step"
    )
    if not plan.compensated and not (plan.scheme and has_extra_state(plan.scheme.integrator)):
        # rk4 over 10 s without remainders: 7.2e-6 in 512 steps, 1.9e-3 in 131,072
        drift = 1.5e-8 * plan.mean_steps
        error = max(error, drift)
        words += (
            "; this integrator does not compensate sums: about 1.5e-8 more per step,"
            f" {drift:.1e} in total"
        )
    digits = max(0.0, -np.log10(max(error, 6e-8)))
    return f"about {digits:.0f} digits at t_end in regular motion: {words}"


def _limits(limits: Limits) -> str:
    """Describe the limits that flag a member."""
    words = {
        "energy drifts by": (limits.energy, ""),
        "|L|^2 drifts by": (limits.l2, ""),
        "L_z drifts by": (limits.lz, ""),
        "|omega| dt is": (limits.turn, " rad"),
    }
    parts = [
        f"{word} more than {limit:.2g}{unit}"
        for word, (limit, unit) in words.items()
        if limit < np.inf
    ]
    bounds = f"its {', '.join(parts)}, or " if parts else ""
    return f"a member if {bounds}it becomes non-finite"


def _words(value: Any) -> str:
    """Write a quantity or a tuple of quantities as text."""
    if isinstance(value, VectorDistribution):
        fields = {k: v for k, v in value.as_dict().items() if v is not None}
        words = [f"{k} = {v if isinstance(v, int) else _words(v)}" for k, v in fields.items()]
        return f"{value.name}({', '.join(words)})"
    if isinstance(value, tuple):
        if len(value) == 6 and all(isinstance(v, np.ndarray) for v in value):  # tensors
            return _words(value[0])
        return f"({', '.join(_words(v) for v in value)})"
    if isinstance(value, Grid):
        return f"grid({value.low:g} to {value.high:g}, {value.count})"
    if isinstance(value, Distribution):
        return value.words()
    return f"{value:.6g}" if isinstance(value, float) else f"one of {value.size:,} rows"


SAME = 1e-12  # relative difference below which moments count as equal


def body_facts(body: Body) -> dict[str, Any]:
    """Return the properties of a body of plain numbers, as lists and numbers (SI)."""
    moments = np.array(body.moments)
    order = np.argsort(moments, kind="stable")
    about_centre = inertia.about_centre(body.tensor, body.mass, body.centre)
    return {
        "mass": float(body.mass),
        "centre": list(body.centre),
        "tensor": body.tensor.tolist(),
        "moments": moments.tolist(),
        "axes": np.array(body.axes).tolist(),
        "tensor_about_centre": about_centre.tolist(),
        "order": (order + 1).tolist(),
        "growth_per_turn_rate": float(inertia.growth_rate(moments)),
        "shape": top_type(moments),
        "exists": can_exist(body.tensor, body.mass, body.centre),
        "notes": body_notes(body),
    }


def top_type(moments: Array) -> str:
    """Classify a body: spherical, symmetric (oblate or prolate) or asymmetric; flat if
    I3 = I1 + I2."""
    low, middle, high = np.sort(moments)
    if high - low <= SAME * high:
        word = "spherical: all moments equal"
    elif middle - low <= SAME * high:
        word = "symmetric, oblate: two equal moments below the third"
    elif high - middle <= SAME * high:
        word = "symmetric, prolate: two equal moments above the third"
    else:
        word = "asymmetric"
    return word + (", flat (I3 = I1 + I2)" if abs(high - low - middle) <= SAME * high else "")


def describe_body(body: Body, title: str) -> list[str]:
    """Describe a body in lines of text."""
    facts = body_facts(body)
    moments, axes, centre = (np.array(facts[key]) for key in ("moments", "axes", "centre"))
    size = np.sqrt(moments.max() / facts["mass"])  # m
    lines = [
        f"{title}: {facts['shape']}",
        f"mass         {facts['mass']:.12g} kg",
        f"centre       ({_row(centre, size)}) m from the fixed point, in the described axes",
        with_units("tensor       about the fixed point, in the described axes", "kg m2"),
    ]
    largest = np.abs(facts["tensor"]).max()
    clean = [[0.0 if abs(x) < 1e-15 * largest else x for x in row] for row in facts["tensor"]]
    lines += ["             " + " ".join(f"{x:18.10g}" for x in row) for row in clean]
    lines.append(f"principal    {with_units('moment', 'kg m2')}       axis, in the described axes")
    names = dict(zip(facts["order"], ("smallest", "middle", "largest"), strict=True))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        if abs(moments[a] - moments[b]) <= SAME * moments[a]:
            names[a + 1] = names[b + 1] = "equal"
    for k in range(3):
        axis = f"({_row(axes[:, k])})"
        lines.append(f"  axis {k + 1}     {moments[k]:<18.12g}  {axis}   {names[k + 1]}")
    if np.linalg.norm(centre) > SAME * size:
        principal = inertia.survives(axes.T, centre)
        words = ", ".join(str(k + 1) for k in range(3) if principal[k]) or "none"
        lines.append(f"axes that are also principal about the centre of mass: {words}")
    lines += _stability(moments, facts, "" if body.axes == IDENTITY else "principal ")
    return [*lines, *(f"note         {note}" for note in facts["notes"])]


def _stability(moments: Array, facts: dict[str, Any], named: str) -> list[str]:
    """Describe the stability of torque-free rotations and the growth of a disturbance.

    named : "principal " if the axes of the moments are not the axes of the scene, else ""
    """
    low, middle, high = facts["order"]
    growth, shape = facts["growth_per_turn_rate"], facts["shape"]
    if growth > 1e-6:
        turns = np.log(10.0) / growth / (2.0 * np.pi)
        return [
            f"rotations    without torque: stable about {named}axes {low} and {high}, unstable"
            f" about axis {middle}: a disturbance grows as exp({growth:.6g} omega t),",
            f"             tenfold every {turns:.3g} turns",
        ]
    if shape.startswith("spherical"):
        return ["rotations    without torque: steady about any axis; a disturbance does not grow"]
    if shape.startswith("symmetric"):
        oblate = moments[middle - 1] - moments[low - 1] < moments[high - 1] - moments[middle - 1]
        return [
            f"rotations    without torque: stable about {named}axis {high if oblate else low};"
            " steady about any perpendicular axis, but a disturbance makes it drift at a constant"
            " rate"
        ]
    return [
        f"rotations    without torque: two moments are nearly equal, so the growth about"
        f" {named}axis {middle} is slow: {growth:.2g} omega"
    ]


def _row(values: Array, size: float = 1.0) -> str:
    """Write numbers as text; numbers below the rounding error of `size` become 0."""
    return ", ".join(f"{0.0 if abs(x) < 1e-15 * size else x:.10g}" for x in values)

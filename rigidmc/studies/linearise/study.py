"""Find the steady motions of a scene, and what a small change of each becomes.

A steady motion is an equilibrium, or a rotation that looks the same at all times: about a principal
axis, about the vertical (Staude), a regular precession, or a satellite at rest in the frame of its
orbit. Newton's method finds the motion nearest to the start, and others from many attitudes, all
with those momenta of the start that the scene conserves. The linearised motion of a change y, a
rotation vector and a momentum in body axes, is exact: derivatives of the formulas of the effects::

    dy/dt = J y,   J v = (growth + i frequency) v

Eigenvalues that belong to symmetries and conserved momenta have another `origin`, and do not
count for `stability`. With `along`, the motions are listed over branch and value, and there are
bifurcations. For a body that is symmetric about an axis, J is seen from axes that turn
with the precession but not with the spin. Source: Marsden & Ratiu, Introduction to Mechanics and
Symmetry (1999), 11; Hughes, Spacecraft Attitude Dynamics (1986), 4 and 9.

{parameters}

{returns}

Raises
------
SceneError
    for a scene with noise, or with an effect that no rotating frame makes constant; for a start
    without a steady motion with its momenta
OptionError
    for parameters that the scene does not have

Examples
--------
Rotation about the middle axis grows with omega sqrt((I2 - I1)(I3 - I2)/(I1 I3)):

>>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.0, 3.0, 0.0)))
>>> study = rm.linearise(scene, starts=1)
>>> str(study.stability[0].item()), round(float(study.growth_rate[0]), 6)
('saddle', 1.341641)
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.so3 import conjugate, into_body, multiply
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.processes.progress import say
from rigidmc.results.labels import column_head, count_text, value_text
from rigidmc.scene.parameters import unit_at, with_parameters
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.members import refuse_noise
from rigidmc.studies.framework.options import SIDE, Options, Side, option, whole_side
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, make_dataset
from rigidmc.studies.framework.work import Direct
from rigidmc.studies.linearise.branches import Bifurcation, follow
from rigidmc.studies.linearise.motions import Problem, SteadyMotion
from rigidmc.studies.linearise.stability import MOTION
from rigidmc.studies.linearise.steady import frames

MOTIONS = (
    StudyVariable("attitude", "motion quat", "1", "attitude at t = 0"),
    StudyVariable("omega", "motion axis", "rad s-1", "angular velocity"),
    StudyVariable("momentum", "motion axis", "kg m2 s-1", "angular momentum"),
    StudyVariable(
        "turning", "motion space_axis", "rad s-1", "angular velocity of the frame, in space"
    ),
    StudyVariable(
        "spin", "motion axis", "rad s-1", "angular velocity of the state in the body"
    ),
    StudyVariable("energy", "motion", "J", "kinetic plus potential energy"),
    StudyVariable(
        "residual", "motion", "1", "largest residual of the equations, in scaled units"
    ),
    StudyVariable("reached", "motion", "1", "starts of the search that end here"),
    StudyVariable("growth_rate", "motion", "s-1", "growth rate of the fastest change"),
    StudyVariable("growth", "motion eigenvalue", "s-1", "growth rate"),
    StudyVariable("frequency", "motion eigenvalue", "rad s-1", "angular frequency"),
    StudyVariable("period", "motion eigenvalue", "s", "period"),
    StudyVariable("eigenvector_real", "motion eigenvalue change", "1", "eigenvector, real part"),
    StudyVariable(
        "eigenvector_imag", "motion eigenvalue change", "1", "eigenvector, imaginary part"
    ),
    StudyVariable(
        "stability", "motion", "", "linear motion",
        "saddle, unstable spiral, stable spiral, stable node, elliptic, undecided, neutral",
    ),
    StudyVariable("full_motion", "motion", "", "full motion", "stable, unstable, unknown"),
    StudyVariable(
        "origin", "motion eigenvalue", "", "origin of the eigenvalue", "motion, momentum, symmetry"
    ),
)  # fmt: skip
BIFURCATIONS = (
    StudyVariable("bifurcation_value", "bifurcation", str, "value of the parameter"),
    StudyVariable(
        "bifurcation_kind", "bifurcation", "", "kind of the bifurcation",
        "pitchfork, transcritical, fold, Hopf, Hamiltonian Hopf, zero eigenvalue, end",
    ),
    StudyVariable(
        "bifurcation_branch", "bifurcation", "", "branch that goes through, or first that ends"
    ),
    StudyVariable("bifurcation_meets", "bifurcation branch", "", "which branches meet"),
    StudyVariable(
        "bifurcation_frequency", "bifurcation", "rad s-1", "angular frequency of the eigenvalue",
        "which crosses; 0 if it passes 0",
    ),
    StudyVariable("growing", "bifurcation side", "", "growing changes below and above"),
)  # fmt: skip
CHANGES = [f"{kind}.{i}" for kind in ("rotation", "momentum") for i in (1, 2, 3)]
LABELS: dict[str, list[Any]] = {
    "quat": list(DIMENSIONS["quat"].labels),
    "axis": list(DIMENSIONS["axis"].labels),
    "space_axis": ["x", "y", "z"],
    "eigenvalue": list(range(1, 7)),
    "change": CHANGES,
}


class LineariseOptions(Options):
    """The options of `linearise`."""

    starts: int = option(
        256,
        "starts of the search: that of the first member, 24 with principal axes along the axes of"
        " space, and others with evenly spread attitudes",
        more="`first` among the settings chooses another member",
    )
    along: Side | None = option(
        None,
        "a scene parameter to follow the motions along, e.g. start.omega.3=5:9; append :log for"
        " log spacing",
        more="or (parameter, low, high), or (parameter, low, high, True)",
        like=SIDE,
        is_new=False,
    )
    points: int = option(65, "with --along: values of the parameter, both ends included", least=2)


def linearise_scene(
    scene: Scene, options: LineariseOptions, threads: int | None, progress: Any
) -> xr.Dataset:
    """Compute the study of a scene and return its Dataset."""
    refuse_noise(scene.effects)
    if options.along is not None:
        tell = progress if callable(progress) else lambda line: say(f"  {line}")
        return _along(scene, options.along, options, tell if progress else lambda line: None)
    problem = Problem.of(scene.model, scene.run)
    motions = problem.search(options.starts)
    if not motions:
        rule = (
            "no steady motion has the momenta of this start; search from more starts, or from a"
            " start near the motion"
        )
        raise SceneError(rule, at="start", table="")
    values = _of_motions(motions, (len(motions),))
    return make_dataset(MOTIONS, values, {"motion": range(len(motions)), **LABELS}, {})


def _along(
    scene: Scene, side: Side, options: LineariseOptions, tell: Callable[[str], None]
) -> xr.Dataset:
    """Return the Dataset of motions along a parameter."""
    name, low, high, log = whole_side("along", side, scene.model)
    grid = _values(name, low, high, log, options.points)

    def problem_at(value: float) -> Problem:
        return Problem.of(with_parameters(scene.model, {name: value}, "along"), scene.run)

    def count(done: int) -> None:
        if done % 16 == 0 or done == len(grid):
            tell(f"{name}: {done} of {len(grid)} values")

    grid, branches, bifurcations = follow(problem_at, grid, options.starts, count)
    if not branches:
        rule = f"no steady motion has the momenta of the start, at any value of {name}"
        raise SceneError(rule, at="start", table="")
    size, units = len(branches), unit_at(scene.model, name)
    values = _of_motions([motion for branch in branches for motion in branch], (size, len(grid)))
    values |= _of_bifurcations(bifurcations, size)
    about = {"long_name": name, "units": units}
    coordinates = {"branch": range(size), "value": ("value", grid, about), **LABELS}
    motions = (x._replace(dims=x.dims.replace("motion", "branch value")) for x in MOTIONS)
    return make_dataset((*motions, *BIFURCATIONS), values, coordinates, {"along": name}, units)


def _values(name: str, low: float, high: float, log: bool, points: int) -> Array:
    """Return the values of a parameter, both ends included; OptionError for unordered ends."""
    if not (low < high and (low > 0.0 or not log)) or not np.isfinite([low, high]).all():
        rule = f"expected low < high{', both above 0 for log spacing' if log else ''}"
        raise OptionError(rule, at="along", value=f"{name} from {low} to {high}")
    return np.geomspace(low, high, points) if log else np.linspace(low, high, points)


def _of_motions(motions: Sequence[SteadyMotion | None], shape: tuple[int, ...]) -> dict[str, Any]:
    """Return the values of MOTIONS over `shape`; None is nan and ""."""
    numbers = [{} if motion is None else _numbers(motion) for motion in motions]
    values = {}
    for name, dims, units, *_ in MOTIONS:
        size = tuple(len(LABELS[dim]) for dim in dims.split()[1:])
        kind, none = (float, np.nan) if units else (str, "")
        rows = [of_motion.get(name, np.full(size, none)) for of_motion in numbers]
        values[name] = np.array(rows, kind).reshape(shape + size)
    return values


def _numbers(motion: SteadyMotion) -> dict[str, Any]:
    """Return the variables of one motion, in SI units and in the axes of the scene."""
    system, linear, state = motion.system, motion.linear, motion.state
    rate, unit = system.mechanics.rate, system.mechanics.unit
    turn, m = frames(system, state)
    moving = system.frame + state.c[:, 0] @ system.generators
    back = conjugate(tuple(system.mechanics.axes))

    def described(vector: Any) -> Array:
        return np.array(into_body(back, tuple(vector)))

    values, small = rate * linear.values, rate * linear.errors
    growth = np.where(np.abs(values.real) > small, values.real, 0.0)
    frequency = np.where(np.abs(values.imag) > small, values.imag, 0.0)
    is_motion = np.array([origin == MOTION for origin in linear.origins])
    vectors = np.array(
        [np.r_[described(vector[:3]), unit * described(vector[3:])] for vector in linear.vectors.T]
    )
    with np.errstate(divide="ignore"):
        period = np.where(frequency != 0.0, 2.0 * np.pi / np.abs(frequency), np.nan)
    return {
        "attitude": np.array(multiply(tuple(state.q[:, 0]), back)),
        "omega": rate * described((turn + m)[0]),
        "momentum": unit * described(state.l[:, 0]),
        "turning": rate * moving[:3],
        "spin": rate * described(moving[3:]),
        "energy": motion.energy,
        "residual": motion.residual,
        "growth_rate": growth[is_motion].max(initial=-np.inf) if is_motion.any() else np.nan,
        "growth": growth,
        "frequency": frequency,
        "period": period,
        "eigenvector_real": vectors.real,
        "eigenvector_imag": vectors.imag,
        "stability": linear.stability,
        "full_motion": linear.full_motion,
        "reached": motion.reached,
        "origin": np.array(linear.origins),
    }


def _of_bifurcations(bifurcations: Sequence[Bifurcation], branches: int) -> dict[str, Any]:
    """Return the values of BIFURCATIONS."""
    events = [b.event for b in bifurcations]
    meets = [[i == b.event.branch or i in b.others for i in range(branches)] for b in bifurcations]
    return {
        "bifurcation_value": np.array([event.value for event in events]),
        "bifurcation_kind": np.array([b.kind for b in bifurcations], str),
        "bifurcation_branch": np.array([event.branch for event in events], np.int64),
        "bifurcation_meets": np.array(meets, bool).reshape(-1, branches),
        "bifurcation_frequency": np.array([event.frequency for event in events]),
        "growing": np.array([event.growing for event in events], np.int64).reshape(-1, 2),
    }


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    return _table_along(study) if "value" in study.dims else _table_of_motions(study)


def _table_of_motions(study: xr.Dataset) -> list[str]:
    heads = [column_head(study[name]) for name in ("energy", "growth_rate")]
    spin = "".join(f"{column_head(study.omega, i):>17s}" for i in study.axis.values)
    lines = [
        f"{study.attrs['title']}: {count_text(study.sizes['motion'], 'steady motion')}",
        f"  {'linear motion':17s}{'full motion':13s}{spin}{heads[0]:>14s}{heads[1]:>20s}  periods",
    ]
    for k in range(study.sizes["motion"]):
        motion = study.isel(motion=k)
        w, rate = motion.omega.values, float(motion.growth_rate)
        w = np.where(np.abs(w) < 1e-12 * np.abs(w).max(), 0.0, w)  # rounding
        growth = "" if np.isnan(rate) else f"{rate:.6g}"
        numbers = "".join(f"{x:17.6g}" for x in w) + f"{float(motion.energy):14.6g}{growth:>20s}"
        words = f"{motion.stability.item():17s}{motion.full_motion.item():13s}"
        # without the changes by symmetries
        changes = (motion.origin.values == MOTION) & (motion.frequency.values > 0.0)
        periods = [value_text(x, motion.period) for x in motion.period.values[changes]]
        lines.append(f"  {words}{numbers}  {', '.join(periods) or 'none'}")
    if (study.reached == 1).any() and study.sizes["motion"] > 1:
        lines.append("  some motions were found from one start only: more --starts may find others")
    return lines


def _table_along(study: xr.Dataset) -> list[str]:
    name, value = study.attrs["along"], study.value
    ends = value_text(float(value[0]), value), value_text(float(value[-1]), value)
    lines = [
        f"{study.attrs['title']}: {count_text(study.sizes['branch'], 'branch', 'branches')} of"
        f" steady motions along {name}, {ends[0]} to {ends[1]}"
    ]
    for k in range(study.sizes["branch"]):
        words = study.stability.values[k]
        runs = [w for i, w in enumerate(words) if w and (i == 0 or w != words[i - 1])]
        lines.append(f"  branch {k}: {_span(study, k)}: {', then '.join(runs)}")
    for k in range(study.sizes["bifurcation"]):
        lines.append(f"  {_bifurcation_text(study.isel(bifurcation=k), value)}")
    return lines


def _span(study: xr.Dataset, k: int) -> str:
    """Return the first and last value of branch k, and why it has no value beyond them."""
    value, why = study.value, []
    first, last = map(int, np.flatnonzero(study.stability.values[k] != "")[[0, -1]])
    meets = study.bifurcation_value.values[study.bifurcation_meets.values[:, k]]
    for at, beyond, word in ((first, first - 1, "first after"), (last, last + 1, "last before")):
        low, high = np.sort(value.values[[at, beyond % value.size]])
        ends = meets[(meets >= low) & (meets <= high)]
        if 0 <= beyond < value.size and ends.size:
            why.append(f"the {word} its end at {value_text(float(ends[0]), value, 10)}")
    span = " to ".join(value_text(float(value[i]), value) for i in (first, last))
    return span + f" (of the --points, {' and '.join(why)})" * bool(why)


def _bifurcation_text(row: xr.Dataset, value: xr.DataArray) -> str:
    """Return a bifurcation as a line of text."""
    kind, branch = row.bifurcation_kind.item(), int(row.bifurcation_branch)
    others = [int(i) for i in np.flatnonzero(row.bifurcation_meets.values) if i != branch]
    text = f"at {value_text(float(row.bifurcation_value), value, 10)}: {kind} of branch {branch}"
    if others:
        branches = "branch" if len(others) == 1 else "branches"
        text += f", which meets {branches} {' and '.join(map(str, others))}"
    frequency = float(row.bifurcation_frequency)
    if np.isnan(frequency):
        return text
    if frequency:
        text += f"; frequency of its eigenvalue {value_text(frequency, row.bifurcation_frequency)}"
    below, above = row.growing.values
    return f"{text}; growing changes: {below} below, {above} above"


linearise = Study(
    name="linearise",
    text=__doc__,
    options=LineariseOptions,
    work=Direct(linearise_scene, "a function called with a line of text per stage of `along`"),
    table=table,
    variables=(*MOTIONS, *BIFURCATIONS),
    picture="eigenvalues",
    example=Example("dzhanibekov", {"starts": 8}, {}),
)

"""Find the steady motions of a scene, and what a small change of each becomes.

A steady motion is an equilibrium, or a rotation that looks the same at all times: about a principal
axis, about the vertical (Staude), a regular precession, or a satellite at rest in the frame of its
orbit. Newton's method finds the motion nearest to the start, and others from many attitudes, all
with those momenta of the start that the scene conserves. The linearised motion of a change y, a
rotation vector and a momentum in body axes, is exact: derivatives of the formulas of the effects::

    dy/dt = J y,   J v = (growth + i frequency) v

Eigenvalues that belong to symmetries and conserved momenta have another `origin`, and do not
count for `stability`. For a body that is symmetric about an axis, J is seen from axes that turn
with the precession but not with the spin. Source: Marsden & Ratiu, Introduction to Mechanics and
Symmetry (1999), 11; Hughes, Spacecraft Attitude Dynamics (1986), 4 and 9.

{parameters}

Returns
-------
xarray.Dataset
    over motion, or over branch and value with `along`: `attitude`, `omega`, `momentum`, `turning`
    (of the frame, in space), `spin` (of the state in the body), `energy`, `residual`, `reached`
    (starts that end here), `stability` of the linear motion (saddle, unstable spiral, stable
    spiral, stable node, elliptic, undecided, neutral), `full_motion` (stable, unstable, unknown),
    `growth_rate` [1/s] of the fastest change; over eigenvalue too: `growth`, `frequency`, `period`,
    `origin` (motion, momentum, symmetry), and its `eigenvector_real` and `eigenvector_imag`. With
    `along` also over bifurcation: `bifurcation_value`, `bifurcation_kind` (pitchfork,
    transcritical, fold, Hopf, Hamiltonian Hopf, zero eigenvalue, end), `bifurcation_branch`,
    `bifurcation_meets` (which branches), `bifurcation_frequency` of the eigenvalue that crosses, 0
    if it passes 0, and `growing`, the numbers of growing changes below and above

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
>>> found = rm.linearise(scene, starts=1)
>>> str(found.stability[0].item()), round(float(found.growth_rate[0]), 6)
('saddle', 1.341641)
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError
from rigidmc.physics.dynamics.so3 import conjugate, into_body, multiply
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.processes.progress import say
from rigidmc.results.labels import column_head, count_text, value_text
from rigidmc.scene.parameters import unit_at, with_parameter
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.members import refuse_noise
from rigidmc.studies.framework.options import Example, Options, option
from rigidmc.studies.framework.sides import SIDE, Side, whole_side
from rigidmc.studies.framework.study import Study
from rigidmc.studies.framework.work import Direct
from rigidmc.studies.linearise.branches import Bifurcation, follow
from rigidmc.studies.linearise.motions import Motion, Problem
from rigidmc.studies.linearise.stability import MOTION
from rigidmc.studies.linearise.steady import frames

Array = NDArray[np.float64]
# {variable: (long name, CF units, dimensions of its own)}
NUMBERS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "attitude": ("attitude at t = 0", "1", ("quat",)),
    "omega": ("angular velocity", "rad s-1", ("axis",)),
    "momentum": ("angular momentum", "kg m2 s-1", ("axis",)),
    "turning": ("angular velocity of the frame, in space", "rad s-1", ("space_axis",)),
    "spin": ("angular velocity of the state in the body", "rad s-1", ("axis",)),
    "energy": ("kinetic plus potential energy", "J", ()),
    "residual": ("largest residual of the equations, in scaled units", "1", ()),
    "reached": ("starts of the search that end here", "1", ()),
    "growth_rate": ("growth rate of the fastest change", "s-1", ()),
    "growth": ("growth rate", "s-1", ("eigenvalue",)),
    "frequency": ("angular frequency", "rad s-1", ("eigenvalue",)),
    "period": ("period", "s", ("eigenvalue",)),
    "eigenvector_real": ("eigenvector, real part", "1", ("eigenvalue", "change")),
    "eigenvector_imag": ("eigenvector, imaginary part", "1", ("eigenvalue", "change")),
}
WORDS = {
    "stability": ("linear motion", ()),
    "full_motion": ("full motion", ()),
    "origin": ("origin of the eigenvalue", ("eigenvalue",)),
}
CHANGES = [f"{kind}.{i}" for kind in ("rotation", "momentum") for i in (1, 2, 3)]
LABELS: dict[str, Sequence[Any]] = {
    "quat": DIMENSIONS["quat"].labels,
    "axis": DIMENSIONS["axis"].labels,
    "space_axis": ("x", "y", "z"),
    "eigenvalue": range(1, 7),
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
    refuse_noise(scene)
    if options.along is not None:
        tell = progress if callable(progress) else lambda line: say(f"  {line}")
        return _along(scene, options.along, options, tell if progress else lambda line: None)
    problem = Problem.of(scene, scene.run.first)
    motions = problem.search(options.starts)
    if not motions:
        rule = (
            "no steady motion has the momenta of this start; search from more starts, or from a"
            " start near the motion"
        )
        raise SceneError(rule, at="start", table="")
    return _dataset(scene, {"motion": range(len(motions))}, motions)


def _along(
    scene: Scene, side: Side, options: LineariseOptions, tell: Callable[[str], None]
) -> xr.Dataset:
    """Return the Dataset of motions along a parameter."""
    name, low, high, log = whole_side("along", side, scene)
    values = _values(name, low, high, log, options.points)

    def problem_at(value: float) -> Problem:
        return Problem.of(with_parameter(scene, name, value, "along"), scene.run.first)

    def told(done: int) -> None:
        if done % 16 == 0 or done == len(values):
            tell(f"{name}: {done} of {len(values)} values")

    values, branches, found = follow(problem_at, values, options.starts, told)
    if not branches:
        rule = f"no steady motion has the momenta of the start, at any value of {name}"
        raise SceneError(rule, at="start", table="")
    flat = [motion for branch in branches for motion in branch.motions]
    sizes: dict[str, Any] = {"branch": range(len(branches)), "value": values}
    dataset = _dataset(scene, sizes, flat)
    units = unit_at(scene.model, name)
    dataset["value"] = dataset.value.assign_attrs(long_name=name, units=units)
    variables = _bifurcations(found, units, len(branches))
    return dataset.assign(variables).assign_attrs(along=name)


def _values(name: str, low: float, high: float, log: bool, points: int) -> Array:
    """Return the values of a parameter, both ends included; OptionError for unordered ends."""
    if not (low < high and (low > 0.0 or not log)) or not np.isfinite([low, high]).all():
        rule = f"expected low < high{', both above 0 for log spacing' if log else ''}"
        raise OptionError(rule, at="along", value=f"{name} from {low} to {high}")
    return np.geomspace(low, high, points) if log else np.linspace(low, high, points)


def _dataset(
    scene: Scene, sizes: Mapping[str, Any], motions: Sequence[Motion | None]
) -> xr.Dataset:
    """Return the Dataset of motions, listed over the product of the sizes; None are nan and ""."""
    shape = tuple(len(labels) for labels in sizes.values())
    each = [{} if motion is None else _numbers(motion) for motion in motions]
    variables: dict[str, Any] = {}
    for name, (words, units, dims) in NUMBERS.items():
        own = tuple(len(LABELS[dim]) for dim in dims)
        rows = [one.get(name, np.full(own, np.nan)) for one in each]
        about = {"long_name": words, "units": units}
        variables[name] = ((*sizes, *dims), np.array(rows, float).reshape(shape + own), about)
    for name, (words, dims) in WORDS.items():
        own = tuple(len(LABELS[dim]) for dim in dims)
        texts = [one.get(name, np.full(own, "")) for one in each]
        about = {"long_name": words}
        variables[name] = ((*sizes, *dims), np.array(texts, str).reshape(shape + own), about)
    coordinates = {**sizes, **LABELS}
    known = {key: (key, list(values)) for key, values in coordinates.items()}
    attrs = {"title": scene.title, "scene": scene.dumps()}
    return xr.Dataset(variables, known, attrs)


def _numbers(motion: Motion) -> dict[str, Any]:
    """Return the variables of one motion, in SI units and in the axes of the scene."""
    known, linear, state = motion.known, motion.linear, motion.state
    rate, unit = known.rate, known.moment * known.rate
    turn, m = frames(motion.found, state)
    moving = motion.found.frame + state.c[:, 0] @ motion.found.generators
    back = conjugate(tuple(known.axes))

    def described(vector: Any) -> Array:
        return np.array(into_body(back, tuple(vector)))

    values = rate * linear.values
    small = rate * linear.errors
    growth = np.where(np.abs(values.real) > small, values.real, 0.0)
    frequency = np.where(np.abs(values.imag) > small, values.imag, 0.0)
    own = np.array([origin == MOTION for origin in linear.origins])
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
        "growth_rate": growth[own].max(initial=-np.inf) if own.any() else np.nan,
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


def _bifurcations(found: Sequence[Bifurcation], units: str, branches: int) -> dict[str, Any]:
    """Return the variables over bifurcation."""
    about = {"long_name": "value of the parameter", "units": units}
    crossing = {"long_name": "angular frequency of the eigenvalue", "units": "rad s-1"}
    growing = np.array([one.growing for one in found], np.int64).reshape(-1, 2)
    meets = [[i == b.branch or i in b.others for i in range(branches)] for b in found]
    return {
        "bifurcation_value": ("bifurcation", np.array([b.value for b in found]), about),
        "bifurcation_kind": ("bifurcation", np.array([b.kind for b in found], str)),
        "bifurcation_branch": ("bifurcation", np.array([b.branch for b in found], np.int64)),
        "bifurcation_meets": (
            ("bifurcation", "branch"), np.array(meets, bool).reshape(-1, branches),
        ),
        "bifurcation_frequency": (
            "bifurcation", np.array([b.frequency for b in found]), crossing,
        ),
        "growing": (("bifurcation", "side"), growing),
    }  # fmt: skip


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
        one = study.isel(motion=k)
        w, rate = one.omega.values, float(one.growth_rate)
        w = np.where(np.abs(w) < 1e-12 * np.abs(w).max(), 0.0, w)  # rounding
        growth = "" if np.isnan(rate) else f"{rate:.6g}"
        numbers = "".join(f"{x:17.6g}" for x in w) + f"{float(one.energy):14.6g}{growth:>20s}"
        words = f"{one.stability.item():17s}{one.full_motion.item():13s}"
        lines.append(f"  {words}{numbers}  {_periods(one)}")
    if (study.reached == 1).any() and study.sizes["motion"] > 1:
        lines.append("  some motions were found from one start only: more --starts may find others")
    return lines


def _periods(one: xr.Dataset) -> str:
    """Return the periods of the changes, without those by symmetries."""
    own = one.origin.values == MOTION
    periods = one.period.values[own & (one.frequency.values > 0.0)]
    return ", ".join(value_text(x, one.period) for x in periods) or "none"


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


def _bifurcation_text(one: xr.Dataset, value: xr.DataArray) -> str:
    """Return a bifurcation as a line of text."""
    where = f"at {value_text(float(one.bifurcation_value), value, 10)}"
    kind, branch = one.bifurcation_kind.item(), int(one.bifurcation_branch)
    others = [int(i) for i in np.flatnonzero(one.bifurcation_meets.values) if i != branch]
    text = f"{where}: {kind} of branch {branch}"
    if others:
        branches = "branch" if len(others) == 1 else "branches"
        text += f", which meets {branches} {' and '.join(map(str, others))}"
    frequency = float(one.bifurcation_frequency)
    if np.isnan(frequency):
        return text
    if frequency:
        text += f"; frequency of its eigenvalue {value_text(frequency, one.bifurcation_frequency)}"
    below, above = one.growing.values
    return f"{text}; growing changes: {below} below, {above} above"


linearise = Study(
    name="linearise",
    text=__doc__,
    options=LineariseOptions,
    work=Direct(linearise_scene, "a function called with a line of text per stage of `along`"),
    table=table,
    picture="eigenvalues",
    example=Example("dzhanibekov", {"starts": 8}, {}),
)

"""Compute the whole spectrum of Lyapunov exponents of each member, and its indices SALI and GALI_k.

Six tangents of each member move with it: derivatives of its state along six directions that span
the changes of attitude and momentum. At intervals they are made orthonormal (QR), and the growth
R_ii along each is counted::

    lambda_i = 1/t sum ln R_ii
    GALI_k = |u_1 ^ ... ^ u_k|    SALI = min(|u_1 + u_2|, |u_1 - u_2|)

u_i are unit vectors along the first tangents as they have moved. With the largest moment I of a
member and the bound r on its rate (`rigidmc.planning.steps.rate_bounds`), the length of a tangent
is the root of angle^2 + (change of L/(I r))^2. All exponents of a regular motion fall as 1/t, its
indices as powers of t or not at all; in chaos the indices fall as exp(-(lambda_1 - lambda_2) t) and
faster. Tangents are derivatives of the steps themselves, so exponents do not depend on the widths
of distributions, and float32 limits only their digits. With noise, all paths have the same noise.

For effects without damping the sum of the exponents is 0, because the motion keeps volumes; its
size shows the error of the steps, and is rounding for splittings. With damping it is the mean
growth rate of volumes. If the effects conserve the energy, exponents come in pairs, lambda_i =
-lambda_(7-i).
Source: Benettin, Galgani, Giorgilli & Strelcyn, Meccanica 15 (1980) 9; Skokos, Bountis &
Antonopoulos, Physica D 231 (2007) 30.

{parameters}

{returns}

Raises
------
SceneError
    for events that stop members, and for closed forms, which have no steps
OptionError
    for a device other than the CPU

Examples
--------
A body that spins down at the rate 0.3/s: volumes shrink at three times this rate.

>>> scene = rm.Scene(rm.Body((1.0, 1.0, 1.0)), rm.ViscousDamping(0.3))
>>> study = rm.lyapunov(scene, members=2, integrator="rk4", dt=0.01, t_end=20.0)
>>> bool(abs(study["sum"] + 0.9).max() < 1e-9)
True
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError, SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.planning.initial import make_pilot
from rigidmc.planning.saves import longest_interval
from rigidmc.planning.scheme import largest_rates
from rigidmc.results.labels import column_head, count_text, value_text
from rigidmc.results.variables import variables_of
from rigidmc.runs.directory.tasks import Request, TaskArrays
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.recording import conservation
from rigidmc.scene.sampling import is_sample
from rigidmc.scene.scene import Scene
from rigidmc.statistics.intervals import Interval, mean
from rigidmc.studies.framework.members import TUNING, refuse_stops
from rigidmc.studies.framework.options import Options, Time, confidence_option, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.tasks import Tasks
from rigidmc.studies.framework.variables import StudyVariable, interval_of, make_dataset
from rigidmc.studies.lyapunov.tangents import COUNT, compute_members, kept_saves

# rad: turn of the fastest of the first members between two orthonormalisations, at the bound on its
# rate. Near an unstable state changes grow at less than half this bound: in 12 rad by less than
# e^6, so that the smallest tangent keeps 10 of 16 digits.
TURN = 12.0
SAVES = 64  # by default
# Members of a task: as many as make a call from Python short beside the work (an orthonormalisation
# takes 2.3 us for each of 32 and 0.7 us for each of 512), but several tasks for each thread.
TASKS, LARGEST = 8, 512
CHAOTIC = 1e-8  # SALI of regular motion stays above this over thousands of turns
COST = 15.0  # a step with six tangents, half as much again for QR, in steps without
STATE = "attitude", "momentum"
VARIABLES = (
    StudyVariable(
        "exponents", "time exponent member", "s-1", "Lyapunov exponent",
        "from the largest; nan, as all over time, from the save on at which a member is flagged,"
        " and where derivatives are not finite", attrs={"symbol": "lambda"},
    ),
    StudyVariable("sum", "time member", "s-1", "sum of the Lyapunov exponents"),
    StudyVariable("sali", "time member", "1", "smaller alignment index"),
    StudyVariable("gali", "time k member", "1", "generalised alignment index"),
    StudyVariable(
        "pair_error", "member", "s-1", "largest sum of two paired exponents",
        "``|lambda_i + lambda_(7-i)|`` at the end",
    ),
    StudyVariable("mean", "exponent", "s-1", "mean over the members", "at the end", True),
    StudyVariable("spread", "exponent", "s-1", "standard deviation over the members", "at the end"),
    StudyVariable("status", "member", "", "status of the member"),
)  # fmt: skip


class LyapunovOptions(Options):
    """The options of `lyapunov`."""

    interval: Time | None = option(
        None,
        "time between two orthonormalisations; by default the fastest of the first members turns"
        f" by {TURN:g} rad in it",
        unit="s",
        metavar="SECONDS",
        is_new=True,
    )
    confidence: float = confidence_option("confidence level of the intervals of the means")


def start(
    scene: Scene, options: LyapunovOptions, settings: Mapping[str, Any]
) -> tuple[Scene, dict[str, Any]]:
    """Return (the scene of the members, saved at each orthonormalisation; the request)."""
    refuse_stops(scene.observables)
    # another scene than that of the tasks, whose saves follow from its steps and rates
    run = prepare_scene(scene.with_run(save=STATE, keep="full", every=scene.run.t_end))
    if isinstance(settings.get("every"), tuple):
        rule = "exponents are saved at even times: give the time between saves"
        raise OptionError(rule, at="run.every")
    if run.plan.scheme is None:
        rule = "has no steps, and tangents follow a motion step by step: use exact"
        raise SceneError(rule, at="run.integrator", value=scene.run.integrator)
    interval, keep = _interval(run, options.interval, settings.get("every"))
    members, saves = run.members.size, run.scene.run.t_end / (interval * keep) + 1.0
    # three copies of its growth and of its indices
    refuse_count(members, "members with a spectrum", 3 * 8 * (2 * COUNT + 1) * saves)
    lanes = min(LARGEST // layout.LANES, -(-members // (TASKS * layout.LANES)))
    return run.scene.with_run(every=interval), {"keep": keep, "size": lanes * layout.LANES}


def _interval(run: PreparedRun, interval: float | None, every: float | None) -> tuple[float, int]:
    """Return (time between two orthonormalisations [s], their number between two saves).

    interval : the time, None for a whole number of steps that turn the first members by TURN
    every : time between two saves [s], None for SAVES of them
    """
    scene, plan = run.scene, run.plan
    t_end, dt = float(scene.run.t_end), scene.run.dt
    if interval is None:
        pilot = make_pilot(plan.model.coarse(), run.sampler, True).block
        # a body at rest that nothing moves has no rate
        rate = largest_rates(plan.model.effects, pilot)[1] or math.inf
        interval = float(TURN / (rate if run.units is None else rate * run.units.time))
        if scene.run.turn is None:
            # rounded, because 3 steps of 0.1 s are 0.30000000000000004 s
            interval = float(f"{max(1, math.floor(interval / dt)) * dt:.15g}")
    interval = min(interval, t_end)
    if every is None:
        return interval, max(1, math.ceil(t_end / interval / SAVES * (1.0 - 1e-9)))
    keep = max(1, math.ceil(every / interval * (1.0 - 1e-9)))
    return min(every, t_end) / keep, keep


def cost_of(run: PreparedRun, request: Request, numbers: Sequence[int]) -> float:
    """Return the member-steps of tasks; a step with tangents counts as COST."""
    size = request["size"]
    members = sum(min(size, run.members.size - i * size) for i in numbers)
    return COST * float(members) * run.plan.mean_steps


def reduce(
    run: PreparedRun, request: Request, done: dict[int, TaskArrays], options: LyapunovOptions,
    threads: int,
) -> xr.Dataset:  # fmt: skip
    """Return the Dataset of the members of the finished tasks."""
    scene, size, numbers = run.scene, request["size"], sorted(done)

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([done[i][name] for i in numbers], axis=-1)

    member = np.concatenate([i * size + np.arange(done[i]["flag"].size) for i in numbers])
    times = run.layout.axes.times[kept_saves(run.plan, request["keep"])]
    exponents = joined("logarithms") / times[:, None, None]
    total, gali = exponents.sum(axis=1), np.exp(joined("log_gali"))
    # QR orders exponents only in the limit: in dzhanibekov, a regular motion, a sixth of members
    # have them in another order after 50 s.
    exponents = -np.sort(-exponents, axis=1)
    average = mean(exponents[-1], confidence=options.confidence)
    count = np.isfinite(exponents[-1]).sum(axis=-1)
    with np.errstate(all="ignore"):
        square = np.nansum((exponents[-1] - average.value[:, None]) ** 2, axis=-1)
        spread = np.sqrt(square / (count - 1.0))
    if not is_sample(scene.model):
        average = Interval(average.value, *np.full((2, COUNT), np.nan))
    values = {
        "exponents": exponents,
        "sum": total,
        "sali": sali_of(gali[:, 0]),
        "gali": gali,
        "pair_error": np.abs(exponents[-1] + exponents[-1, ::-1]).max(axis=0),
        "mean": average,
        "spread": spread,
        "status": xr.Variable("member", joined("flag"), variables_of(scene)["status"].attrs),
    }
    coordinates = {
        "time": ("time", times, {"long_name": "time", "units": "s"}),
        "exponent": np.arange(1, COUNT + 1),
        "k": np.arange(2, COUNT + 1),
        "member": scene.run.first + member,
    }
    attrs = {
        "members": int(scene.run.members),
        "interval": longest_interval(scene.run),
        "confidence": options.confidence,
        "keeps_energy": int(conservation(scene.effects, False)["energy"] == "yes"),
    }
    return make_dataset(VARIABLES, values, coordinates, attrs)


def sali_of(gali: Array) -> Array:
    """Return SALI for GALI_2, the sine of the angle between two unit vectors: twice the sine of
    half of it, or of half of the rest to pi, whichever is smaller."""
    # without the difference of two unit vectors, which would be lost below 1e-16
    cosine = np.sqrt((1.0 - gali) * (1.0 + gali))
    return gali / np.sqrt(0.5 * (1.0 + cosine))


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    attrs, end = study.attrs, study.isel(time=-1)
    good = end.exponents.notnull().all("exponent").values
    lines = [
        f"{attrs['title']}: {count_text(int(good.sum()), 'member')} to t = {float(end.time):g} s,"
        f" orthonormal every {attrs['interval']:.4g} s"
    ]
    if good.any():
        few = end.isel(member=good)
        heads = "mean", "+-", "spread", "smallest", "largest"
        words = "".join(f"{head:>12s}" for head in heads)
        lines.append(f"{column_head(study.exponents):>14s}{words}")
        for i in study.exponent.values:
            row = few.sel(exponent=i)
            value, ends = interval_of(row, "mean"), (row.exponents.min(), row.exponents.max())
            numbers = value.value, value.half, float(row.spread), *map(float, ends)
            lines.append(f"{i:14d}" + "".join(f"{x:12.4g}" for x in numbers))
        total = few["sum"]
        lines += [
            f"  sum of all: {float(total.mean()):.3g} on average, largest size"
            f" {value_text(float(np.abs(total).max()), total, 3)}"
            f"{'; 0 for exact steps' * attrs['keeps_energy']}",
            f"  SALI below {CHAOTIC:g}, chaotic: {int((few.sali < CHAOTIC).sum()):,} of"
            f" {count_text(int(good.sum()), 'member')}",
        ]
        if attrs["keeps_energy"]:
            worst = value_text(float(few.pair_error.max()), few.pair_error, 3)
            lines.append(f"  pairs of opposite sign: largest sum {worst}; tends to 0")
    if flagged := int((study.status != 0).sum()):
        lines.append(f"  flagged members, without exponents: {flagged:,}")
    if left := int((~good).sum()) - flagged:
        lines.append(f"  members whose derivatives are not finite: {left:,}")
    if missing := attrs["members"] - study.sizes["member"]:
        lines.append(f"  members still missing: {missing:,}; continue with `rigidmc resume`")
    return lines


lyapunov = Study(
    name="lyapunov",
    text=__doc__,
    options=LyapunovOptions,
    work=Tasks(
        start,
        lambda run, request, done: [
            i for i in range(-(-run.members.size // request["size"])) if i not in done
        ],
        compute_members,
        cost_of,
        reduce,
        together=0,
    ),
    table=table,
    variables=VARIABLES,
    picture="lyapunov_spectrum",
    settings=(*TUNING, "members", "first", "points", "every"),
    settings_help={
        "every": "time between two saves of the exponents [s], or saves per turn such as 50/turn;"
        f" by default {SAVES} saves"
    },
    settings_text="run settings, as in `simulate`; `every` is the time between two saves of the"
    f" exponents, by default a {SAVES}th of the time",
    source="the run directory of an existing study",
    example=Example("heavy_top", {}, {"members": 40, "t_end": 2.0}),
)

"""Compute the frequencies in the motion of each member.

The signal x(t) of a member, its saves minus their mean, is decomposed into oscillations::

    x(t) = sum_k a_k cos(nu_k t + phase_k)

nu_1 is the maximum of ``|<x, exp(i nu t)>|`` under the window (1 + cos)^3, to rounding. This
oscillation is subtracted, and the search continues with the rest. A regular motion keeps its
frequencies, a chaotic one does not: `change` compares nu_1 in both halves of the time.
Source: Laskar, Icarus 88 (1990) 266; Physica D 67 (1993) 257.

{parameters}

{returns}

Raises
------
OptionError
    for a quantity that is not saved at times, or with fewer than 64 saves

Examples
--------
A thrown disc wobbles at (I3/I1 - 1) omega3:

>>> start = rm.Start(omega=(0.1, 0.0, 2.0))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 1.8)), start=start)
>>> run = {"integrator": "exact", "members": 1, "dt": 0.5, "every": 0.5, "t_end": 200.0}
>>> study = rm.frequencies(scene, "omega[1]", **run)
>>> study.frequency[0].values.round(12).tolist()
[1.6]
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import elementwise

from rigidmc.errors import OptionError, nearest
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.results.labels import column_head, count_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.scene import Scene
from rigidmc.statistics.estimates import component_of
from rigidmc.statistics.intervals import ULPS, resolution, resolution_of
from rigidmc.studies.framework.members import Batches, Members
from rigidmc.studies.framework.options import REQUIRED, Options, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, make_dataset

# Of the window. After 48 periods, a line of half the size that is 10 (4) periods away shifts a line
# by 8e-8 (1e-4) of itself; with a power of 1 by 8e-6 (1e-4), with 5 by 8e-9 (2e-3).
POWER = 3
NOTHING = 1e-12  # of the signal: a smaller rest is rounding
WIDTH = POWER + 1.0  # of a line, in periods over the time, to the first zero of the window
DOUBLE = 0.5  # of a line: a stronger one within its width is a second line, not its artefact
WHY = ("resolved", "nothing", "slow", "fast", "close", "flagged")
WORDS = {  # reasons of WHY that a table shows
    "nothing": "is constant to rounding",
    "slow": f"has fewer than {WIDTH:g} periods in the time",
    "fast": "is aliased, or nearly: saves must be less than half a period apart",
    "close": f"differs from another by fewer than {WIDTH:g} periods over the time",
}
LEAST = 64  # saves needed for a spectrum
NUMBERS = 2**23  # exponentials computed at once: 128 MB
VARIABLES = (
    StudyVariable(
        "frequency", "term member", "rad s-1", "frequency of the oscillation",
        "nan, as all numbers, for a flagged member and where `why` says", attrs={"symbol": "nu"},
    ),
    StudyVariable("amplitude", "term member", str, "amplitude of the oscillation"),
    StudyVariable("phase", "term member", "rad", "phase of the oscillation at t = 0"),
    StudyVariable(
        "why", "term member", "", "why it is not resolved",
        "only rounding is left; fewer than 4 periods; a period of fewer than two saves, or nearly;"
        " another line that differs by fewer than 4 periods over the time",
        attrs={"flag_values": list(range(len(WHY))), "flag_meanings": " ".join(WHY)},
    ),
    StudyVariable(
        "change", "member", "1",
        "relative change of the first frequency between both halves of the time",
        "nan if a half has fewer than 4 periods",
    ),
    StudyVariable("status", "member", "", "status of the member"),
)  # fmt: skip


class FrequencyOptions(Options):
    """The options of `frequencies`."""

    of: str = option(
        REQUIRED,
        'quantity that oscillates, such as "omega[1]"',
        more="an observable at save times, or a component of one",
        metavar="NAME",
    )
    terms: int = option(3, "number of oscillations; by default 3")


class FrequencyMapOptions(Options):
    """The axes of the frequency map."""

    x: str | None = option(None, 'horizontal axis, such as "start_omega[3]"', metavar="NAME")
    y: str | None = option(None, "vertical axis; by default the frequency", metavar="NAME")


def scene_of_signals(scene: Scene, options: FrequencyOptions, settings: Mapping[str, Any]) -> Scene:
    """Return the scene with the members of the study: it saves the oscillating quantity."""
    refuse_count(scene.run.members, "members with frequencies", 8 * (3 * options.terms + 8))
    name = component_of(scene.recording, options.of, "of").name
    saving: Scene = scene.with_run(save=(name,), keep="full")
    return saving


def check_source(scene: Scene, result: xr.Dataset, options: FrequencyOptions) -> None:
    """Raise OptionError for a result without the oscillating quantity."""
    of = options.of
    name = component_of(scene.recording, of, "of").name
    if name not in result or "time" not in result[name].dims:
        rule = f"the result has no {name} at save times; `rigidmc run SCENE --save {name}`"
        raise OptionError(rule, at="of", value=of, nearest=nearest(name, map(str, result)))


def batch_of(saves: int) -> int:
    """Return the number of members analysed at once."""
    return max(1, NUMBERS // saves)


def reduce(batches: Batches, options: FrequencyOptions) -> xr.Dataset:
    """Return the Dataset of the study of members."""
    scene, of = batches.scene, options.of
    asked, parts, starts = component_of(scene.recording, of, "of"), list[tuple[Array, ...]](), []
    for part in batches.results:
        times = part.time.values
        if times.size < LEAST:
            rule = f"a spectrum requires {LEAST} saves or more; the run has {times.size}"
            raise OptionError(rule, at="run.every", value=scene.run.every)
        gaps = np.diff(times)[:-1]
        if gaps.max() > gaps.min() * (1.0 + 1e-6):
            rule = "a spectrum requires even saves: give the time between them"
            raise OptionError(rule, at="run.every")
        signal = np.where(part.status.values == 0, asked.values(part), np.nan)
        parts.append(_analysed(signal, times, options.terms, resolution_of(scene.run)))
        names = [str(n) for n in part.data_vars if str(n).startswith("start_") or n == "status"]
        starts.append(part[names].drop_vars("time", errors="ignore"))
    arrays = (np.concatenate(x, axis=-1) for x in zip(*parts, strict=True))
    of_members: xr.Dataset = xr.concat(starts, "member", data_vars="minimal")
    values = {variable.name: x for variable, x in zip(VARIABLES, arrays, strict=False)}
    values["status"] = of_members.status
    coordinates = {"term": np.arange(1, options.terms + 1), "member": of_members.member.values}
    units = part[asked.name].attrs.get("units", "1")
    study = make_dataset(VARIABLES, values, coordinates, {"of": of.strip()}, units)
    return study.merge(of_members.drop_vars("status"))


def _analysed(signal: Array, times: Array, terms: int, resolved: float) -> tuple[Array, ...]:
    """Return the first five of VARIABLES for signals (time, member) with a relative resolution."""
    # a spectrum needs evenly spaced saves; the last interval may be shorter
    if times[-1] - times[-2] < (times[1] - times[0]) * (1.0 - 1e-6):
        times, signal = times[:-1], signal[:-1]
    lines, half = oscillations(signal, times, terms, resolved), times.size // 2
    first, second = (
        oscillations(piece, times[: len(piece)], 1, resolved).frequency[0]
        for piece in (signal[:half], signal[-half:])
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        change = np.abs(second - first) / lines.sought[0]
    why = np.where(np.isnan(signal).any(axis=0), WHY.index("flagged"), lines.why).astype("i1")
    return *lines[:3], why, change


class Oscillations(NamedTuple):
    """Frequencies [rad/s], amplitudes and phases of signals, each (terms, n), in the order found;
    nan for unresolved oscillations.

    why : index in WHY of the reason;  sought : the frequencies, including unresolved ones
    """

    frequency: Array
    amplitude: Array
    phase: Array
    why: Ints
    sought: Array


def oscillations(
    signal: Array, times: Array, terms: int, resolved: float | None = None
) -> Oscillations:
    """Return the Oscillations of signals.

    A line of a signal of length T has the width WIDTH 2 pi/T. A line nearer than this to 0, where
    the mean and its own mirror image are, or to the highest frequency of the saves, has errors of
    up to its own size. If two lines are nearer to each other, the weaker is an artefact of the
    stronger; if it has more than DOUBLE of the strength, neither is known.

    signal : (saves, n);  times : evenly spaced [s];  resolved : the relative resolution of signals
    """
    step = (times[-1] - times[0]) / (times.size - 1)
    weight = window(times.size)[:, None]
    tried: list[Array] = []
    shares, left = _fitted(_waves(tried, times, signal.shape[1]), signal, weight)
    eps = resolution(signal.dtype) if resolved is None else resolved
    noise = ULPS * eps * np.abs(signal).max(axis=0) * np.sqrt(times.size)
    least = np.maximum(NOTHING * np.sqrt((weight * left**2).sum(axis=0)), noise)
    for _ in range(terms):
        rest = np.sqrt((weight * left**2).sum(axis=0))
        frequency = _strongest(left * weight, step)
        tried.append(np.where(rest > least, frequency, np.nan))
        shares, left = _fitted(_waves(tried, times, signal.shape[1]), signal, weight)
    frequency, values = np.array(tried), shares[1::2] - 1j * shares[2::2]
    why = _unresolved(frequency, np.abs(values), step, times.size)
    values[why > 0] = np.nan
    sure = np.where(why > 0, np.nan, frequency)
    return Oscillations(sure, np.abs(values), np.angle(values), why, frequency)


def _unresolved(frequency: Array, size: Array, step: float, saves: int) -> Ints:
    """Return the indices in WHY of the reasons why oscillations (terms, n) are not resolved."""
    width = WIDTH * 2.0 * np.pi / ((saves - 1) * step)
    why = np.zeros(frequency.shape, np.int64)
    with np.errstate(invalid="ignore"):
        for k in range(1, len(frequency)):
            near = np.abs(frequency[:k] - frequency[k]) < width
            alike = near & (size[k] > DOUBLE * size[:k])
            why[k, near.any(axis=0)] = WHY.index("close")
            why[:k][alike] = WHY.index("close")
        why[frequency < width] = WHY.index("slow")
        why[frequency > np.pi / step - width] = WHY.index("fast")
    why[np.isnan(frequency)] = WHY.index("nothing")
    return why


def window(count: int) -> Array:
    """Return (1 + cos)^POWER over `count` saves, normalised to a mean of 1."""
    shape = (1.0 + np.cos(np.linspace(-np.pi, np.pi, count))) ** POWER
    return np.asarray(shape / shape.mean())


def _strongest(signal: Array, step: float) -> Array:
    """Return the frequencies (n,) at which the spectra of weighted signals (saves, n) are
    largest."""
    saves, members = signal.shape
    # padded to twice the length: a point then lies within 1/(4 T) of the maximum of each line
    spectrum = np.abs(np.fft.rfft(np.nan_to_num(signal), 2 * saves, axis=0))
    at = np.clip(spectrum[1:-1].argmax(axis=0) + 1, 1, saves - 1)
    apart = np.pi / (saves * step)
    moments = np.arange(saves) - 0.5 * (saves - 1)  # from the middle, where the phase varies least

    def slope(frequency: Array, which: Array) -> Array:
        waves = np.exp(-1j * np.outer(moments * step, frequency))
        chosen = np.nan_to_num(signal[:, which.astype(int)])
        value = (chosen * waves).sum(axis=0)
        change = (chosen * waves * (-1j * moments * step)[:, None]).sum(axis=0)
        return np.asarray((np.conj(value) * change).real)

    ends = (at - 1.0) * apart, (at + 1.0) * apart
    root = elementwise.find_root(slope, ends, args=(np.arange(float(members)),), maxiter=60)
    bad = ~np.isfinite(signal).all(axis=0)
    return np.where(bad | ~root.success, np.nan, root.x)


def _waves(rates: Sequence[Array], times: Array, count: int) -> Array:
    """Return 1, then cos and sin of each frequency, (1 + 2 terms, saves, n); 0 where it is nan."""
    rows = [np.ones((times.size, count))]
    for rate in rates:
        angles = times[:, None] * rate
        rows += [np.nan_to_num(np.cos(angles)), np.nan_to_num(np.sin(angles))]
    return np.array(rows)


def _fitted(waves: Array, signal: Array, weight: Array) -> tuple[Array, Array]:
    """Return (coefficients of the waves (waves, n), rest of the signal): weighted least squares."""
    weighted = waves * weight
    products = np.einsum("itn,jtn->nij", weighted, waves)
    right = np.einsum("itn,tn->ni", weighted, np.nan_to_num(signal))
    # two lines that differ by 3e-6 periods over the time count as one: their condition is 1e12
    inverse = np.linalg.pinv(products, rcond=1e-12, hermitian=True)
    shares = np.einsum("nij,nj->in", inverse, right)
    return shares, signal - np.einsum("itn,in->tn", waves, shares)


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    good = study.status.values == 0
    lines = [f"{study.attrs['title']}: {study.attrs['of']} of {count_text(good.sum(), 'member')}"]
    if not good.any():
        return lines
    few = study.isel(member=np.flatnonzero(good)[:5])
    heads = (column_head(study.frequency, k) for k in few.term.values)
    lines += [f"  member {'':5s}" + "".join(f"{head:>20s}" for head in heads)]
    for member in few.member.values:
        row = few.sel(member=member)
        lines.append(f"  {member:<12d}" + "".join(f"{x:20.12g}" for x in row.frequency.values))
    why = study.why.values[0, good]
    for word, text in WORDS.items():
        if count := int((why == WHY.index(word)).sum()):
            lines.append(f"  nu_1 is not resolved, for {count_text(count, 'member')}: it {text}")
    change = study.change.values[good]
    change = change[np.isfinite(change)]
    if change.size:
        shares = [f"{(change > 10.0**-k).mean():.1%} by more than 1e-{k}" for k in (3, 6, 9)]
        lines.append(f"  nu_1 changes between halves: {', '.join(shares)}")
    if unknown := int(good.sum()) - change.size:
        lines.append(f"  members whose halves are too short to measure a change: {unknown:,}")
    if not good.all():
        lines.append(f"  flagged members, without frequencies: {(~good).sum():,}")
    return lines


frequencies = Study(
    name="frequencies",
    text=__doc__,
    options=FrequencyOptions,
    work=Members(scene_of_signals, reduce, batch_of, check=check_source),
    table=table,
    variables=VARIABLES,
    picture="frequency_map",
    picture_options=FrequencyMapOptions,
    settings_text="run settings, as in `simulate`; saves must be less than half a period apart",
    source="a result with this quantity",
    example=Example("dzhanibekov", {"of": "omega[1]"}, {"members": 40, "t_end": 80.0}),
)

"""From a scene and its records to the problem of a fit."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigidmc.errors import OptionError, RigidmcError, SceneError, unknown
from rigidmc.inputs.measured import in_units
from rigidmc.physics.observables.protocol import size
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.scene.parameters import parameters_of, with_parameters, with_vectors
from rigidmc.scene.scene import Scene
from rigidmc.scene.varied import nominal_of, variables
from rigidmc.studies.fit.parameters import MOMENTS, FitParameters
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.records import WHEEL, Columns, Record, read_records
from rigidmc.studies.fit.streams import NUISANCES, Stream, high_frequency_noise, kind_of, padded
from rigidmc.studies.fit.wheel import with_wheel

TURN = 0.25  # of the body between two saves [rad]: polynomials of degree 7 then miss 2e-9 of a rate
LEAST = 8  # intervals between saves: a polynomial has as many nodes
BY_NAME = ("omega", "momentum", "attitude")  # observables whose columns are found by their names
_ONE_STEP = 1e-9  # relative: the last sample may lie on the last save, rounded


def records_of(
    scene: Scene,
    data: Any,
    columns: Mapping[str, Columns],
    time: str | None,
    split: str | None,
    between: Sequence[tuple[float, float]],
    rate: float | None = None,
) -> list[Record]:
    """Return the records of the data of a scene; see `rigidmc.studies.fit.records`."""
    # not a set, whose order differs between processes, and with it the order of all sums
    saved = tuple(name for name in dict.fromkeys([*columns, *BY_NAME]) if name != WHEEL)
    recording = scene.with_run(save=saved, members=1).recording
    observables = {name: recording.observable(name) for name in saved}
    units = {name: observable.units for name, observable in observables.items()}
    sizes = {name: size(observable.dims) for name, observable in observables.items()}
    units[WHEEL], sizes[WHEEL] = "kg m2 s-1", 3
    return read_records(data, columns, units, sizes, time, split, between, rate)


def make_problem(
    scene: Scene,
    free: Sequence[str],
    own: Sequence[str],
    records: Sequence[Record],
    noise: Any,
    nuisances: Sequence[str],
    threads: int,
    finer: int = 1,
    loss: str = "linear",
    streams: tuple[Stream, ...] = (),
) -> FitProblem:
    """Return the problem of a fit; OptionError or SceneError.

    free : parameters of the scene;  own : those that differ between records, besides the start
    noise : of observables, as the user gives it;  nuisances : words such as bias and omega.bias
    streams : the readings of the records, if they are made
    """
    nominal = _nominal(scene, free)
    scene, inputs = with_wheel(scene, records)
    tied = {}
    if inputs and {"alignment", "omega.alignment"} & set(nuisances):
        # the wheel turns with its sensor
        tied = {name.replace("momenta", "turn"): "omega.alignment" for name in inputs}
    moving = nominal | {name: [0.0, 0.0, 0.0] for name in tied}
    known = nominal_of(scene.model, inputs)
    run = prepare_scene(_with_saves(scene, moving, known, records, finer))
    for name in own:
        if name not in nominal:
            raise unknown("free parameter", nominal, at="each", value=name, error=OptionError)
    shared = [name for name in nominal if not name.startswith("start.") and name not in own]
    streams = streams or _streams(run, records, read_noise(run, noise), nuisances, loss)
    shared += tied
    numbers = with_vectors(parameters_of(run.scene.model, run.scene.run.anti_damping))
    limits = {name: numbers[name].limits for name in moving}
    parameters = FitParameters(moving, shared, streams, len(records), limits, tied, inputs)
    return FitProblem(run, parameters, streams, threads, loss)


def _nominal(scene: Scene, free: Sequence[str]) -> dict[str, float | list[float]]:
    """Return {free parameter: first guess}; SceneError if anything else is random."""
    if not free:
        raise OptionError("name parameters, e.g. body.moments,start.omega", at="free", value="")
    for name in free:
        if name.startswith(f"{MOMENTS}."):
            rule = f"some trials of one moment alone are not bodies: fit {MOMENTS}"
            raise OptionError(rule, at="free", value=name)
    try:
        # derivatives come in this order, and parameters have moments first
        nominal = nominal_of(scene.model, sorted(free, key=lambda name: name != MOMENTS))
    except RigidmcError as error:
        raise OptionError(error.rule, at="free", value=error.value, nearest=error.nearest) from None
    known = with_parameters(scene.model, nominal, "free", variables(scene.model))
    for name in uncertain_numbers(known)[0]:
        rule = "is random, but a record is one motion: fit it, or give a number"
        raise SceneError(rule, at=name)
    return nominal


def _with_saves(
    scene: Scene,
    nominal: Mapping[str, Any],
    inputs: Mapping[str, Any],
    records: Sequence[Record],
    finer: int,
) -> Scene:
    """Return the scene with the run of a fit, whose saves lie around the samples.

    rk8 with these steps is exact to 1e-9 of a rate, as the polynomials are.
    finer : divides the step
    """
    longest = max(record.span[1] - record.span[0] for record in records)
    fastest = max(_fastest(scene, records), np.finfo(float).tiny)  # a start may be at rest
    every = min(TURN / fastest, longest / LEAST or np.inf) / finer  # inf: of one sample
    steps = max(LEAST, int(np.ceil(longest / every - _ONE_STEP)))
    observables = tuple(dict.fromkeys(name for record in records for name in record.times))
    return scene.with_run(
        integrator="rk8", dt=every, every=every, t_end=steps * every, tolerance=None, members=1,
        save=observables, varied={**nominal, **inputs}, wrt=tuple(nominal),
    )  # fmt: skip


def _fastest(scene: Scene, records: Sequence[Record]) -> float:
    """Return the largest angular velocity of the data, or else of the scene [rad/s]."""
    rates = [record.values["omega"] for record in records if "omega" in record.values]
    largest = max(
        (float(np.linalg.norm(np.nan_to_num(x), axis=1).max()) for x in rates), default=0.0
    )
    is_whole = all(np.isfinite(x).any(0).all() for x in rates)
    if largest > 0.0 and is_whole:  # readings of a design are 0
        return largest
    spin = scene.start.spin_name
    vector = np.atleast_1d(nominal_of(scene.model, [f"start.{spin}"])[f"start.{spin}"])
    if spin == "momentum":
        moments = nominal_of(scene.model, ["body.moments"])["body.moments"]
        vector = vector / np.asarray(moments)
    return max(largest, float(np.linalg.norm(vector)))  # of a wobble, whose spin has no readings


def _streams(
    run: PreparedRun,
    records: Sequence[Record],
    noise: Mapping[str, float],
    nuisances: Sequence[str],
    loss: str,
) -> tuple[Stream, ...]:
    """Return the streams of the records, one for each observable."""
    recording, streams = run.layout.recording, []
    kinds = {name: kind_of(recording.observable(name).dims) for name in records[0].times}
    words = _nuisances(nuisances, kinds)
    begins = [record.span[0] for record in records]
    for name, kind in kinds.items():
        times = padded([r.times[name] - t for r, t in zip(records, begins, strict=True)])
        values = padded([record.values[name] for record in records])
        known = tuple(word for word in words[name] if word != "jitter")
        sigma, has_jitter = noise.get(name), "jitter" in words[name]
        stream = Stream(
            name, kind, times, values, np.empty(0), known,
            is_estimated=sigma is None, has_jitter=has_jitter,
        )  # fmt: skip
        each = np.full(stream.channels, sigma)
        if sigma is None:
            if times.shape[1] < 2:
                raise OptionError("state it for records of one reading", at="noise", value=name)
            each = high_frequency_noise(stream, is_robust=loss != "linear")
        streams.append(stream._replace(noise=each))
    return tuple(streams)


def _nuisances(names: Sequence[str], kinds: Mapping[str, int]) -> dict[str, tuple[str, ...]]:
    """Return {observable: its nuisances} of words such as bias and omega.bias; OptionError."""
    each: dict[str, dict[str, None]] = {name: {} for name in kinds}
    for name in names:
        observable, _, word = name.rpartition(".")
        if word not in NUISANCES:
            raise unknown("nuisance", NUISANCES, at="nuisances", value=name, error=OptionError)
        if observable and observable not in each:
            raise unknown("observable", each, at="nuisances", value=name, error=OptionError)
        owners = [
            o for o in ([observable] if observable else kinds) if kinds[o] in NUISANCES[word].kinds
        ]
        if not owners:
            raise OptionError("no such error of this observable", at="nuisances", value=name)
        for owner in owners:
            each[owner][word] = None
    return {name: tuple(words) for name, words in each.items()}


def read_noise(run: PreparedRun, noise: Any) -> dict[str, float]:
    """Return {observable: its noise in SI units}; OptionError."""
    if noise is None:
        return {}
    if not isinstance(noise, Mapping):
        texts = (noise,) if isinstance(noise, str) else noise
        noise = dict(text.partition("=")[::2] for text in texts)
    recording, sigmas = run.layout.recording, {}
    for name, value in noise.items():
        if name not in recording.names:
            raise unknown("observable", recording.names, at="noise", value=name, error=OptionError)
        sigma = _number(value, recording.observable(name).units)
        if not 0.0 < sigma < np.inf:
            rule = "expected OBSERVABLE=NUMBER above 0, e.g. omega=0.002"
            raise OptionError(rule, at="noise", value=value)
        sigmas[name] = sigma
    return sigmas


def _number(value: Any, units: str) -> float:
    """Return a number in SI units, of a number or a text with or without a unit; nan for others."""
    try:
        return float(value)
    except (TypeError, ValueError):
        read = in_units(value, units, "noise")
        return float(read) if isinstance(read, float) else np.nan

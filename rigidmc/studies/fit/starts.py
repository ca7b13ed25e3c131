"""First trials of a fit: bodies from the balance of angular momentum, and random ones around."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from rigidmc.studies.fit.balance import balance, windows_of
from rigidmc.studies.fit.parameters import MOMENTS, FitParameters
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.streams import Array, Stream

DRAWN = 64  # trials that are drawn together
MEASURED = 0.02  # relative spread of a start that is measured
TILT = 0.3  # of a sensor that is mounted along the axes of the body, a standard deviation [rad]
SPINS = {"start.omega", "start.momentum"}
SPREAD = 1.0  # standard deviation of ln J and of the logarithm of positive numbers


def make_starts(problem: FitProblem, count: int, seed: int, first: int = 0) -> Array:
    """Return trials (count, size), from that of number `first` on, a multiple of DRAWN: the best
    guess is number 0, all others are random around it.

    Random trials come in scales from near to far, so few trials find a near minimum and many find
    all. Every other begins around the user's body, because a rotor or a torque breaks the balance;
    half of them with a sensor of any attitude, if its alignment is free.
    """
    parameters, streams = problem.parameters, problem.streams
    known, read = (guess(parameters, streams, balanced) for balanced in (True, False))
    best = parameters.coordinates(known)
    spread, x, turns = spreads(problem, best, known), list[Array](), list[Rotation]()
    for number in range(first, first + count, DRAWN):
        random = np.random.default_rng(np.random.Philox(key=[seed, number]))
        scale = 10.0 ** random.uniform(-2.0, 0.0, (DRAWN, 1))
        x.append(best + scale * random.standard_normal((DRAWN, best.size)) * spread)
        turns.append(Rotation.random(DRAWN, random))
    trials = np.concatenate(x)
    trials[0] = best if first == 0 else trials[0]
    trials[1::2] += parameters.coordinates(read) - best
    some = np.arange(len(trials)) % 4 > 1
    turn = Rotation.concatenate(turns)[some]
    turned = [c for c in parameters.columns if c.word == "alignment"]
    for column in turned:
        trials[np.ix_(some, parameters.index[0, column.columns])] = turn.as_rotvec()
    for name in SPINS & set(read) if turned else ():
        for places, value in zip(parameters.places_of(name), read[name], strict=True):
            trials[np.ix_(some, places)] = turn.inv().apply(value)
    return np.clip(trials[:count], parameters.low, parameters.high)


def spreads(problem: FitProblem, x: Array, known: Mapping[str, Array]) -> Array:
    """Return the largest standard deviations of random trials about x; known : measured values

    That of an unknown number of 0 changes the residuals by as much as there is to explain.
    """
    parameters, spread = problem.parameters, np.zeros_like(x)
    (matrix,), _, (cost,) = problem.sums(x[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = np.nan_to_num(np.sqrt(cost / np.diag(matrix)), posinf=0.0)
    for column in parameters.columns:
        for places in parameters.index[:, column.columns]:
            if column.name == MOMENTS:
                spread[places] = SPREAD
            elif column.word == "alignment":
                spread[places] = TILT
            elif column.stream < 0:
                largest = np.abs(x[places]).max()
                share = MEASURED if column.name in known else 0.5
                spread[places] = share * largest if largest else alone[places]
    return spread


def guess(
    parameters: FitParameters, streams: tuple[Stream, ...], balanced: bool
) -> dict[str, Array]:
    """Return the parameters that the data show without a fit: {name: values}.

    balanced : also the body, by the balance of its angular momentum
    """
    values: dict[str, Array] = {}
    for stream in streams:
        names = {"omega": "start.omega", "momentum": "start.momentum", "attitude": "start.attitude"}
        name = names.get(stream.observable, "")
        given = parameters.nominal.get(name, np.empty(0))
        if stream.values.shape[2] == given.size and parameters.is_vector[name]:
            # of each channel alone: a sensor of one axis has no readings of the others
            values[name] = np.array([
                [next(iter(c[np.isfinite(c)]), g) for c, g in zip(x.T, given, strict=True)]
                for x in stream.values
            ])  # fmt: skip
    rates = [s for s in streams if s.observable == "omega"]
    if balanced and rates and MOMENTS in parameters.nominal:
        values |= _body(parameters, rates[0], streams.index(rates[0]), values)
    return values


def _body(
    parameters: FitParameters, stream: Stream, place: int, values: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the principal moments, and the alignment of the sensor if it is free."""
    is_turned = any(c.word == "alignment" and c.stream == place for c in parameters.columns)
    windows = windows_of(list(zip(stream.times, stream.values, strict=True)))
    tensor = balance(windows, whole=is_turned)[0] if windows else None
    if tensor is None:
        return {}
    scale = np.trace(np.diag(parameters.nominal[MOMENTS])) / np.trace(tensor)
    if not is_turned:
        return {MOMENTS: scale * np.diag(tensor)}
    moments, axes = np.linalg.eigh(tensor)
    turns = Rotation.from_matrix(axes * np.array([1.0, 1.0, np.linalg.det(axes)]))
    # of the 24 orders and signs of the axes, the one nearest to the sensor's
    each = turns * Rotation.create_group("O")
    best = each[int(np.argmin(each.magnitude()))]
    order = np.abs(best.as_matrix().T @ axes).argmax(1)
    found = {MOMENTS: scale * moments[order], f"{stream.observable}.alignment": best.as_rotvec()}
    if "start.omega" in values:
        found["start.omega"] = values["start.omega"] @ best.as_matrix()
    return found

"""The points of a section: parse its definition, "omega[1] = 0" or "every orbit", and find the
crossings.

A run saves states; between two saves `CrossingPaths` recomputes the paths of members with rk8, and
checks its steps against steps of half the length.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import elementwise

from rigidmc.engine.compiler.trees import tree_flatten
from rigidmc.engine.formulas import AdvancedState, evaluate
from rigidmc.engine.inspection import refuse_uncompilable
from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError, SceneError, nearest
from rigidmc.inputs.amounts import parse_seconds
from rigidmc.inputs.arrays import Array, Bools, Ints
from rigidmc.inputs.measured import in_units, quantity_text
from rigidmc.physics.dynamics.body_axes import body_axes
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import blank, is_random, parameter_count
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import find_observable
from rigidmc.physics.observables.protocol import size
from rigidmc.planning.initial import initial_block_of, make_sampler
from rigidmc.planning.steps import rate_bounds
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.scene.scene import Scene
from rigidmc.statistics.estimates import StateComponent, component_of, rows_in_time

# rad: the error of an rk8 step of this length is 1e-13, so that a section keeps the run's accuracy
ARC = 0.2
AGREED = 1e-11  # agreement with steps of half the length: attitude [rad], momentum relative
FAIR = 1e-7  # a path is rejected if steps of any length differ by more
HALVINGS = 8
MOST = 2**20  # steps between two saves: seconds of computing for each point


class Departures(NamedTuple):
    """The initial states of paths.

    states : attitude and momentum (7, n);  places : indices of their members in a run
    times : of the saves [s];  spans : from each to the next save [s]
    """

    states: Array
    places: NDArray[np.intp]
    times: Array
    spans: Array


class CrossingPaths:
    """The paths of members from the saved states of a run, each to the next save.

    A step turns a member by at most ARC, at the largest rate that its energy and the effects allow
    (`rigidmc.planning.steps.rate_bounds`), and is at most as long as a step of the run, which
    resolves the change of torques in time. Steps are then halved until halving changes no state at
    the next save. The steps of a path, and so its bits, depend on this path alone.

    spans : from each state to the next save [s]
    sure : whether the steps of a path agree with steps of half their length within FAIR
    """

    def __init__(
        self,
        scene: Scene,
        members: Ints,
        observed: Mapping[str, Any],
        departures: Departures,
        dt: float,
        threads: int | None,
    ) -> None:
        """dt : the longest step [s], inf if each member has its own step"""
        self._start, self._m, self._times, self.spans = departures
        m, spans = self._m, self.spans
        refuse_uncompilable(scene.effects)
        sampler = make_sampler(scene.model, scene.run)
        block, start = initial_block_of(scene.model, sampler, members)
        end = layout.EFFECTS + parameter_count(*scene.effects)
        axes: tuple[Any, ...] = ()
        if scene.body.is_turned and scene.body.frame == "described":
            axes = body_axes(tuple(start["principal_axes"]))
        rows_of_axes = np.reshape(tree_leaves(axes), (-1, block.shape[1]))
        body_rows, effect_rows = np.split(block[layout.BODY : end], [layout.EFFECTS - layout.BODY])
        table = np.concatenate([body_rows, rows_of_axes, effect_rows]).T
        observables = tuple(observed.values())
        fixed = np.array(tree_flatten(observables))
        fixed = np.broadcast_to(fixed, (len(table), fixed.size))
        self._table = np.concatenate([table, fixed], axis=1)
        body = MassProperties(*[0.0] * BODY_NUMBERS)
        self._kind = AdvancedState(
            body._replace(axes=body_axes((1.0, 0.0, 0.0, 0.0)) if axes else ()),
            blank(scene.effects), observables, INTEGRATORS["rk8"], 0.0, 0.0, (0.0,) * 4, (0.0,) * 3,
        )  # fmt: skip
        self._width = 7 + sum(size(observable.dims) for observable in observables)
        self._threads = threads
        at = block[:, m]
        at[layout.ATTITUDE : layout.EXTRA] = self._start
        rate = rate_bounds(scene.effects, at)
        turns = rate * spans
        # least momentum of a member that rotates at its rate: the scale for members at rest
        self._size = rate / at[layout.BODY : layout.BODY + 3].max(axis=0)
        arc = min(ARC, scene.run.turn or ARC)
        steps = np.maximum(np.nan_to_num(turns) / arc, spans / dt * (1.0 - 1e-9))
        if steps.max(initial=0.0) > MOST:
            rule = f"between two saves a member turns by {turns.max():.3g} rad: save more often"
            raise OptionError(rule, at="every")
        self._steps = np.maximum(1, np.ceil(steps)).astype(int)
        self.sure = np.ones(m.size, bool)
        self._settle()

    def after(self, h: Array, which: NDArray[np.intp]) -> Array:
        """Return the state and observables at time h [s] after each state of `which`."""
        count, now = self._steps[which], self._times[which]
        values = np.concatenate([self._start[:, which], np.empty((self._width - 7, h.size))])
        for done in range(count.max(initial=0)):
            left = np.flatnonzero(count > done)
            step = h[left] / count[left]
            columns = np.concatenate([now[None, left], step[None], values[:7, left]])
            rows = self._m[which][left]
            values[:, left] = evaluate(
                self._kind, self._width, columns, self._table, rows, self._threads
            )
            now[left] += step
        return values

    def _settle(self) -> None:
        """Halve steps until halving changes nothing at the next save; record in `sure` the paths
        that agree."""
        left = np.arange(self._m.size)
        coarse, before = self.after(self.spans, left), np.full(left.size, np.inf)
        for _ in range(HALVINGS):
            self._steps[left] *= 2
            fine = self.after(self.spans[left], left)
            off = _apart(coarse, fine, self._size[left])
            self.sure[left] = off <= FAIR
            # agreed, or rounding: shorter steps are not better, so keep the longer ones
            done = (off <= AGREED) | ((off <= FAIR) & (off > 0.5 * before))
            self._steps[left[done]] //= 2
            left, coarse, before = left[~done], fine[:, ~done], off[~done]
            if left.size == 0:
                return


def _apart(coarse: Array, fine: Array, size: Array) -> Array:
    """Return the larger distance of states (7, ...): of attitudes [rad], or of momenta relative to
    the largest of the two and `size`; inf for nan."""
    turned = 2.0 * np.linalg.norm(coarse[:4] - fine[:4], axis=0)
    sizes = np.maximum(np.linalg.norm(coarse[4:7], axis=0), np.linalg.norm(fine[4:7], axis=0))
    sizes = np.maximum(sizes, size)
    # avoid division by zero for a body at rest without torques
    pushed = np.linalg.norm(coarse[4:7] - fine[4:7], axis=0) / np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(np.nan_to_num(np.maximum(turned, pushed), nan=np.inf))


WAYS = ("rises", "falls", "both")
_CROSSING = re.compile(r"\s*(?P<of>[^=<>]+)=\s*(?P<value>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)\s*")
_PERIOD = re.compile(r"\s*every\s+(?P<period>orbit|[\d.].*)")
RULE = 'expected "NAME = NUMBER" or "NAME[3] = NUMBER", "every NUMBER" [s] or "every orbit"'


def tree_leaves(part: Any) -> list[Any]:
    """Return the arrays of nested tuples, one after the other."""
    if not isinstance(part, tuple):
        return [part]
    return [leaf for item in part for leaf in tree_leaves(item)]


class Crossing(NamedTuple):
    """A value that an observable, or a component of one, crosses.  way : of WAYS"""

    of: StateComponent
    value: float
    way: str

    def happens(self, before: Array, after: Array) -> Bools:
        """Return whether levels, values minus `value`, cross 0 between two saves."""
        up, down = (before < 0.0) & (after >= 0.0), (before > 0.0) & (after <= 0.0)
        return {"rises": up, "falls": down, "both": up | down}[self.way]


def crossing_of(scene: Scene, at: str, way: str) -> Crossing:
    """Parse the Crossing of a text; OptionError."""
    if way not in WAYS:
        raise OptionError(
            f"expected {', '.join(WAYS)}", at="way", value=way, nearest=nearest(way, WAYS)
        )
    match = _CROSSING.fullmatch(_in_si(scene, at))
    if match is None or math.isinf(float(match["value"])):
        raise OptionError(RULE, at="at", value=at)
    if noisy := [label for label, effect in label_effects(scene.effects) if is_random(effect)]:
        rule = "a section requires a scene without noise: paths between saves are unknown"
        raise SceneError(rule, at=f"effects.{noisy[0]}")
    return Crossing(component_of(scene.recording, match["of"], "at"), float(match["value"]), way)


def _in_si(scene: Scene, at: str) -> str:
    """Return "omega[1] = 0.087" for "omega[1] = 5 deg/s"; another text unchanged; OptionError."""
    name, equals, value = at.partition("=")
    if not equals or quantity_text(value) is None:
        return at
    of = find_observable(scene.observables, component_of(scene.recording, name, "at").name)
    try:
        return f"{name}= {in_units(value, of.units, 'at')!r}"
    except SceneError as error:
        raise OptionError(error.rule, at="at", value=at, nearest=error.nearest) from None


def period_of(effects: Sequence[Any], at: str) -> float | None:
    """Return the time between two points of "every NUMBER" [s]; None for a crossing; OptionError
    for a bad time."""
    if (match := _PERIOD.fullmatch(at)) is None:
        return None
    word = match["period"]
    if word != "orbit":
        try:
            return parse_seconds(word)
        except ValueError:
            raise OptionError(RULE, at="at", value=at) from None
    for label, effect in label_effects(effects):
        if label == "gravity_gradient":
            mu, distance = effect.mu, effect.distance
            if isinstance(mu, float) and isinstance(distance, float):
                return 2.0 * math.pi * math.sqrt(distance**3 / mu)
            rule = "the orbits of members differ: give a time"
            raise OptionError(rule, at="at", value=at)
    rule = "the scene has no orbit: it has no gravity_gradient"
    raise OptionError(rule, at="at", value=at)


STATE = ("attitude", "momentum")
JUMP = 1e-3  # a level above this fraction of its ends has jumped, as an angle by 2 pi
UNIT = 1e-9  # largest change of |q|^2 since the previous save, see `CrossingPaths`


def periodic(part: xr.Dataset, observed: Mapping[str, Any]) -> dict[str, Array]:
    """Return the points of a result once per period: its saves up to the last good one."""
    times, members = part.time.values, part.member.values
    there = _good(part)
    m, k = np.nonzero(there.T)
    columns = {name: rows_in_time(part, name)[k, :, m].T for name in observed if name in part}
    return {"member": members[m], "time": times[k], **columns}


def _good(part: xr.Dataset) -> Bools:
    """Return whether a save (time, member) precedes the fault of its member, if any."""
    ends = np.where(part.status.values == 0, np.inf, part.status_time.values)
    return np.asarray(part.time.values[:, None] < ends)


def find_crossings(
    scene: Scene,
    part: xr.Dataset,
    crossing: Crossing,
    observed: Mapping[str, Any],
    threads: int | None,
) -> tuple[dict[str, Array], int]:
    """Return (the points of a result where an observable crosses a value, number of lost ones).

    A crossing is lost if the steps of its path do not converge, see `CrossingPaths.sure`.
    """
    level = crossing.of.values(part) - crossing.value
    good = _good(part)
    crosses = crossing.happens(level[:-1], level[1:]) & good[1:]
    m, k = np.nonzero(crosses.T)
    times, members = part.time.values, part.member.values
    in_axes = in_principal_axes(part)
    start = np.concatenate([rows_in_time(in_axes, name)[k, :, m].T for name in STATE])
    spans = times[k + 1] - times[k]
    dt = float(part.attrs.get("dt", np.inf))
    paths = CrossingPaths(
        scene, members, observed, Departures(start, m, times[k], spans), dt, threads
    )
    at = 7 + _place(observed, crossing)
    ends = np.abs(level[k, m]) + np.abs(level[k + 1, m])
    share, still, missed = _sought(paths, at, crossing.value)
    # The run crosses the value, but the more accurate path from its last save may just miss it, by
    # less than the error of the run: the crossing is then at the next save.
    missed &= still > JUMP * ends
    # an angle that jumps from pi to -pi does not cross 0
    is_crossing = ~missed & (still <= JUMP * ends)
    values = paths.after((share * spans)[is_crossing], np.flatnonzero(is_crossing))
    off = np.abs((values[:4] ** 2).sum(axis=0) - (start[:4, is_crossing] ** 2).sum(axis=0))
    sure = (off < UNIT) & paths.sure[is_crossing]
    lost = int(missed.sum()) + int((~sure).sum())
    values, which = values[:, sure], np.flatnonzero(is_crossing)[sure]
    columns, row = {}, 7
    for name, observable in observed.items():
        columns[name] = values[row : row + size(observable.dims)]
        row += size(observable.dims)
    time = (times[k] + share * spans)[which]
    return {"member": members[m[which]], "time": time, **columns}, lost


def _sought(paths: CrossingPaths, at: int, value: float) -> tuple[Array, Array, Bools]:
    """Find where the quantity in row `at` crosses a value on each path; return (fraction of the
    time between the saves, distance of the quantity from the value there, whether it misses it)."""

    def remaining(share: Array, number: Array) -> Array:
        which = number.astype(np.intp)
        level: Array = paths.after(share * paths.spans[which], which)[at] - value
        return level

    if paths.spans.size == 0:
        return np.empty(0), np.empty(0), np.empty(0, bool)
    numbers = np.arange(float(paths.spans.size))
    root = elementwise.find_root(remaining, (0.0, 1.0), args=(numbers,), maxiter=100)
    missed = ~root.success
    share = np.where(missed, 1.0, root.x)
    last = np.abs(remaining(np.ones(share.size), numbers)) if missed.any() else root.f_x
    still = np.where(missed, last, np.abs(root.f_x))
    return share, still, missed


def _place(observed: Mapping[str, Any], crossing: Crossing) -> int:
    """Return the row of the crossing quantity among the rows of all observables."""
    names = list(observed)
    before = names[: names.index(crossing.of.name)]
    return sum(size(observed[name].dims) for name in before) + crossing.of.row

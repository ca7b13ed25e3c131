"""Formulas over millions of elements: plain functions of numbers, on vectors and on all cores.

A formula is a NamedTuple whose fields are its arguments and whose method `values(self)` returns a
tuple of numbers. It is written once, runs in Python as it stands, and is compiled by its type like
an effect: `evaluate` applies it to arrays.

Three formulas of the physics are here. `Forces` is the torque and energy of effects for many
members at once, outside a run. `AdvancedState` is the state of a member some time after a known
state, by one step of an integrator, with its observables. `RatesOfChange` are the derivatives of
observables by time along the motion.
"""

import sys
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numpy.typing import ArrayLike, NDArray

from rigidmc.engine.compile_time import announce_compiling
from rigidmc.engine.compiler.compose import NumbaError, compile_method, inline, inline_all
from rigidmc.engine.compiler.derivatives import changes_of, first_values, moving, moving_each
from rigidmc.engine.compiler.frozen import frozen
from rigidmc.engine.compiler.intrinsics import intrinsic
from rigidmc.engine.compiler.kernels import (
    WIDTH,
    KernelKey,
    call_kernel,
    compile_kernel,
    is_compiled,
)
from rigidmc.engine.compiler.memory import put_rows
from rigidmc.engine.compiler.trees import tree_unflatten, tree_unpack
from rigidmc.engine.inspection import compilation_error, refuse_uncompilable
from rigidmc.engine.machine import threads_available
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties, scaled
from rigidmc.physics.dynamics.methods import method
from rigidmc.physics.dynamics.so3 import first_three, left_after
from rigidmc.physics.effects.present import in_state, states_of
from rigidmc.physics.effects.protocol import blank, numbers
from rigidmc.physics.effects.sums import corrected_by_work, state_rates, total_energy, total_torque
from rigidmc.physics.integrators.protocol import step
from rigidmc.physics.observables.compiled import begin, observed
from rigidmc.processes.threads import Task, threads_of

# Elements per call on a thread, at most (a few ms) and at least (0.1 ms).
MAX_CALL, MIN_CALL = 16384, 512


@method
def values(formula):
    """Return the numbers of a formula."""
    return ()


def fill(
    tree, numbers, workspace, flat, table, fields, index, columns, extra, count, out, width, begin,
    end,
):  # fmt: skip
    """Compute out[:, e] = values of the formula with fields table[index[e]] and columns[:, e].

    begin, end : elements, begin <= e < end
    count : columns of `columns` and `out`
    workspace : rows for the fields and the values
    flat : the same memory as plain numbers
    fields, extra, width : columns of `table`, rows of `columns`, rows of `out`
    """
    (formula,) = tree_unpack(tree, numbers)
    step = side(workspace)
    for low in range(begin, end, step):
        for k in range(step):
            # The last vector repeats the last element, so every lane has valid numbers.
            element = min(low + k, end - 1)
            for i in range(fields):
                flat[i * step + k] = table[index[element] * fields + i]
            for i in range(extra):
                flat[(fields + i) * step + k] = columns[i * count + element]
        first = fields + extra
        put_rows(values(tree_unflatten(formula, workspace, 0)), workspace, first)
        for i in range(width):
            for k in range(min(step, end - low)):
                out[i * count + low + k] = flat[(first + i) * step + k]
    return 0


def side(rows):
    """Return how many numbers lie side by side in a row."""
    return 1


@intrinsic(side)
def _side(typing_context, rows):
    count = rows.count
    return types.intp(rows), lambda context, builder, sig, args: context.get_constant(
        types.intp, count
    )


inline(values.default)
compile_method(values)
FILL = "wppinpiipiii"  # the arguments of `fill`, see `KernelKey`


def evaluate(
    kind: Any,
    width: int,
    columns: ArrayLike,
    table: ArrayLike | None = None,
    index: ArrayLike | None = None,
    threads: int | None = None,
    side: int = WIDTH,
) -> NDArray[np.float64]:
    """Return the values (width, n) of a formula for n elements.

    kind : class of the formula; if its fields are tuples, an instance with arbitrary numbers
    columns : the fields (numbers, n); with a table, the fields after those in the table
    table, index : (m, fields), and its row for each element (n,)
    side : elements side by side; no result depends on it
    """
    columns = np.ascontiguousarray(columns, dtype=float)
    extra, count = columns.shape
    table = np.empty((1, 0)) if table is None else np.ascontiguousarray(table, dtype=float)
    index = np.zeros(count) if index is None else index
    index = np.ascontiguousarray(index, dtype=np.int64)
    fields, out = table.shape[1], np.empty((width, count))
    formula = kind if isinstance(kind, tuple) else kind(*[0.0] * (fields + extra))
    key = KernelKey(fill, frozen((formula,)), "float64", side, FILL)
    with announce_compiling("formulas", () if is_compiled(key) else ("formulas",)):
        # The kernel reads its numbers from an array that must live until the calls end.
        compiled, _alive = compile_kernel(key)
    shared = (
        table.ravel(), fields, index, columns.ravel(), extra, count, out.ravel(), width,
    )  # fmt: skip

    def run_part(low: int) -> None:
        room = np.empty((fields + extra + width) * side)
        call_kernel(compiled, FILL, room, room, *shared, low, min(low + size, count))

    threads = threads or threads_available()
    # Whole vectors, and as many calls as threads unless they are too small.
    size = min(MAX_CALL, max(MIN_CALL, WIDTH * -(-count // (threads * WIDTH))))
    starts = range(0, count, size)
    if threads > 1 and len(starts) > 1:
        others = [Task(run_part, low) for low in starts[1:]]
        threads_of("formulas", threads - 1).run(others, lambda: run_part(0))
    else:
        for low in starts:
            run_part(low)
    return out


Vector = Any  # a tuple of numbers or of arrays that broadcast


class Forces(NamedTuple):
    """The torque of effects on a body [N m], and its potential energy [J]."""

    q: tuple[float, ...]
    l: tuple[float, ...]
    body: MassProperties
    effects: Any

    def values(self) -> tuple[Any, ...]:
        x, y, z = total_torque(self.effects, self.body, 0.0, self.q, self.l)
        return x, y, z, total_energy(self.effects, self.body, self.q)


_BODY = MassProperties(*[0.0] * 9)


def energies(effects: Any, body: Any, q: Vector) -> Any:
    """Return the potential energy of all effects [J] at attitudes (4, ...).

    The numbers of effects and body are arrays that broadcast with the attitudes.
    """
    try:
        return total_energy(effects, body, q)
    except (TypeError, ValueError):  # a branch, or a function of math, which accepts no array
        return evaluate_forces(effects, body, q, (0.0, 0.0, 0.0))[3]


def torques(effects: Any, body: Any, q: Vector, l: Vector) -> NDArray[np.float64]:
    """Return torques of all effects at t = 0 [N m], (3, ...); arguments as in `energies`."""
    try:
        # with q and l: a torque may be constant
        return np.array(np.broadcast_arrays(*total_torque(effects, body, 0.0, q, l), *q, *l)[:3])
    except (TypeError, ValueError):
        return evaluate_forces(effects, body, q, l)[:3]


def evaluate_forces(effects: Any, body: Any, q: Vector, l: Vector) -> NDArray[np.float64]:
    """Compute torque and energy (4, ...) by compiled code; arguments as in `torques`."""
    parameters = (value for e in effects for _, _, value in numbers(e))
    columns = np.broadcast_arrays(*q, *l, *body[:BODY_NUMBERS], *parameters)
    rows = [column.ravel() for column in columns]
    formula = Forces((0.0,) * 4, (0.0,) * 3, _BODY, blank(effects))
    try:
        values = evaluate(formula, 4, rows, threads=1)
    except NumbaError:  # custom code for one member at a time
        try:
            refuse_uncompilable(effects)
            values = evaluate(formula, 4, rows, threads=1, side=1)
        except NumbaError as error:
            raise compilation_error(error, effects) from error
    return np.reshape(values, (4, *columns[0].shape))


class AdvancedState(NamedTuple):
    """A member after a time h, and its observables then.

    effects, observables, integrator : in compiled form
    t, h : time of the known state (q, l), and the time since then [s]
    """

    body: MassProperties
    effects: Any
    observables: Any
    integrator: Any
    t: float
    h: float
    q: tuple[float, ...]
    l: tuple[float, ...]

    def values(self):
        """Return q and L after h, then the numbers of the observables."""
        part = self.h, self.h, 0.0
        q, l = step(
            self.integrator, self.body, self.effects, self.t, self.h, part, self.q, self.l, ()
        )
        zero, t = 0.0 * self.t, self.t + self.h
        start = zero, zero, zero, zero
        return q + l + observe_all(self.observables, self.body, self.effects, t, q, l, start, ())


def observe_all(observables, body, effects, t, q, l, start, works):
    """Return the numbers of observables, one after the other; start, works : as for `value`."""
    if len(observables) == 0:
        return ()
    first = observed(observables[0], body, effects, t, q, l, start, works)
    return first + observe_all(observables[1:], body, effects, t, q, l, start, works)


class RatesOfChange(NamedTuple):
    """The rates of observables [1/s] along the motion, then the running states that would begin
    here, and their rates.

    effects, observables, running : in compiled form
    untracked : of the effects whose works are saved, as in `rigidmc.physics.effects.sums`
    start : (E, 1/scale of E, |L|^2, 1/|L|^2) at t = 0
    l : L, followed by the states of effects and the works
    """

    body: MassProperties
    effects: Any
    observables: Any
    running: Any
    untracked: Any
    start: tuple[float, ...]
    t: float
    q: tuple[float, ...]
    l: tuple[float, ...]

    def values(self):
        """Return the numbers in this order."""
        second = 1.0 + 0.0 * self.t
        dq, dl = state_rates(
            scaled(self.body, second), self.effects, self.body, self.t, second, self.q, self.l
        )
        t, q, l = moving(self.t, second), moving_each(self.q, dq), moving_each(self.l, dl)
        works, effects = left_after(states_of(self.effects), l[3:]), in_state(self.effects, l[3:])
        l, start = first_three(l), corrected_by_work(self.start, self.untracked, works)
        readings = observe_all(self.observables, self.body, effects, t, q, l, start, works)
        states = begin_all(self.running, self.body, effects, t, q, l)
        return changes_of(readings) + first_values(states) + changes_of(states)


def begin_all(running, body, effects, t, q, l):
    """Return the states of running observables that begin in a state, one after the other."""
    if len(running) == 0:
        return ()
    first = begin(running[0], body, effects, t, q, l)
    return first + begin_all(running[1:], body, effects, t, q, l)


inline_all(sys.modules[__name__])

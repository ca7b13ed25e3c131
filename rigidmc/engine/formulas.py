"""Formulas over millions of elements: plain functions of numbers, on vectors and on all cores.

A formula is a NamedTuple whose fields are its arguments and whose method `values(self)` returns a
tuple of numbers. It is written once, runs as it stands in Python, and is compiled by its type as an
effect is.

Torque and energy of the effects for many members at once, outside a run.

Arrays go through the formulas as they stand if the formulas take arrays, else the formulas are
compiled.

A member some time after a state that is known, and what is observed there: a formula.
"""

import sys
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numpy.typing import ArrayLike, NDArray

from rigidmc.engine.compile_time import announced
from rigidmc.engine.compiler.compose import NumbaError, compile_method, inline, inline_all
from rigidmc.engine.compiler.intrinsics import coded
from rigidmc.engine.compiler.kernels import WIDTH, is_ready, piece, run
from rigidmc.engine.compiler.memory import put
from rigidmc.engine.compiler.trees import filled, parts_of
from rigidmc.engine.inspection import refuse_memory
from rigidmc.engine.machine import threads_available
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import method
from rigidmc.physics.effects.protocol import blank, numbers
from rigidmc.physics.effects.sums import total_energy, total_torque
from rigidmc.physics.integrators.protocol import step
from rigidmc.physics.observables.protocol import value
from rigidmc.threads import Task, threads_of

# Elements per call on a thread, at most (a few ms) and at least (0.1 ms).
PIECE, LEAST = 16384, 512


@method
def values(formula):
    """The numbers that a formula gives."""
    return ()


def fill(
    kinds, numbers, room, known, table, fields, index, columns, more, count, out, width, begin, end
):
    """out[:, e] = values of the formula with fields table[index[e]] and columns[:, e].

    begin, end : elements, begin <= e < end;  count : columns of `columns` and `out`
    room : rows for the fields and the values;  known : the same memory as plain numbers
    fields, more, width : columns of `table`, rows of `columns`, rows of `out`
    """
    (formula,) = parts_of(kinds, numbers)
    step = side(room)
    for low in range(begin, end, step):
        for k in range(step):
            e = min(low + k, end - 1)
            for i in range(fields):
                known[i * step + k] = table[index[e] * fields + i]
            for i in range(more):
                known[(fields + i) * step + k] = columns[i * count + e]
        first = fields + more
        put(values(filled(formula, room, 0)), room, first)
        for i in range(width):
            for k in range(min(step, end - low)):
                out[i * count + low + k] = known[(first + i) * step + k]
    return 0


def side(rows):
    """How many numbers lie side by side in a row."""
    return 1


@coded(side)
def _side(typing_context, rows):
    count = rows.count
    return types.intp(rows), lambda context, builder, sig, args: context.get_constant(
        types.intp, count
    )


inline(values.default)
compile_method(values)
FILL = "wppinpiipiii"  # the arguments of `fill`, see `piece`


def evaluate(
    kind: Any,
    width: int,
    columns: ArrayLike,
    table: ArrayLike | None = None,
    index: ArrayLike | None = None,
    threads: int | None = None,
    side: int = WIDTH,
) -> NDArray[np.float64]:
    """The values (width, n) of a formula for n elements.

    kind : class of the formula; if its fields are tuples, an instance whose numbers do not count
    columns : the fields (numbers, n); with a table, the fields that come after those of the table
    table, index : (m, fields), and the row of it for each element (n,)
    side : elements side by side, on which no result depends
    """
    columns = np.ascontiguousarray(columns, dtype=float)
    more, count = columns.shape
    table = np.empty((1, 0)) if table is None else np.ascontiguousarray(table, dtype=float)
    index = np.zeros(count) if index is None else index
    index = np.ascontiguousarray(index, dtype=np.int64)
    fields, out = table.shape[1], np.empty((width, count))
    formula = kind if isinstance(kind, tuple) else kind(*[0.0] * (fields + more))
    asked = fill, (formula,), "float64", side, FILL
    with announced("formulas", () if is_ready(*asked) else ("formulas",)):
        compiled, _alive = piece(*asked)
    shared = (
        table.ravel(), fields, index, columns.ravel(), more, count, out.ravel(), width,
    )  # fmt: skip

    def part(low: int) -> None:
        room = np.empty((fields + more + width) * side)
        run(compiled, FILL, room, room, *shared, low, min(low + size, count))

    threads = threads or threads_available()
    size = min(PIECE, max(LEAST, WIDTH * -(-count // (threads * WIDTH))))
    starts = range(0, count, size)
    if threads > 1 and len(starts) > 1:
        others = [Task(part, low) for low in starts[1:]]
        threads_of("formulas", threads - 1).run(others, lambda: part(0))
    else:
        for low in starts:
            part(low)
    return out


Vector = Any  # a tuple of numbers or of arrays that broadcast


class Felt(NamedTuple):
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
    """Potential energy of all effects [J] at attitudes (4, ...).

    The numbers of effects and body are arrays that broadcast with the attitudes.
    """
    try:
        return total_energy(effects, body, q)
    except (TypeError, ValueError):  # a branch, or a function of math, which takes no array
        return evaluated(effects, body, q, (0.0, 0.0, 0.0))[3]


def torques(effects: Any, body: Any, q: Vector, l: Vector) -> NDArray[np.float64]:
    """Torques of all effects at t = 0 [N m], (3, ...), arguments as of `energies`."""
    try:
        return np.array(np.broadcast_arrays(*total_torque(effects, body, 0.0, q, l)))
    except (TypeError, ValueError):
        return evaluated(effects, body, q, l)[:3]


def evaluated(effects: Any, body: Any, q: Vector, l: Vector) -> NDArray[np.float64]:
    """Torque and energy (4, ...) by compiled code."""
    parameters = (value for e in effects for _, _, value in numbers(e))
    columns = np.broadcast_arrays(*q, *l, *body, *parameters)
    rows = [column.ravel() for column in columns]
    formula = Felt((0.0,) * 4, (0.0,) * 3, _BODY, blank(effects))
    try:
        values = evaluate(formula, 4, rows, threads=1)
    except NumbaError:  # a user's code that takes one member at a time
        refuse_memory(effects)
        values = evaluate(formula, 4, rows, threads=1, side=1)
    return np.reshape(values, (4, *columns[0].shape))


class Moved(NamedTuple):
    """One step of an integrator, see `rigidmc.engine.formulas`.

    effects, observables, integrator : as they are compiled;  t, h : when the state (q, l) is known,
        and the time since then [s]
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
        """q and L after h, then the numbers of the observables."""
        part = self.h, self.h, 0.0
        q, l = step(
            self.integrator, self.body, self.effects, self.t, self.h, part, self.q, self.l, ()
        )
        return q + l + seen(self.observables, self.body, self.effects, self.t + self.h, q, l)


def seen(observables, body, effects, t, q, l):
    """The numbers of observables of the state and the time, one after the other."""
    if len(observables) == 0:
        return ()
    zero = 0.0 * t
    first = value(observables[0], body, effects, t, q, l, (zero, zero, zero, zero), ())
    return first + seen(observables[1:], body, effects, t, q, l)


inline_all(sys.modules[__name__])

"""The arguments of the loop over members, by name.

They are the kernels of a program, the shape of its members, the steps to make, the noise keys, the
target of saves, and the working memory. `advance` takes all of them as one record, the frame: a new
argument is a new field here, and no signature changes.
"""

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compiler.kernels import CompiledFunction

Memory = Any  # an array, or its address on a GPU


NO_STEP = 2**62  # a step number beyond every run
NO_SAVE_STEPS = np.empty(0, np.int64)
CUT_ROWS = 3  # numbers of a part of a cut step; numbers of its samples follow


def no_cuts(sampling: int) -> NDArray[np.float64]:
    """Return the row beyond every step that ends the cuts of all runs.

    sampling : number of effects with a memory
    """
    return np.array([[1e300, 0.0, 0.0] + [-1.0] * (1 + sampling if sampling else 0)])


NO_CUTS = no_cuts(0)


class KernelTable(NamedTuple):
    """The compiled kernels of a program, NO_FUNCTION for unused ones.

    gather, scatter, initialise, assess, record : `rigidmc.engine.kernel.member`
    march : `rigidmc.engine.kernel.march`
    begin_monitors, monitor_steps : `rigidmc.engine.kernel.monitoring`
    refine_event : `rigidmc.engine.kernel.events`
    begin_growth, record_growth : `rigidmc.engine.kernel.growth`
    change_length, reweigh : `rigidmc.engine.kernel.last_interval`
    take_samples : `rigidmc.engine.kernel.samples`
    """

    gather: CompiledFunction
    scatter: CompiledFunction
    initialise: CompiledFunction
    march: CompiledFunction
    assess: CompiledFunction
    record: CompiledFunction
    begin_monitors: CompiledFunction
    monitor_steps: CompiledFunction
    refine_event: CompiledFunction
    begin_growth: CompiledFunction
    record_growth: CompiledFunction
    change_length: CompiledFunction
    reweigh: CompiledFunction
    take_samples: CompiledFunction


class KernelShape(NamedTuple):
    """The sizes and rows of a program's members.

    lanes : members worked on at the same time
    values : numbers of a save
    row_after, trailing : the first row in `state` of the numbers after L, and their number
    monitor_row, axes_row, growth_row : the first row of monitors, of axes and of growth in `work`
    monitors, growth : groups of members that are monitored one after the other, 0 if steps are not
        monitored, and whether the growth of a tangent is recorded
    nodes : monitored states per step, the last of them at its end
    records : of events, two each
    tries : steps back to find the time of an event
    is_random : whether effects are random
    changes_length, reweighs : whether the kernels `change_length` and `reweigh` begin the last
        interval
    tangents, passes : derivatives of each number in a pass, without the tangent that grows, and
        passes through the steps
    tangents_in_state, tangents_in_work : vectors from a number to its first derivative, see
        `rigidmc.engine.compiler.memory.DualRows`
    sampling : number of effects with a memory
    parking : the row of the trace from which on the states of finished members are kept
    """

    lanes: int
    values: int
    row_after: int
    trailing: int
    monitor_row: int
    axes_row: int
    growth_row: int
    monitors: int
    nodes: int
    growth: int
    records: int
    tries: int
    is_random: int
    changes_length: int
    reweighs: int
    tangents: int
    passes: int
    tangents_in_state: int
    tangents_in_work: int
    sampling: int
    parking: int


class StepRange(NamedTuple):
    """The steps from `first` to `last`, of `total`, and the times of saves.

    h : the step [s], with member steps the length of a round [s]
    slots : places for steps in a round, the largest number of steps of any member
    stride : steps between saves, 0 if `save_steps` lists them; step `total` is always saved
    member_steps : 1 if members have their own steps, else 0
    head, last_h : the step after which h is `last_h`, see `rigidmc.engine.kernel.last_interval`
    save_steps, save_count : with a stride of 0, the steps that end at a save, from 0 to the last,
        and their number
    cuts, cut_count : parts of steps, or of rounds, that effects cut, and their number, see
        `rigidmc.planning.switches`
    """

    h: float
    slots: int
    stride: int
    total: int
    member_steps: int
    first: int
    last: int
    head: int = NO_STEP
    last_h: float = 1.0
    save_steps: Memory = NO_SAVE_STEPS
    save_count: int = 0
    cuts: Memory = NO_CUTS
    cut_count: int = 0

    def cut(self, rows: NDArray[np.float64]) -> "StepRange":
        """Return it with parts of steps; rows : of `rigidmc.planning.switches.cut_rows`."""
        return self._replace(cuts=rows, cut_count=len(rows) - 1)

    def whole(self, step: int) -> int:
        """Return the step, or the end of its round if that is made in parts."""
        unit = step // self.slots
        return (
            step
            if step % self.slots == 0 or unit not in self.cuts[:, 0]
            else (unit + 1) * self.slots
        )

    def saves_until(self, step: int) -> int:
        """Return the number of saves from the start to a step, both of them included."""
        if self.stride == 0:
            return int(np.searchsorted(self.save_steps, step, side="right"))
        return -(-self.total // self.stride) + 1 if step == self.total else step // self.stride + 1

    def step_of_save(self, save: int) -> int:
        """Return the step that ends at a save; `total` beyond the last save."""
        if self.stride == 0:
            return int(self.save_steps[min(save, self.save_count - 1)])
        return min(self.total, save * self.stride)


class NoiseKeys(NamedTuple):
    """The keys of the noise: two words of the seed, the stream of each random effect, and the
    indices of the members of the block."""

    key: Any
    second_key: Any
    streams: Memory
    members: Memory


class SaveTarget(NamedTuple):
    """The target of saves: out[((s*R + r)*(1 + P) + d)*columns + column + m], R = number of value
    rows, P = number of derivatives of each.

    s, r, m : save, value row and member. If the members of a block are reordered, the last term is
        order[m]
    d : 0 for the value, 1 + p for its derivative by parameter p
    """

    out: Memory
    columns: int
    column: int
    order: Memory


class Workspace(NamedTuple):
    """The addresses of all memory.

    substeps, substep_rows : of a StepScheme, and their number
    block, rows, width : the block, its rows and its members; behind the block are as many rows of
        derivatives by each parameter
    state, spare_state : two states
    work, spare_work : two copies of the rows of `work`, see `rigidmc.engine.kernel.layout`
    trace : the states before and after TRACE steps, and one more
    kept : running states before each of TRACE steps
    saved : a save
    skips_cache : whether saves may bypass the cache
    """

    substeps: Memory
    substep_rows: int
    block: Memory
    rows: int
    width: int
    state: Memory
    spare_state: Memory
    work: Memory
    spare_work: Memory
    trace: Memory
    kept: Memory
    saved: Memory
    skips_cache: int


# Names of the arguments of kernels by letters of a KernelKey; all other arguments are integers.
_NAMES = {
    "p": ("block", "out", "substeps", "cuts"),
    "s": ("state", "spare_state"),
    "w": ("work", "spare_work"),
    "t": ("trace",),
    "d": ("kept",),
    "u": ("streams",),
    "k": ("key", "second_key"),
    "f": ("h", "t", "ratio", "longer", "slot", "new_slot", "rounds_done", "round_start",
          "duration", "long_until", "late", "planned", "is_planned"),
}  # fmt: skip
_LETTERS = {name: letter for letter, names in _NAMES.items() for name in names}


@cache
def letters_of(kernel: Callable[..., Any]) -> str:
    """Return the types of the arguments of a kernel after `tree` and `numbers`, see `KernelKey`."""
    names = list(inspect.signature(kernel).parameters)[2:]
    return "".join(_LETTERS.get(name, "i") for name in names)


@cache
def record_type(dtype: str) -> np.dtype[Any]:
    """Return the record type of all these groups for a precision of the run; arrays as addresses.

    Its field `real` is a number of that precision, which gives compiled code the type of states.
    """
    kernel = np.dtype([("address", np.intp), ("numbers", np.intp)])
    others: dict[str, Any] = {
        "h": np.float64,
        "last_h": np.float64,
        "key": np.uint64,
        "second_key": np.uint64,
    }
    groups = KernelShape, StepRange, NoiseKeys, SaveTarget, Workspace
    names = [name for group in groups for name in group._fields]
    kernels = [(name, kernel) for name in KernelTable._fields]
    plain = [(name, others.get(name, np.intp)) for name in names]
    return np.dtype([*kernels, *plain, ("real", dtype)])

"""What the loop over members is called with, by name.

The kernels of a program, the shape of its members, the steps to make, whose noise it is, where
saves go, and the memory to work in. `advance` takes all of them as one record, the frame: a new
argument is a new field here, and no signature changes.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compiler.kernels import CompiledFunction

Memory = Any  # an array, or its address on a device


NO_STEP = 2**62  # the number of a step that no run makes


class KernelTable(NamedTuple):
    """The compiled kernels of a program, NO_FUNCTION for those that a scene does not use.

    gather, scatter, initialise, assess, record : `rigidmc.engine.kernel.member`
    march : `rigidmc.engine.kernel.march`
    begin_monitors, monitor_steps : `rigidmc.engine.kernel.monitoring`
    refine_event : `rigidmc.engine.kernel.events`
    begin_shadow, renormalise_shadow : `rigidmc.engine.kernel.shadow`
    change_length, reweigh : `rigidmc.engine.kernel.last_interval`
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
    begin_shadow: CompiledFunction
    renormalise_shadow: CompiledFunction
    change_length: CompiledFunction
    reweigh: CompiledFunction


class KernelShape(NamedTuple):
    """What the members of a program have, and in which rows.

    lanes : how many members are worked on side by side;  values : numbers of a save
    work_row, works : the first row of the works in `state`, and how many works are saved
    monitor_row, shadow_row : the first row of what is monitored in `work`, and of the shadow in
        `state`
    monitors, shadow : whether steps are monitored, and whether there is a shadow trajectory
    nodes : states of a step that are monitored, the last of them at its end
    records : of events, two each;  tries : steps back to find the time of an event
    is_random : whether effects are random
    changes_length, reweighs : whether the kernels `change_length` and `reweigh` begin the last
        interval
    """

    lanes: int
    values: int
    work_row: int
    works: int
    monitor_row: int
    shadow_row: int
    monitors: int
    nodes: int
    shadow: int
    records: int
    tries: int
    is_random: int
    changes_length: int
    reweighs: int


class StepRange(NamedTuple):
    """From step `first` to step `last`, of `total`, and when to save.

    h : the step [s], with member steps the length of a round [s]
    slots : places for steps in a round: as many as the member with the most steps makes
    stride : steps between saves; step `total` is always saved
    member_steps : 1 if members have steps of their own, else 0
    head, last_h : the step after which h is `last_h`, see `rigidmc.engine.kernel.last_interval`
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


class NoiseKeys(NamedTuple):
    """Whose noise: the two words of the seed, the stream of each random effect, and the indices of
    the members of the block."""

    key: Any
    second_key: Any
    streams: Memory
    members: Memory


class SaveTarget(NamedTuple):
    """Where saves go: out[(s*R + r)*columns + column + m], R = value rows in all.

    s, r, m : save, value row and member. If the members of a block are not in their order, the last
        term is order[m]
    """

    out: Memory
    columns: int
    column: int
    order: Memory


class Workspace(NamedTuple):
    """The addresses of all memory.

    substeps, substep_rows : those of a StepScheme, and how many they are
    block, rows, width : the block, its rows and its members
    state, shadow_state : two states;  work, spare_work : two times what is known of members
    trace : the states before and after TRACE steps, and one more;  saved : a save
    skips_cache : whether saves may go past the cache
    """

    substeps: Memory
    substep_rows: int
    block: Memory
    rows: int
    width: int
    state: Memory
    shadow_state: Memory
    work: Memory
    spare_work: Memory
    trace: Memory
    saved: Memory
    skips_cache: int


@cache
def record_type(dtype: str) -> np.dtype[Any]:
    """The type of the record of all of these, for a precision of the run: arrays by addresses.

    Its field `real` is a number of that precision, which tells compiled code the type of states.
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

"""What the loop over members is called with, by name.

The pieces of a program, the shape of its members, the steps to make, whose noise it is, where saves
go, and the memory to work in. Compiled code takes all of them as one record.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

Memory = Any  # an array, or its address on a device


class Piece(NamedTuple):
    """A piece of compiled code: the addresses of the code and of its numbers.

    Uncompiled it is the function, its Kinds, and the array of its numbers.
    """

    code: Any
    kinds: Any
    numbers: Any


NOTHING = Piece(0, 0, 0)  # for a piece that a scene does not use
NEVER = 2**62  # the number of a step that no run makes


class Pieces(NamedTuple):
    """The compiled pieces of a program, NOTHING for those that a scene does not use.

    enter, leave, begin, look, record : see `rigidmc.engine.kernel.member`;  march :
        `rigidmc.engine.kernel.march`
    begin_watch, watch : `rigidmc.engine.kernel.monitoring`;  seek : `rigidmc.engine.kernel.events`
    begin_near, meet : `rigidmc.engine.kernel.shadow`;  reopen, reweigh :
        `rigidmc.engine.kernel.last_interval`
    """

    enter: Piece
    leave: Piece
    begin: Piece
    march: Piece
    look: Piece
    record: Piece
    begin_watch: Piece
    watch: Piece
    seek: Piece
    begin_near: Piece
    meet: Piece
    reopen: Piece
    reweigh: Piece


class Shape(NamedTuple):
    """What the members of a program have, and in which rows of their state.

    lanes : how many members are worked on side by side;  values : numbers of a save
    works_at, works : the first row of the works, and how many works are kept
    watched, near_at : the first row of what is watched, in `work`, and of the neighbour
    looks, shadow : whether steps are watched, and whether there is a neighbour
    nodes : states that are watched in a step, the last of them at its end
    records : of events, two each;  tries : steps back to find the time of an event
    noisy : whether effects are random
    reopens, reweighs : whether the last interval, if its steps have a length of their own, begins
        with the pieces of these names
    """

    lanes: int
    values: int
    works_at: int
    works: int
    watched: int
    near_at: int
    looks: int
    nodes: int
    shadow: int
    records: int
    tries: int
    noisy: int
    reopens: int
    reweighs: int


class Run(NamedTuple):
    """From step `first` to step `last`, of `total`, and when to save.

    h : the step [s], with member steps the length of a round [s]
    slots : steps of a round; members with steps of their own make some number of them each
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
    head: int = NEVER
    last_h: float = 1.0


class Noise(NamedTuple):
    """Whose noise: two words of the seed, the stream of each random effect, the indices of the
    members of the block."""

    key: Any
    other: Any
    streams: Memory
    members: Memory


class Saves(NamedTuple):
    """Where saves go: out[(s*R + r)*columns + column + m], R = value rows in all.

    s, r, m : save, value row and member. If the members of a block are not in their order, the last
        term is order[m]
    """

    out: Memory
    columns: int
    column: int
    order: Memory


class Room(NamedTuple):
    """Where everything is in memory.

    parts, part_rows : the parts of a step, and how many rows they are
    block, rows, width : the block, its rows and its members
    state, near : two states;  work, aside : what is known of members, and room for a second one
    trace : the states before and after TRACE steps, and one more;  saved : a save
    past : whether saves may go past the cache
    """

    parts: Memory
    part_rows: int
    block: Memory
    rows: int
    width: int
    state: Memory
    near: Memory
    work: Memory
    aside: Memory
    trace: Memory
    saved: Memory
    past: int


def frame_type(real: DTypeLike) -> np.dtype[Any]:
    """The record of all of these that compiled code takes, arrays by their addresses.

    Its field `real` is a number of the precision of the run.
    """
    code = np.dtype([("code", np.intp), ("numbers", np.intp)])
    kinds: dict[str, Any] = {
        "h": np.float64,
        "last_h": np.float64,
        "key": np.uint64,
        "other": np.uint64,
    }
    numbers = [name for kind in (Shape, Run, Noise, Saves, Room) for name in kind._fields]
    pieces = [(name, code) for name in Pieces._fields]
    plain = [(name, kinds.get(name, np.intp)) for name in numbers]
    return np.dtype([*pieces, *plain, ("real", real)])

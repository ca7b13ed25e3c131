"""What the loop over members is called with, by name: the pieces of a program, the shape of its members, the steps to make, whose noise it is, where saves go."""

from typing import NamedTuple

import numpy as np

from rigidmc.engine.pieces import Piece


class Pieces(NamedTuple):
    """The compiled pieces of a program, see `rigidmc.engine.member` and `rigidmc.engine.watch`; NOTHING where a scene has no use for one."""

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


class Shape(NamedTuple):
    """How the members of a program lie in memory, and what they have.

    lanes : how many are worked on side by side;  values : numbers of a save;  works : effects whose work is kept, whose rows begin at `works_at` of a state
    watched, near_at : the rows of a state from which on things are watched, and of the neighbour;  looks, shadow, records : whether steps are watched, there is
        a neighbour, and how many records of events there are;  tries : steps back to find an event;  noisy : whether effects are random
    """

    lanes: int
    values: int
    works_at: int
    works: int
    watched: int
    near_at: int
    looks: int
    shadow: int
    records: int
    tries: int
    noisy: int


class Run(NamedTuple):
    """From which step to which, of how many, and when to save: in rounds of `slots` steps of which a member makes its own, where `own` is 1.

    h : the step, with own steps the length of a round;  stride : steps between saves; step `total` is always saved
    """

    h: float
    slots: int
    stride: int
    total: int
    own: int
    first: int
    last: int


class Noise(NamedTuple):
    """Two words of the seed, the stream of each random effect, and the index of the block's first member."""

    key: int
    other: int
    streams: np.ndarray
    member: int


class Saves(NamedTuple):
    """Where saves go: value row r of save slot s of member m to out[(s*R + r)*columns + column + m], R = value rows in all; the members of a block
    that are not in their order are at column + order[m]."""

    out: np.ndarray
    columns: int
    column: int
    order: np.ndarray


class Room(NamedTuple):
    """Where everything is in memory: the parts of a step and how many there are, a block and its size, two states, what is known of members and room for
    that of others, the states after TRACE steps and one more, and a save; and whether saves may go past the cache."""

    parts: np.ndarray
    part_rows: int
    block: np.ndarray
    rows: int
    width: int
    state: np.ndarray
    near: np.ndarray
    work: np.ndarray
    aside: np.ndarray
    trace: np.ndarray
    saved: np.ndarray
    past: int


def frame_type(real):
    """The record that compiled code takes for all of these, arrays by their addresses; its field `real` is a number of the precision of the run."""
    code = np.dtype([("code", np.intp), ("numbers", np.intp)])
    kinds = {"h": np.float64, "key": np.uint64, "other": np.uint64}
    numbers = [name for kind in (Shape, Run, Noise, Saves, Room) for name in kind._fields]
    fields = [(name, code) for name in Pieces._fields] + [
        (name, kinds.get(name, np.intp)) for name in numbers
    ]
    return np.dtype([*fields, ("real", real)])

"""What moves the members of a scene: its pieces, compiled, and the memory that they work in."""

from types import SimpleNamespace

import numpy as np

from rigidmc.dynamics.methods import implements
from rigidmc.effects import labelled
from rigidmc.engine import member, watch
from rigidmc.engine.beside import beside, helped
from rigidmc.engine.compile_time import announced, divided
from rigidmc.engine.compose import rows_of
from rigidmc.engine.cpu import TRACE, advance
from rigidmc.engine.events import TRIES
from rigidmc.engine.frame import Noise, Pieces, Room, Saves, Shape, frame_type
from rigidmc.engine.layout import BODY, BODY_AT, EFFECTS_AT, KNOWN, LANES, START
from rigidmc.engine.machine import vector_bits
from rigidmc.engine.march import march
from rigidmc.engine.memory import LINE, aligned
from rigidmc.engine.pieces import NOTHING, Piece, config, is_ready, piece, run
from rigidmc.engine.watch import watch_rows
from rigidmc.integrators.protocol import group_count
from rigidmc.observables import SIZES

MARCH = "piswsikkuiii"  # the arguments of `march`, see `piece`
QUIET = Noise(np.uint64(0), np.uint64(0), np.zeros(1, np.uint64), 0)
NOWHERE = Saves(np.empty(0), 0, 0, np.empty(0, np.int64))


class Program:
    """What moves the members of a scene, compiled; with `ask` nothing is compiled, and it tells what is `missing`.

    form : a Form, see `rigidmc.integrators.form`;  effects : blank ones
    attitude : whether it is moved, and paid for;  compensated : whether sums keep their remainders;  dtype : of the numbers in which steps are made
    limits : () where only non-finite members are flagged; else what else flags them, inf where a scene has no such law: drift of energy
        (of the energies in play), of |L|^2 (of its size) and of L_z (of the largest |L| that the energies allow), |omega| h [rad],
        and ||q|^2 - 1|
    ledger : () where no works are kept; else for each effect () if its energy tells its work, (0.0,) if not. See `rigidmc.effects.ledger`
    lanes : how many are worked on side by side, by default what suits this processor
    events, running, shadow : what is watched, see `rigidmc.engine.watch`: events; (running observable, as many 0.0 as it keeps
        floats) each; (0.0,) for a neighbour, else ()
    """

    def __init__(
        self, form, effects, observables=(), attitude=True, compensated=False, dtype="float64", limits=(), ledger=(), events=(), running=(), shadow=(),
        lanes=None, ask=False,
    ):  # fmt: skip
        if compensated and implements(form.integrator, "with_sums"):
            form = form._replace(
                integrator=form.integrator.with_sums(),
                parts=form.parts * (np.arange(len(form.parts)) > 0)[:, None],
            )
        self.form, self.effects, self.dtype = form, effects, np.dtype(dtype).name
        self.lanes = 1 if config.DISABLE_JIT else lanes or lanes_for(dtype)
        groups = min(self.lanes, group_count(form.integrator))
        self.parts = np.ascontiguousarray(form.parts, dtype=float).ravel()
        turned, kept, works = (
            (0.0,) if attitude else (),
            (0.0,) if compensated else (),
            tuple(0.0 for _ in ledger),
        )
        moved = (form.integrator, effects, turned, kept, works, (0.0,) * groups)
        seen = (form.integrator, effects, turned, kept, tuple(limits), ledger)
        watched = (form.integrator, effects, events, running)

        def made(wanted, function, parts, arguments):
            return (function, parts, self.dtype, self.lanes, arguments) if wanted else None

        some = bool(events or running)
        pieces = Pieces(
            made(True, member.enter, (), "piiiiffsw"),
            made(True, member.leave, (), "piiiiiisw"),
            made(True, member.begin, seen, "psw"),
            made(True, march, moved, MARCH),
            made(True, member.look, seen, "pswff"),
            made(bool(observables), member.record, (observables, effects, ledger), "wpiifi"),
            made(some, watch.begin_watch, watched, "pswi"),
            made(some, watch.watch, watched, "pswsiii"),
            made(bool(events), watch.seek, (form.integrator, effects, events), "pswswiii"),
            made(bool(shadow), watch.begin_near, (form.integrator, effects), "pswsi"),
            made(bool(shadow), watch.meet, (form.integrator, effects), "pswsiff"),
        )
        at = EFFECTS_AT + rows_of(effects)
        row = at + 2 * len(ledger)
        random = any("noise" in effect._fields for effect in effects)
        values = sum(len(ledger) if "effect" in o.dims else SIZES[o.dims] for o in observables)
        near_at, tries = row + watch_rows(events, running, ()), 0 if random else TRIES
        self.shape = Shape(
            self.lanes,
            values,
            at,
            len(ledger),
            row,
            near_at,
            int(some),
            len(shadow),
            2 * len(events),
            tries,
            int(random),
        )

        kind = frame_type(self.dtype)
        self.asked = {**pieces._asdict(), "advance": (advance, (), self.dtype, 0, kind)}
        if not ask:
            missing, theirs = self.missing(), self.theirs()
            with announced(self.label, missing, self.effects, theirs):
                with beside([self.asked[name] for name in theirs]):
                    for name in missing:
                        if name not in theirs:
                            piece(*self.asked[name])
                found = {
                    name: piece(*asked) if asked else (NOTHING, None)
                    for name, asked in self.asked.items()
                }
            self._numbers = [
                numbers for _, numbers in found.values()
            ]  # of the pieces, which know only where they are
            *pieces, self._advance = (one for one, _ in found.values())
            self.pieces = Pieces(*pieces)
            empty = SimpleNamespace(real=1.0) if config.DISABLE_JIT else np.zeros(1, kind)
            self._frame = framed(empty, self.pieces, self.shape)

    @property
    def label(self):
        """What it is, in the words of a scene."""
        words = [
            self.form.name or type(self.form.integrator).__name__,
            *(label for label, _ in labelled(self.effects)),
        ]
        return " + ".join(words) + " in float32" * (self.dtype == "float32")

    def missing(self):
        """Names of the pieces that are neither in memory nor in the disk cache, `advance` for the loop that calls them."""
        return [name for name, asked in self.asked.items() if asked and not is_ready(*asked)]

    def theirs(self):
        """Names of those of them that a second process is to compile."""
        missing = self.missing()
        return divided(
            self.label, missing, self.effects, helped({name: self.asked[name] for name in missing})
        )

    def advance(self, block, steps, noise=None, saves=None):
        """Take a block through the steps of a Run; see `rigidmc.engine.cpu.advance`."""
        lanes, (rows, members) = self.lanes, block.shape
        state, near = (aligned((BODY_AT + rows - BODY) * lanes, self.dtype) for _ in range(2))
        work, aside = aligned((KNOWN + rows) * lanes, float), aligned(KNOWN * lanes, float)
        trace, saved = (
            aligned((7 * TRACE + START + self.shape.works) * lanes, self.dtype),
            aligned(max(1, self.shape.values) * lanes, float),
        )
        noise, saves = noise or QUIET, saves or NOWHERE
        lines = (
            8 * lanes % LINE
            == saves.out.ctypes.data % LINE
            == 8 * saves.columns % LINE
            == 8 * saves.column % LINE
            == 0
        )
        room = Room(
            self.parts,
            self.parts.size // 4,
            block,
            rows,
            members,
            state,
            near,
            work,
            aside,
            trace,
            saved,
            int(lines),
        )
        run(self._advance, "p", framed(self._frame, steps, noise, saves, room))


def framed(frame, *given):
    """The record of `frame_type` with fields from NamedTuples; uncompiled something with attributes of their names."""
    if config.DISABLE_JIT:
        flat = {
            name: x.ravel() if isinstance(x, np.ndarray) else x
            for part in given
            for name, x in part._asdict().items()
        }
        return SimpleNamespace(**vars(frame), **flat)
    frame = frame.copy()
    for part in given:
        for name, value in zip(part._fields, part, strict=True):
            if isinstance(value, Piece):
                frame[name] = value.code, value.numbers
            else:
                frame[name] = (
                    value.__array_interface__["data"][0] if isinstance(value, np.ndarray) else value
                )
    return frame


def lanes_for(dtype):
    """How many members are worked on side by side: two registers of each number, so that what waits for one works on the other. No result depends on it."""
    return min(LANES, 2 * vector_bits() // (8 * np.dtype(dtype).itemsize))

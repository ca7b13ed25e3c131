"""What moves the members of a scene: its pieces, compiled, and the memory that they work in."""

from collections.abc import Generator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rigidmc.engine.compile_helper import beside, helped
from rigidmc.engine.compile_time import announced, divided
from rigidmc.engine.compiler.kernels import Asked, config, is_ready, piece, run
from rigidmc.engine.compiler.memory import aligned
from rigidmc.engine.compiler.pipeline import LINE
from rigidmc.engine.compiler.trees import row_count
from rigidmc.engine.inspection import slow_parts
from rigidmc.engine.kernel import events as event
from rigidmc.engine.kernel import last_interval, member
from rigidmc.engine.kernel import monitoring as watching
from rigidmc.engine.kernel import shadow as neighbour
from rigidmc.engine.kernel.arguments import (  # fmt: skip
    NOTHING,
    Noise,
    Piece,
    Pieces,
    Room,
    Run,
    Saves,
    Shape,
    frame_type,
)
from rigidmc.engine.kernel.block import TRACE, advance
from rigidmc.engine.kernel.layout import BODY, BODY_AT, KNOWN, LANES, START, places
from rigidmc.engine.kernel.march import march
from rigidmc.engine.machine import vector_bits
from rigidmc.physics.dynamics.methods import OFF, Flag, flag, implements, static_count
from rigidmc.physics.effects import labelled
from rigidmc.physics.effects.protocol import takes_noise
from rigidmc.physics.integrators.protocol import changes_form, group_count, keeping, keeps_its_own
from rigidmc.physics.observables.protocol import size

MARCH = "piswsikkuiii"  # the arguments of `march`, see `piece`
NO_NOISE = Noise(np.uint64(0), np.uint64(0), np.zeros(1, np.uint64), np.zeros(0, np.int64))
NO_SAVES = Saves(np.empty(0), 0, 0, np.empty(0, np.int64))
CALL = 3_000_000  # member-steps per call: 10 to 60 ms at 50 to 300 M/s on two threads


class Program:
    """What moves the members of a scene, compiled.

    form : a Form, see `rigidmc.physics.integrators.protocol`;  effects : blank ones
    attitude : whether it is followed;  compensated : whether sums keep their remainders
    dtype : of the numbers in which steps are made
    limits : () if only non-finite members are flagged; else the largest drift of energy (of the
        energies in play), of |L|^2 (of its size) and of L_z (of the largest |L| that the energies
        allow), |omega| h [rad], and ||q|^2 - 1|; inf if a scene has no such law
    ledger : () if no works are kept; else for each effect OFF if its energy tells its work, ON if
        not, see `rigidmc.physics.effects.sums`
    events, running, shadow : what is watched: compiled events; (running observable, `static_count`
        of its marks) each; ON for a neighbour
    lanes : how many members are worked on side by side, by default what suits this processor; one
        if the code of a user's own effect takes only one
    ask : compile nothing; `missing` then tells what would be compiled
    nodes : states that are watched in a step, by dense output but for the last; 0 for the states
        after steps and nothing in between
    paired : whether a step has the noise of two steps of half its length, which it then follows as
        closely as a path with such steps can; steps are those of all members alike
    shortens : whether the last interval may have steps of a length of their own
    """

    def __init__(
        self, form: Any, effects: Sequence[Any], observables: Sequence[Any] = (),
        attitude: bool = True, compensated: bool = False, dtype: DTypeLike = "float64",
        limits: Sequence[float] = (), ledger: Sequence[Any] = (), events: Sequence[Any] = (),
        running: Sequence[Any] = (), shadow: Flag = OFF, lanes: int | None = None,
        ask: bool = False, nodes: int = 0, paired: bool = False, shortens: bool = False,
    ) -> None:  # fmt: skip
        compensated = compensated and not keeps_its_own(form.integrator)
        if compensated and implements(form.integrator, "with_sums"):
            form = form._replace(
                integrator=form.integrator.with_sums(),
                parts=form.parts * (np.arange(len(form.parts)) > 0)[:, None],
            )
        self.form, self.effects, self.dtype = form, effects, np.dtype(dtype).name
        watches = *observables, *events, *(one for one, _ in running)
        one = config.DISABLE_JIT or slow_parts(form.integrator, effects, watches)
        self.lanes = 1 if one else lanes or lanes_for(dtype)
        self.parts = np.ascontiguousarray(form.parts, dtype=float).ravel()

        marks = [len(m) for _, m in running]
        rows = places(row_count(effects), len(ledger), len(events), marks, bool(shadow))
        self.rows = rows.end
        random = any(map(takes_noise, effects))
        self.shape = Shape(
            lanes=self.lanes,
            values=sum(size(o.dims, len(ledger)) for o in observables),
            works_at=rows.in_state(rows.works),
            works=len(ledger),
            watched=KNOWN + rows.events,
            near_at=rows.in_state(rows.neighbour),
            looks=int(bool(events or running)),
            nodes=nodes,
            shadow=len(shadow),
            records=2 * len(events),
            tries=0 if random else event.TRIES,
            noisy=int(random),
            reopens=int(shortens and changes_form(form.integrator)),
            reweighs=int(shortens and bool(running)),
        )
        kept = flag(attitude), flag(compensated)
        self.paired = flag(paired)
        self.asked = self._asked(kept, observables, tuple(limits), ledger, events, running, shadow)
        if not ask:
            self._compile()

    def _asked(
        self, marks: tuple[Any, Any], observables: Any, limits: Any, ledger: Any, events: Any,
        running: Any, shadow: Any,
    ) -> dict[str, Asked | None]:  # fmt: skip
        """{name: what `piece` takes} of all pieces, None for those without a use.

        marks : flags of attitude and of remainders
        """
        integrator, effects, shape = self.form.integrator, self.effects, self.shape
        groups = static_count(min(self.lanes, group_count(integrator)))
        several, works = flag(len(self.form.parts) > 2), static_count(len(ledger))
        moved = (integrator, effects, *marks, works, groups, several, self.paired)
        kept, dense = keeping(integrator), static_count(min(shape.nodes, 2))

        def asked(wanted: Any, function: Any, parts: Any, arguments: str) -> Any:
            return (function, parts, self.dtype, self.lanes, arguments) if wanted else None

        some = events or running
        pieces = Pieces(
            enter=asked(True, member.enter, (), "piiiiffsw"),
            leave=asked(True, member.leave, (), "piiiiiiisw"),
            begin=asked(True, member.begin, (kept, effects, limits, ledger), "psw"),
            march=asked(True, march, moved, MARCH),
            look=asked(True, member.look, (kept, effects, *marks, limits, ledger), "pswffff"),
            record=asked(observables, member.record, (observables, effects, ledger), "wpiifi"),
            begin_watch=asked(some, watching.begin_watch, (effects, events, running), "pswi"),
            watch=asked(some, watching.watch, (kept, effects, events, running, dense), "pswsiiii"),
            seek=asked(events, event.seek, (kept, effects, events), "pwswiiiff"),
            begin_near=asked(shadow, neighbour.begin_near, (kept, effects), "pswsif"),
            meet=asked(shadow, neighbour.meet, (kept, effects), "pswsifff"),
            reopen=asked(
                shape.reopens, last_interval.reopen, (kept, effects, marks[1], ledger), "pswfffi"
            ),
            reweigh=asked(shape.reweighs, last_interval.reweigh, (events, running), "wif"),
        )
        return {**pieces._asdict(), "advance": (advance, (), self.dtype, 0, "r")}

    def _compile(self) -> None:
        """Compile the pieces that are missing, some of them in a second process."""
        missing, theirs = self.missing(), self.theirs()
        with announced(self.label, missing, self.effects, theirs):
            with beside([asked for name in theirs if (asked := self.asked[name])]):
                for name in missing:
                    if name not in theirs and (asked := self.asked[name]):
                        piece(*asked)
            pieces = {
                name: piece(*asked) if asked else (NOTHING, None)
                for name, asked in self.asked.items()
            }
        # a piece knows only where its numbers are: they have to live as long as the program
        self._numbers = [numbers for _, numbers in pieces.values()]
        *others, self._advance = (one for one, _ in pieces.values())
        kind = frame_type(self.dtype)
        empty = SimpleNamespace(real=1.0) if config.DISABLE_JIT else np.zeros(1, kind)
        self._frame = framed(empty, Pieces(*others), self.shape)

    @property
    def label(self) -> str:
        """What it is, in the words of a scene."""
        integrator = self.form.name or type(self.form.integrator).__name__
        words = [integrator, *(label for label, _ in labelled(self.effects))]
        return " + ".join(words) + " in float32" * (self.dtype == "float32")

    def missing(self) -> list[str]:
        """Names of the pieces that are neither in memory nor in the disk cache.

        "advance" is the loop that calls the others.
        """
        return [name for name, asked in self.asked.items() if asked and not is_ready(*asked)]

    def theirs(self) -> list[str]:
        """Names of the missing pieces that a second process is to compile."""
        if not (missing := self.missing()):
            return []
        able = helped({name: asked for name in missing if (asked := self.asked[name])})
        return divided(self.label, missing, self.effects, able)

    def workers(self, threads: int, blocks: int, members: int, saves: int) -> int:
        """How many threads take `blocks` blocks of so many members, who save so often.

        Raises NoRoom if there is no memory for them where members move.
        """
        return threads

    def places(self, threads: int) -> tuple[str, str]:
        """Where members move, in words: one of these places, and all of them."""
        return "one thread", f"{threads} threads"

    def through(
        self, block: NDArray[np.float64], steps: Run, noise: Noise, saves: Saves
    ) -> Generator[int, bool | None, None]:
        """`advance` by calls that are no longer than a blink; the step after each of them.

        No result depends on the calls. send(True) to this generator brings the state after the last
        call to the block, from which other calls may go on at that step.
        """
        # a step in many parts takes as many times as long
        most = max(1, CALL // (max(1, block.shape[1]) * (len(self.form.parts) - 1)))
        for first in range(steps.first, steps.last, most):
            last = min(steps.last, first + most)
            self.advance(block, steps._replace(first=first, last=last), noise, saves)
            while (yield last):  # the state is in the block
                pass

    def advance(
        self, block: NDArray[np.float64], steps: Run, noise: Noise | None = None,
        saves: Saves | None = None,
    ) -> None:  # fmt: skip
        """Take a block through the steps of a Run; see `rigidmc.engine.kernel.block.advance`."""
        lanes, (rows, members) = self.lanes, block.shape
        noise = noise or NO_NOISE._replace(members=np.arange(members))
        saves = saves or NO_SAVES
        places_of_saves = 8 * lanes, saves.out.ctypes.data, 8 * saves.columns, 8 * saves.column
        room = Room(
            parts=self.parts,
            part_rows=self.parts.size // 4,
            block=block,
            rows=rows,
            width=members,
            past=int(all(place % LINE == 0 for place in places_of_saves)),
            **{
                name: aligned(count * lanes, kind)
                for name, (count, kind) in self.working_memory(rows).items()
            },
        )
        run(self._advance, "p", framed(self._frame, steps, noise, saves, room))

    def working_memory(self, rows: int) -> dict[str, tuple[int, DTypeLike]]:
        """{name in Room: (how many numbers, of which kind)} that a member works in.

        rows : of its block
        """
        state = BODY_AT + rows - BODY, self.dtype
        return {
            "state": state,
            "near": state,
            "work": (KNOWN + rows, float),
            "aside": (KNOWN, float),
            "trace": (7 * (TRACE + 1) + START + self.shape.works, self.dtype),
            "saved": (max(1, self.shape.values), float),
        }


def framed(frame: Any, *given: NamedTuple) -> Any:
    """The record of `frame_type` with fields from NamedTuples.

    Uncompiled it is something with attributes of their names.
    """
    fields: Mapping[str, Any] = {k: v for part in given for k, v in part._asdict().items()}
    if config.DISABLE_JIT:
        flat = {k: v.ravel() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
        return SimpleNamespace(**vars(frame), **flat)
    frame = frame.copy()
    for name, value in fields.items():
        if isinstance(value, Piece):
            frame[name] = value.code, value.numbers
        elif isinstance(value, np.ndarray):
            frame[name] = value.__array_interface__["data"][0]
        else:
            frame[name] = value
    return frame


def lanes_for(dtype: DTypeLike) -> int:
    """How many members are worked on side by side; no result depends on it.

    They fill two registers for each number: while one waits for a result, the other is worked on.
    """
    return min(LANES, 2 * vector_bits() // (8 * np.dtype(dtype).itemsize))

"""The compiled kernels that move the members of a scene, and their working memory."""

from collections.abc import Callable, Generator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rigidmc.engine.compile_helper import compile_in_helper, helper_can
from rigidmc.engine.compile_time import announce_compiling, split_work
from rigidmc.engine.compiler.frozen import frozen
from rigidmc.engine.compiler.kernels import (
    NO_FUNCTION,
    NO_TANGENTS,
    CompiledFunction,
    KernelKey,
    Tangents,
    call_kernel,
    compile_kernel,
    config,
    is_compiled,
)
from rigidmc.engine.compiler.trees import tree_size
from rigidmc.engine.kernel import last_interval, layout, member, monitoring
from rigidmc.engine.kernel.arguments import (
    KernelShape,
    KernelTable,
    NoiseKeys,
    SaveTarget,
    StepRange,
    Workspace,
    letters_of,
    record_type,
)
from rigidmc.engine.kernel.block import TRACE, advance
from rigidmc.engine.kernel.events import TRIES, refine_event
from rigidmc.engine.kernel.growth import begin_growth, record_growth
from rigidmc.engine.kernel.march import march
from rigidmc.engine.kernel.samples import take_samples
from rigidmc.engine.machine import LINE, allocate_aligned, vector_bits
from rigidmc.engine.program_spec import Derivatives, ProgramSpec
from rigidmc.physics.dynamics.methods import flag, implements, static_count
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import has_memory, takes_noise
from rigidmc.physics.integrators.protocol import changes_state_form, interleaving, stepping_form
from rigidmc.physics.observables.protocol import size
from rigidmc.processes.threads import Late, is_late

NO_NOISE = NoiseKeys(np.uint64(0), np.uint64(0), np.zeros(1, np.uint64), np.zeros(0, np.int64))
NO_SAVES = SaveTarget(np.empty(0), 0, 0, np.empty(0, np.int64))
CALL = 3_000_000  # member-steps per call: 10 to 60 ms at 50 to 300 M/s on two threads


class Program:
    """The compiled kernels of a scene.

    lanes : members worked on at the same time, by default as many as suit this CPU; 1 if a custom
        class runs on one member at a time only
    ask : compile nothing; `missing` then names the kernels to compile
    meanwhile : called once this process has compiled its share, while another one may still compile
    """

    def __init__(
        self, spec: ProgramSpec, lanes: int | None = None, ask: bool = False,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        self.spec = spec = spec.settled()
        self.effects, self.dtype, derivatives = spec.effects, str(spec.dtype), spec.derivatives
        # With derivatives, a number and its derivatives fill the registers.
        moves_tangents = bool(derivatives.at_once or spec.growth)
        by_default = max(1, lanes_for(self.dtype) // (1 + moves_tangents))
        self.lanes = 1 if spec.is_scalar() else lanes or by_default
        self.substeps = np.ascontiguousarray(spec.scheme.substeps, dtype=float).ravel()

        marks, trailing = [len(m) for _, m in spec.running], spec.trailing
        growth, events = len(spec.growth), len(spec.events)
        parameters = tree_size(spec.effects)
        tail = len(layout.tail_of(tuple(spec.effects)))
        rows = layout.map_rows(parameters, trailing, events, marks, bool(growth), spec.axes, tail)
        self.rows = rows.end
        self.deferred = flag(spec.nodes == 1 and all_merge(spec.running))
        self.kept = TRACE * sum(marks) if self.deferred else 0
        self.tangents = self._tangents(derivatives)
        # along the steps, with the tangent that grows, which is the last one
        self.moving = NO_TANGENTS
        if moves_tangents:
            self.moving = self.tangents._replace(
                of_each=derivatives.at_once + growth,
                in_state=_rounded_up(self.row_counts(rows.end)["state"]),
            )
        random, integrator = any(map(takes_noise, spec.effects)), spec.scheme.integrator
        self.shape = KernelShape(
            lanes=self.lanes,
            values=sum(size(o.dims, len(spec.works)) for o in spec.observables),
            row_after=rows.in_state(rows.trailing),
            trailing=trailing,
            monitor_row=layout.MEMBER_ROWS + rows.events,
            axes_row=layout.MEMBER_ROWS + rows.axes,
            growth_row=layout.MEMBER_ROWS + rows.growth,
            # monitors compute in float64: one register per number
            monitors=max(1, 64 * self.lanes // vector_bits()) if spec.is_monitored else 0,
            nodes=spec.nodes,
            growth=growth,
            records=2 * events,
            tries=0 if random else TRIES,
            is_random=int(random or any(map(has_memory, spec.effects))),
            changes_length=int(spec.shortens and changes_state_form(integrator)),
            sampling=sum(map(has_memory, spec.effects)),
            reweighs=int(spec.shortens and bool(spec.running)),
            tangents=self.tangents.of_each,
            passes=derivatives.passes,
            tangents_in_state=self.moving.in_state,
            tangents_in_work=self.moving.in_work,
            parking=self.trace_rows + self.moving.of_each * self.moving.in_trace,
        )
        self.kernel_keys = self._make_keys()
        if not ask:
            self._compile(meanwhile)

    def _tangents(self, derivatives: Derivatives) -> Tangents:
        """Return the derivatives that kernels compute along with their numbers."""
        if not derivatives.at_once:
            return NO_TANGENTS
        counts = self.row_counts(self.rows)
        apart: dict[str, Any] = {f"in_{name}": _rounded_up(n) for name, n in counts.items()}
        body, effects = derivatives.of_body, derivatives.of_effects
        return Tangents(derivatives.at_once, **apart, of_body=body, of_effects=effects)

    def _make_keys(self) -> dict[str, KernelKey | None]:
        """Return {name: KernelKey} of all kernels, None for unused ones."""
        spec, shape, dual, moving = self.spec, self.shape, self.tangents, self.moving
        (integrator, substeps, _), effects = spec.scheme, spec.effects
        events, running, works, limits = spec.events, spec.running, spec.works, spec.limits
        attitude, compensated = flag(spec.attitude), flag(spec.compensated)
        groups = 1 if moving.of_each else min(self.lanes, interleaving(integrator))
        form, axes = frozen(stepping_form(integrator)), static_count(layout.AXES_ROWS * spec.axes)
        growing = NO_TANGENTS._replace(of_each=1, in_state=moving.of_each * moving.in_state)

        def key(kernel: Any, parts: Any, tangents: Any = dual) -> KernelKey:
            letters = letters_of(kernel)
            return KernelKey(kernel, parts, self.dtype, self.lanes, letters, tangents=tangents)

        assessed = form, effects, attitude, compensated, limits, works
        stepped = (
            integrator, effects, attitude, compensated, static_count(len(works)),
            static_count(groups), flag(len(substeps) > 2), flag(spec.paired),
        )  # fmt: skip
        table = {
            "gather": key(member.gather, (), NO_TANGENTS),
            "scatter": key(member.scatter, (), NO_TANGENTS),
            "initialise": key(member.initialise, (form, effects, limits, works)),
            "march": key(march, stepped, moving),
            "assess": key(member.assess, assessed),
        }
        if spec.observables:
            table["record"] = key(member.record, (spec.observables, effects, works, axes))
        if spec.is_monitored:
            begun = effects, events, running, axes
            table["begin_monitors"] = key(monitoring.begin_monitors, begun)
            dense, registers = static_count(min(shape.nodes, 2)), static_count(shape.monitors)
            steps = (
                form,
                effects,
                events,
                running,
                dense,
                axes,
                self.deferred,
                registers,
                static_count(len(works)),
            )
            table["monitor_steps"] = key(monitoring.monitor_steps, steps)
        if events:
            differentiated = flag(dual.of_each > 0)
            refined = form, effects, events, axes, differentiated, static_count(len(works))
            table["refine_event"] = key(refine_event, refined)
        if spec.growth:
            table["begin_growth"] = key(begin_growth, (form, effects), growing)
            table["record_growth"] = key(record_growth, (form, effects), growing)
        if shape.sampling:
            noisy = static_count(sum(map(takes_noise, effects)))
            sampled = form, effects, compensated, works, noisy
            table["take_samples"] = key(take_samples, sampled)
        if shape.changes_length:
            changed = form, effects, compensated, works
            table["change_length"] = key(last_interval.change_length, changed, moving)
        if shape.reweighs:
            table["reweigh"] = key(last_interval.reweigh, (effects, events, running))
        each = {name: table.get(name) for name in KernelTable._fields}
        return {**each, "advance": advance_key(self.dtype)}

    def _compile(self, meanwhile: Callable[[], None] | None = None) -> None:
        """Take the kernels from memory, and compile the missing ones."""
        if missing := self.missing():
            self._compile_missing(missing, meanwhile)
        compiled = [
            compile_kernel(key) if key else (NO_FUNCTION, None) for key in self.kernel_keys.values()
        ]
        # A kernel holds only the address of its numbers: they must live as long as the program.
        self._numbers = [numbers for _, numbers in compiled]
        *table, self._advance = (kernel for kernel, _ in compiled)
        record = record_type(self.dtype)
        empty = SimpleNamespace(real=1.0) if config.DISABLE_JIT else np.zeros(1, record)
        self._frame = fill_record(empty, KernelTable(*table), self.shape)

    def _compile_missing(
        self, missing: Sequence[str], meanwhile: Callable[[], None] | None
    ) -> None:
        """Compile kernels by name, some of them in a second process; Late at a deadline."""
        theirs = self.helper_share()
        keys = {name: key for name in missing if (key := self.kernel_keys[name])}
        with announce_compiling(self.label, missing, self.effects, theirs):
            with compile_in_helper([keys[name] for name in theirs]):
                for name in missing:
                    if is_late():
                        raise Late
                    if name not in theirs:
                        compile_kernel(keys[name])
                if meanwhile is not None:
                    meanwhile()
            for name in theirs:  # from the disk cache
                compile_kernel(keys[name])

    @property
    def trace_rows(self) -> int:
        """Rows of a trace: the states before and after each of TRACE steps."""
        rows: int = layout.traced(tuple(self.effects))
        return rows * (TRACE + 1)

    @property
    def copies(self) -> int:
        """Number of rows, in a block and in a save, for each number: its value and derivatives."""
        return 1 + self.shape.tangents * self.shape.passes

    @property
    def saved_values(self) -> int:
        """Numbers of a member's save, with their derivatives."""
        return self.shape.values * self.copies

    @property
    def label(self) -> str:
        """Display name: integrator and effects."""
        scheme = self.spec.scheme
        integrator = scheme.name or type(scheme.integrator).__name__
        words = [integrator, *(label for label, _ in label_effects(self.effects))]
        return " + ".join(words) + " in float32" * (self.dtype == "float32")

    def missing(self) -> list[str]:
        """Return names of the kernels that are neither in memory nor in the disk cache.

        "advance" is the loop that calls the others.
        """
        return [name for name, key in self.kernel_keys.items() if key and not is_compiled(key)]

    def helper_share(self) -> list[str]:
        """Return names of the missing kernels that a second process should compile."""
        if not (missing := self.missing()):
            return []
        able = helper_can({name: key for name in missing if (key := self.kernel_keys[name])})
        return split_work(self.label, missing, self.effects, able)

    def workers(self, threads: int, blocks: int, members: int, saves: int) -> int:
        """Return the number of threads for `blocks` blocks of `members` members with `saves` saves.

        Raises NoRoom if the memory where members move is too small.
        """
        return threads

    def places(self, threads: int) -> tuple[str, str]:
        """Return where members move, in words: one of these places, and all of them."""
        return "one thread", f"{threads} threads"

    def through(
        self, block: NDArray[np.float64], steps: StepRange, noise: NoiseKeys, saves: SaveTarget
    ) -> Generator[int, bool | None, None]:
        """Run `advance` by calls of at most 60 ms; yield the step after each of them.

        No result depends on the calls. send(True) to this generator copies the state after the last
        call to the block, from which other calls may continue at that step.
        """
        # A step of n substeps takes n times as long.
        longest = max(1, CALL // (max(1, block.shape[1]) * (len(self.spec.scheme.substeps) - 1)))
        first = steps.first
        while first < steps.last:
            last = min(steps.last, steps.whole(first + longest))
            self.advance(block, steps._replace(first=first, last=last), noise, saves)
            while (yield last):  # the state is in the block
                pass
            first = last

    def advance(
        self, block: NDArray[np.float64], steps: StepRange, noise: NoiseKeys | None = None,
        saves: SaveTarget | None = None,
    ) -> None:  # fmt: skip
        """Take a block through these steps; see `rigidmc.engine.kernel.block.advance`."""
        lanes, (rows, members) = self.lanes, block.shape
        rows //= self.copies
        noise = noise or NO_NOISE._replace(members=np.arange(members))
        saves = saves or NO_SAVES
        offsets = 8 * lanes, saves.out.ctypes.data, 8 * saves.columns, 8 * saves.column
        workspace = Workspace(
            substeps=self.substeps,
            substep_rows=self.substeps.size // 4,
            block=block,
            rows=rows,
            width=members,
            # Non-temporal stores write whole cache lines: each row of saves must begin on one.
            skips_cache=int(all(offset % LINE == 0 for offset in offsets)),
            **{
                name: allocate_aligned(count * lanes, kind)
                for name, (count, kind) in self.working_memory(rows).items()
            },
        )
        call_kernel(self._advance, "p", fill_record(self._frame, steps, noise, saves, workspace))

    def row_counts(self, rows: int) -> dict[str, int]:
        """Return {name: rows} of the memory with rows that may have derivatives; rows : of a
        block."""
        return {
            "state": layout.BODY_AT + rows - layout.BODY,
            "work": layout.MEMBER_ROWS + rows,
            "trace": self.trace_rows,
            "kept": max(1, self.kept),
        }

    def working_memory(self, rows: int) -> dict[str, tuple[int, DTypeLike]]:
        """Return {name in Workspace: (count, type)} of the numbers that one member works in.

        rows : of its block
        """
        count, counts = self.moving.of_each, self.row_counts(rows)
        state, work, trace, kept = (
            counts[name] + count * getattr(self.moving, f"in_{name}") for name in counts
        )
        parked = (1 + count) * (layout.START + self.shape.trailing)
        return {
            "state": (state, self.dtype),
            "spare_state": (state, self.dtype),
            "work": (work, float),
            "spare_work": (layout.MEMBER_ROWS + count * self.moving.in_work, float),
            "trace": (trace + parked, self.dtype),
            "kept": (kept, float),
            "saved": (max(1, self.shape.values * (1 + self.shape.tangents)), float),
        }


def _rounded_up(rows: int) -> int:
    """Return rows rounded up: fewer kernels differ only in their number of rows."""
    return -(-rows // 32) * 32


def all_merge(running: Sequence[Any]) -> bool:
    """Return whether running observables have extrema, which can be found after later steps."""
    sought = [one for one, _ in running if implements(one, "extrema")]
    return bool(sought) and all(implements(one, "merged") for one in sought)


def advance_key(dtype: str) -> KernelKey:
    """Return the KernelKey of `advance`, one for all scenes."""
    return KernelKey(advance, (), dtype, 0, "r", record_type(dtype))


def fill_record(frame: Any, *groups: NamedTuple) -> Any:
    """Copy a frame, the record of `record_type`, with fields set from NamedTuples.

    Uncompiled, it is an object with attributes of these names.
    """
    fields: Mapping[str, Any] = {k: v for group in groups for k, v in group._asdict().items()}
    if config.DISABLE_JIT:
        flat = {k: v.ravel() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
        return SimpleNamespace(**vars(frame), **flat)
    frame = frame.copy()
    for name, value in fields.items():
        if isinstance(value, CompiledFunction):
            frame[name] = value.address, value.numbers
        elif isinstance(value, np.ndarray):
            frame[name] = value.__array_interface__["data"][0]
        else:
            frame[name] = value
    return frame


def lanes_for(dtype: DTypeLike) -> int:
    """Return how many members are worked on at the same time; no result depends on it."""
    # Two registers per number: while one waits for a result, the CPU works on the other.
    return min(layout.LANES, 2 * vector_bits() // (8 * np.dtype(dtype).itemsize))

"""Six tangents of each member: seeds that span its tangent space, and their growth. A task of the
study is a block of members with their tangents.

A block holds six derivatives of each number, see `rigidmc.engine.program.Derivatives`. Read as the
derivatives of a state (q, L) along six changes of the start, they are the tangents. Between calls
of the engine, `TangentProgram` makes them orthonormal again, by operations on whole columns, which
the linear flow of the tangents keeps.
"""

from collections.abc import Generator, Sequence
from typing import Any

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import NoiseKeys, SaveTarget, StepRange
from rigidmc.engine.machine import allocate_block
from rigidmc.engine.program import Program
from rigidmc.engine.program_spec import Derivatives
from rigidmc.engine.threads import run_blocks
from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.planning.plan import Plan
from rigidmc.planning.steps import order_by_steps, rate_bounds
from rigidmc.runs.assemble import make_program
from rigidmc.runs.blocks import BlockJob, steps_of
from rigidmc.runs.directory.tasks import Request, TaskArrays
from rigidmc.runs.prepare import PreparedRun

COUNT = 6  # dimensions of attitude and momentum
# Bodies and effects do not change. In two passes a step takes 7.7 (rk4), 9.4 (rk8), 8.9 (strang)
# and 9.2 (exact) times as long as without tangents; in one pass 8.5, 15.5, 9.9 and 9.7, because
# six tangents do not fit in registers; in three passes 7.8, 9.7, 9.7 and 10.3 (Zen 5, one thread).
TANGENTS = Derivatives(at_once=3, passes=2, of_body=False, of_effects=False)
# rows of a tangent: of the true state at the last save, and of the state of the integrator, which
# may have another form and extra numbers
TRUE = slice(layout.GOOD_STATE, layout.GOOD_STATE + 7)
STATE = slice(layout.ATTITUDE, layout.START)
# The seeds are these combinations of rotations about the body axes and changes of L along them: an
# orthogonal matrix without zeros (a discrete sine transform), so that no seed lies in a subspace
# that the motion of a special start never leaves.
_ODD = 2 * np.arange(COUNT) + 1
MIXED = np.sqrt(2.0 / COUNT) * np.sin(np.pi / (4 * COUNT) * np.outer(_ODD, _ODD))


def with_tangents(members: Array, scale: Array) -> Array:
    """Return a block of members (rows, n) with the rows of their six seeds, which are orthonormal
    in the metric ::

        |x|^2 = 4 |dq|^2 + |dL|^2/scale^2

    scale : of the changes of L of each member (n,), in the units of integration
    """
    rows, count = members.shape
    block = np.zeros(((1 + COUNT) * rows, count))
    block[:rows] = members
    seeds = block[rows:].reshape(COUNT, rows, count)
    w, x, y, z = members[layout.ATTITUDE : layout.MOMENTUM]
    for i, turn in enumerate(([-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w])):  # q (0, e_i)
        for mixed, seed in zip(MIXED, seeds, strict=True):
            seed[layout.ATTITUDE : layout.MOMENTUM] += 0.5 * mixed[i] * np.array(turn)
            seed[layout.MOMENTUM + i] = mixed[3 + i] * scale
    return block


def orthonormalise(vectors: Array, size: int) -> Array:
    """Make vectors (COUNT, rows, n) orthonormal in their first `size` rows, in place, by the
    modified method of Gram and Schmidt; return R (COUNT, COUNT, n), with vectors = Q R.

    The same combinations apply to all rows.
    """
    # Sums run over rows, member by member: no result depends on the other members.
    r = np.zeros((COUNT, COUNT, vectors.shape[-1]))
    for i, vector in enumerate(vectors):
        r[i, i] = np.sqrt((vector[:size] ** 2).sum(axis=0))
        vector /= r[i, i]
        others = vectors[i + 1 :]
        r[i, i + 1 :] = (vector[:size] * others[:, :size]).sum(axis=1)
        # At once, from the reduced vectors: for lengths e^12 apart, the most of TURN, they are
        # orthogonal to 2e-6, and after the classical method, from the given vectors, not at all.
        others -= r[i, i + 1 :, None] * vector
    return r


class CompensatedSum:
    """Sums of many small terms, with their rounding.

    Source: Neumaier, Z. angew. Math. Mech. 54 (1974) 39.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._sum, self._lost = np.zeros(shape), np.zeros(shape)

    def add(self, x: Array) -> None:
        """Add a term to each sum."""
        total = self._sum + x
        is_larger = np.abs(self._sum) >= np.abs(x)
        large, small = np.where(is_larger, self._sum, x), np.where(is_larger, x, self._sum)
        self._lost += (large - total) + small
        self._sum = total

    @property
    def value(self) -> Array:
        """The sums so far."""
        return self._sum + self._lost


class TangentGrowth:
    """The growth of the tangents of n members.

    `unit` has the directions of the seeds as they have moved, as unit vectors in the orthonormal
    basis: U <- R U, with columns made unit vectors. Its diagonal is the product of R's, divided by
    the lengths of the columns, whose logarithms are summed: GALI_k is the volume of the first k
    columns.
    """

    def __init__(self, count: int) -> None:
        self._grown, self._stretched = (CompensatedSum((COUNT, count)) for _ in range(2))
        self._unit = np.repeat(np.eye(COUNT)[..., None], count, axis=-1)

    def add(self, r: Array) -> None:
        """Add the growth R (COUNT, COUNT, n) since the last orthonormalisation."""
        self._grown.add(np.log(np.array([r[i, i] for i in range(COUNT)])))
        moved = np.einsum("ikn,kjn->ijn", r, self._unit)
        length = np.sqrt((moved**2).sum(axis=0))
        self._unit = moved / length
        self._stretched.add(np.log(length))

    @property
    def logarithms(self) -> Array:
        """ln of the growth along each vector of the basis (COUNT, n)."""
        return self._grown.value

    @property
    def log_gali(self) -> Array:
        """ln GALI_k, k = 2 ... COUNT (COUNT - 1, n)."""
        return np.cumsum(self._grown.value - self._stretched.value, axis=0)[1:]


class TangentProgram:
    """A Program with the tangents of one block, orthonormal after each save of the plan.

    program : with TANGENTS;  scale : as in `with_tangents`
    kept : numbers of the saves at which the growth is kept, increasing
    history : {property of `TangentGrowth`: (saves, ..., n)}, nan from the save on at which a member
        is flagged
    """

    def __init__(self, program: Program, scale: Array, kept: Ints) -> None:
        self.program, self._scale, self._growth = program, scale, TangentGrowth(scale.size)
        self._slots = {int(save): slot for slot, save in enumerate(kept)}
        self.history = {
            name: np.full((kept.size, rows, scale.size), np.nan)
            for name, rows in (("logarithms", COUNT), ("log_gali", COUNT - 1))
        }

    def through(
        self, block: Array, steps: StepRange, noise: NoiseKeys, saves: SaveTarget
    ) -> Generator[int, bool | None, None]:
        """Take a block through the steps, as `Program.through`; yield the step after each save."""
        for first in range(steps.first, steps.last, steps.stride):
            last = min(steps.last, first + steps.stride)
            self.program.advance(block, steps._replace(first=first, last=last), noise)
            self._orthonormalise(block, -(-last // steps.stride))
            yield last

    def _orthonormalise(self, block: Array, save: int) -> None:
        """Make the tangents of a block orthonormal, and count their growth."""
        rows, count = block.shape[0] // (1 + COUNT), block.shape[1]
        tangents = block[rows:].reshape(COUNT, rows, count)
        vectors = np.concatenate([tangents[:, TRUE], tangents[:, STATE]], axis=1)
        vectors[:, :4] *= 2.0
        vectors[:, 4:7] /= self._scale
        with np.errstate(all="ignore"):  # a flagged member has no growth
            self._growth.add(orthonormalise(vectors, 7))
            tangents[:, STATE] = vectors[:, 7:]
            if (slot := self._slots.get(save)) is not None:
                healthy = block[layout.STATUS] == 0.0
                for name, saves in self.history.items():
                    saves[slot] = np.where(healthy, getattr(self._growth, name), np.nan)


def kept_saves(plan: Plan, keep: int) -> Ints:
    """Return the saves at which the growth is kept: every `keep`-th one, and the last."""
    last = plan.grid.saves - 1
    return np.unique(np.append(np.arange(keep, last, keep), last))


def compute_members(
    run: PreparedRun, request: Request, numbers: Sequence[int], threads: int, device: str | None
) -> list[TaskArrays]:
    """Compute the members of tasks; return their growth."""
    if device not in (None, "cpu"):
        rule = "a spectrum is computed on the CPU: leave it out"
        raise OptionError(rule, at="device", value=device)
    size = request["size"]
    # the kernel needs the state at saves, but writes no values
    plan = run.plan._replace(recording=run.scene.with_run(save=()).recording)
    program, kept = make_program(plan, derivatives=TANGENTS), kept_saves(plan, request["keep"])
    assert program is not None
    done: dict[int, TaskArrays] = {}

    def make(number: int) -> BlockJob:
        """Return a block of members with their tangents at the start."""
        first, count = number * size, min(size, run.members.size - number * size)
        rows = run.initial(run.members.first + first, count)[0]
        order, slots = None, 1
        if plan.has_member_steps:
            order, slots = order_by_steps(rows), int(rows[layout.STEPS].max())
            rows = rows[:, order]
        largest = 1.0 / rows[layout.BODY : layout.BODY + 3].min(axis=0)
        rate = rate_bounds(plan.model.effects, rows)
        scale = largest * np.where(np.isfinite(rate) & (rate > 0.0), rate, 1.0)
        block = allocate_block((1 + COUNT) * rows.shape[0], rows.shape[1])
        block[:] = with_tangents(rows, scale)
        members = run.members.indices(run.members.first + first, rows.shape[1])
        return BlockJob(
            first=first,
            size=count,
            members=members,
            start={},
            program=TangentProgram(program, scale, kept),  # type: ignore[arg-type]  # only `through`
            noise=plan.noise(members),
            block=block,
            order=order,
            out=np.empty(0),
            width=0,
            column=0,
            steps=steps_of(plan, slots),
        )

    def finished(job: BlockJob) -> None:
        done[job.first // size] = _results(job)

    # with `poll`, the deadline is checked five times a second
    run_blocks(make, numbers, threads, finished, poll=lambda: None)
    return [done[number] for number in numbers]


def _results(job: BlockJob) -> TaskArrays:
    """Return the growth and the status of the members of a block, in their order."""
    program: Any = job.program
    back = slice(None) if job.order is None else np.argsort(job.order)
    status = job.block[layout.STATUS].astype("i1")
    arrays = {**program.history, "flag": status}
    return {name: x[..., back][..., : job.size].copy() for name, x in arrays.items()}

"""The memory of a WebAssembly module with a block in it: what a page or a runtime loads to move the
members of the block."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compiler.kernels import CompiledFunction
from rigidmc.engine.kernel.arguments import (
    KernelTable,
    NoiseKeys,
    SaveTarget,
    StepRange,
    Workspace,
    record_type,
)
from rigidmc.engine.linked import LinkedProgram
from rigidmc.engine.program import fill_record

PAGE = 65536  # bytes: memory grows by pages
STACK = 2**19  # bytes below all numbers; the frames of kernels take up to 100 kB
ALIGNED = 64


class Image(NamedTuple):
    """Memory with a block, and where things are in it.

    content : bytes from address 0 on
    frame, block, out : addresses of the frame of all arguments, of the block, and of saves
    """

    content: bytes
    frame: int
    block: int
    out: int


class _Memory:
    """Memory that grows by numbers."""

    def __init__(self) -> None:
        self.content = bytearray(STACK)

    def put(self, array: Any) -> int:
        """Append an array and return its address."""
        at = -(-len(self.content) // ALIGNED) * ALIGNED
        self.content.extend(bytes(at - len(self.content)))
        self.content.extend(np.ascontiguousarray(array).tobytes())
        return at


def image_of(
    program: LinkedProgram,
    block: NDArray[np.float64],
    steps: StepRange,
    noise: NoiseKeys,
    saves: int,
    order: NDArray[np.int64],
) -> Image:
    """Return memory in which `members` makes these steps.

    saves : places for saves in `out`
    order : as in `rigidmc.engine.kernel.arguments.SaveTarget`
    """
    memory, members = _Memory(), block.shape[1]
    rows = len(block) // program.copies
    numbers = [CompiledFunction(0, 0, memory.put(one)) for one in program.kernel_numbers()]
    if steps.save_count:
        steps = steps._replace(save_steps=memory.put(steps.save_steps))
    at = memory.put(block)
    workspace = Workspace(
        substeps=memory.put(program.substeps),
        substep_rows=program.substeps.size // 4,
        block=at,
        rows=rows,
        width=members,
        skips_cache=0,
        **dict.fromkeys(program.working_memory(rows), 0),  # on the stack
    )
    known = NoiseKeys(
        noise.key, noise.second_key, memory.put(noise.streams), memory.put(noise.members)
    )
    out = memory.put(np.zeros(program.saved_values * members * saves))
    target = SaveTarget(out, members if saves else 0, 0, memory.put(order))
    empty = np.zeros(1, record_type(program.dtype))
    groups = KernelTable(*numbers), program.shape, known, workspace, steps, target
    frame = memory.put(fill_record(empty, *groups))
    content = memory.content + bytes(-len(memory.content) % PAGE)
    return Image(bytes(content), frame, at, out)

"""Blocks of members in WebAssembly: the memory that a page loads, and a runtime without a page."""

import base64
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.arguments import NoiseKeys, SaveTarget, StepRange
from rigidmc.engine.linked import KERNEL, LinkedProgram
from rigidmc.engine.program import NO_NOISE, NO_SAVES, fill_record
from rigidmc.engine.wasm.fused import LANES, RELAXED
from rigidmc.engine.wasm.module import wasm_of
from rigidmc.errors import NoDevice

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


class WasmProgram(LinkedProgram):
    """A LinkedProgram whose members move in WebAssembly; `advance` as in Program.

    fused : the version of fused multiply-adds, see `rigidmc.engine.wasm.fused`
    """

    def __init__(self, *arguments: Any, fused: str = RELAXED, **named: Any) -> None:
        self.target = fused
        super().__init__(*arguments, **{"lanes": LANES, **named})

    def make_code(self, target: str) -> str:
        """Return a module as text; target : the version of fused multiply-adds."""
        return base64.b64encode(wasm_of(self.linked(), target)).decode()

    def module_of(self, target: str) -> bytes:
        """Return the module with a version of fused multiply-adds."""
        return base64.b64decode(self.code_for(target))

    def image(
        self,
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
        content = bytearray(STACK)

        def put(array: NDArray[Any]) -> int:
            """Append an array and return its address."""
            content.extend(bytes(-len(content) % ALIGNED))
            content.extend(array.tobytes())
            return len(content) - array.nbytes

        if steps.save_count:
            steps = steps._replace(save_steps=put(steps.save_steps))
        steps = steps._replace(cuts=put(steps.cuts))
        kernels = [put(numbers) for numbers in self.kernel_numbers()]
        frame, at = self.frame_for(put, block, noise, kernels, put(self.substeps))
        members = block.shape[1]
        out = put(np.zeros(self.saved_values * members * saves))
        target = SaveTarget(out, members if saves else 0, 0, put(order))
        frame_at = put(fill_record(frame, steps, target))
        content.extend(bytes(-len(content) % PAGE))
        return Image(bytes(content), frame_at, at, out)

    def advance(
        self,
        block: NDArray[np.float64],
        steps: StepRange,
        noise: NoiseKeys | None = None,
        saves: SaveTarget | None = None,
    ) -> None:
        """Do the same as `Program.advance`."""
        members, saves = block.shape[1], saves or NO_SAVES
        noise = noise or NO_NOISE._replace(members=np.arange(members))
        places = steps.saves_until(steps.total) if saves.columns else 0
        image = self.image(block, steps, noise, places, saves.order)
        memory = Runtime(self.module_of(self.target), image.content)
        for low in range(0, members, self.lanes):
            memory.call(KERNEL, image.frame, low, 2**31 - 1)
        block[:] = memory.numbers(image.block, block.size).reshape(block.shape)
        if places:
            first = steps.saves_until(steps.first) if steps.first else 0
            new = slice(first, steps.saves_until(steps.last))
            shape = places, self.saved_values, members
            saved = memory.numbers(image.out, int(np.prod(shape))).reshape(shape)
            out = saves.out.reshape(-1, self.saved_values, saves.columns)
            out[new, :, saves.column : saves.column + members] = saved[new]


class Runtime:
    """A module in a WebAssembly runtime, with its memory.

    content : of the memory, below STACK the stack
    """

    def __init__(self, module: bytes, content: bytes) -> None:
        try:
            w: Any = import_module("wasmtime")  # its types do not say that its classes are callable
        except ImportError as error:
            raise NoDevice(f"wasm: requires wasmtime: pip install wasmtime ({error})") from None
        self.store = w.Store()
        made = w.Module(self.store.engine, module)
        self.memory = w.Memory(self.store, w.MemoryType(w.Limits(len(content) // PAGE, None)))
        number = w.GlobalType(w.ValType.i32(), True)
        pointer = w.Global(self.store, number, w.Val.i32(STACK))
        provided = {"__linear_memory": self.memory, "__stack_pointer": pointer}
        imports = [provided[item.name] for item in made.imports]
        self.exports = w.Instance(self.store, made, imports).exports(self.store)
        self.memory.write(self.store, content)

    def call(self, name: str, *arguments: float) -> Any:
        """Call a function that the module exports."""
        return self.exports[name](self.store, *arguments)

    def numbers(self, at: int, count: int) -> NDArray[np.float64]:
        """Return numbers from an address on."""
        return np.frombuffer(self.memory.read(self.store, at, at + 8 * count))

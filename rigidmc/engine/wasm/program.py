"""Blocks of members in a WebAssembly runtime: what a page computes, checked without a browser."""

import base64
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.arguments import NoiseKeys, SaveTarget, StepRange
from rigidmc.engine.linked import KERNEL, LinkedProgram
from rigidmc.engine.program import NO_NOISE, NO_SAVES
from rigidmc.engine.wasm.fused import RELAXED
from rigidmc.engine.wasm.image import PAGE, STACK, image_of
from rigidmc.engine.wasm.module import wasm_of
from rigidmc.errors import NoDevice

LANES = 2  # float64 in a vector of WebAssembly


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
        image = image_of(self, block, steps, noise, places, saves.order)
        memory = Runtime(self.module_of(self.target), image.content, STACK)
        for low in range(0, members, self.lanes):
            memory.call(KERNEL, image.frame, low, 2**31 - 1)
        block[:] = memory.numbers(image.block, block.size).reshape(block.shape)
        if places:
            found = memory.numbers(image.out, places * self.saved_values * members)
            known = found.reshape(places, self.saved_values, members)
            out = saves.out.reshape(-1, self.saved_values, saves.columns)
            first = steps.saves_until(steps.first) if steps.first else 0
            columns = slice(saves.column, saves.column + members)
            for k in range(first, steps.saves_until(steps.last)):
                out[k, :, columns] = known[k]


class Runtime:
    """A module in a WebAssembly runtime, with its memory."""

    def __init__(self, module: bytes, content: bytes, stack: int) -> None:
        try:
            w: Any = import_module("wasmtime")  # its types do not say that its classes are callable
        except ImportError as error:
            raise NoDevice(f"wasm: requires wasmtime: pip install wasmtime ({error})") from None
        self.store = w.Store()
        limits = w.Limits(len(content) // PAGE, None)
        self.memory = w.Memory(self.store, w.MemoryType(limits))
        kind = w.GlobalType(w.ValType.i32(), True)
        pointer = w.Global(self.store, kind, w.Val.i32(stack))
        made = w.Module(self.store.engine, module)
        known = {"__linear_memory": self.memory, "__stack_pointer": pointer}
        imports = [known[one.name] for one in made.imports]
        self.exports = w.Instance(self.store, made, imports).exports(self.store)
        self.memory.write(self.store, content)

    def call(self, name: str, *arguments: int) -> None:
        self.exports[name](self.store, *arguments)

    def numbers(self, at: int, count: int) -> NDArray[np.float64]:
        """Return numbers from an address on."""
        return np.frombuffer(self.memory.read(self.store, at, at + 8 * count))

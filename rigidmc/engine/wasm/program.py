"""Blocks of members in a WebAssembly runtime: what a page computes, checked without a browser."""

import base64
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compile_time import announce_compiling
from rigidmc.engine.compiler.disk_cache import cached_text, has_text
from rigidmc.engine.compiler.kernels import signature_of
from rigidmc.engine.kernel.arguments import NoiseKeys, SaveTarget, StepRange, save_numbers
from rigidmc.engine.linked import KERNEL, link_kernel
from rigidmc.engine.program import NO_NOISE, NO_SAVES, Program
from rigidmc.engine.wasm.fused import RELAXED
from rigidmc.engine.wasm.image import PAGE, STACK, image_of
from rigidmc.engine.wasm.module import wasm_of
from rigidmc.errors import NoDevice

LANES = 2  # float64 in a vector of WebAssembly


class WasmProgram(Program):
    """A Program whose members move in WebAssembly; `advance` as in Program.

    fused : the version of fused multiply-adds, see `rigidmc.engine.wasm.fused`
    """

    def __init__(self, *arguments: Any, fused: str = RELAXED, **named: Any) -> None:
        self.fused = fused
        super().__init__(*arguments, **{"lanes": LANES, **named})

    def missing(self) -> list[str]:
        """Return ["kernel"] if it is neither in memory nor in the disk cache."""
        return [] if has_text(*self._key(self.fused)) else ["kernel"]

    def helper_share(self) -> list[str]:
        """Return an empty list: one process compiles the one kernel."""
        return []

    def _compile(self, meanwhile: Callable[[], None] | None = None) -> None:
        with announce_compiling(self.label, self.missing(), self.effects):
            self.module = self.module_of(self.fused)

    def module_of(self, fused: str) -> bytes:
        """Return the module with a version of fused multiply-adds."""

        def make() -> str:
            linked = link_kernel(self.kernel_keys, self.shape, self._sizes())
            return base64.b64encode(wasm_of(linked, fused)).decode()

        return base64.b64decode(cached_text(*self._key(fused), make))

    def _key(self, fused: str) -> tuple[list[Any], str]:
        """Return (types of the kernels, the other inputs of the code)."""
        types = [signature_of(key) for key in self.kernel_keys.values() if key]
        return types, f"{self.shape} {self._sizes()} wasm {fused}"

    def _sizes(self) -> dict[str, int]:
        """Return {name in Workspace: bytes} of the memory that the members of a call work in."""
        return {
            name: count * np.dtype(kind).itemsize * self.lanes
            for name, (count, kind) in self.working_memory(self.rows).items()
        }

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
        places = -(-steps.total // steps.stride) + 1 if saves.columns else 0
        image = image_of(self, block, steps, noise, places, saves.order)
        memory = Runtime(self.module, image.content, STACK)
        for low in range(0, members, self.lanes):
            memory.call(KERNEL, image.frame, low, 2**31 - 1)
        block[:] = memory.numbers(image.block, block.size).reshape(block.shape)
        if places:
            found = memory.numbers(image.out, places * self.saved_values * members)
            known = found.reshape(places, self.saved_values, members)
            out = saves.out.reshape(-1, self.saved_values, saves.columns)
            made = save_numbers(steps, steps.first, steps.last)
            columns = slice(saves.column, saves.column + members)
            for k in made:
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

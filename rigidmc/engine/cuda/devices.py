"""Where members move: on this CPU or on GPUs; no bit of a result depends on it.

First the words cpu, cuda, cuda:1 and auto, then the functions of the CUDA driver: devices, modules
of code, and streams.
"""

import ctypes
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import NoDevice, OptionError, nearest

# "wasm" moves members in a WebAssembly runtime, for tests: no help names it
WORDS = ("cpu", "cuda", "auto", "wasm")


def resolve_device(word: str | None) -> str:
    """Return the device of a word: "cpu", "cuda" or "cuda:1".

    word : "cpu", "cuda" for all GPUs, "cuda:1" for one, "auto" for all usable GPUs if there are
        any, else "cpu"; None for "cpu"

    Raises OptionError for another word, NoDevice if there is no such device, or no driver.
    """
    if word is None:
        return "cpu"
    if word not in WORDS and not re.fullmatch(r"cuda:\d{1,3}", word):
        rule = "expected cpu, cuda, cuda:NUMBER or auto"
        raise OptionError(rule, at="device", value=word, nearest=nearest(word, WORDS[:3]))
    if word == "auto":
        try:
            select_devices(None)
        except NoDevice:
            return "cpu"
        return "cuda"
    if is_gpu(word):
        select_devices(device_number(word))
    return word


def is_gpu(device: str) -> bool:
    """Whether a device is a GPU, or all of them."""
    return device.startswith("cuda")


def device_number(name: str) -> int | None:
    """Return the number of the one device of a word, None for all."""
    _, _, number = name.partition(":")
    return int(number) if number else None


Array = NDArray[Any]
BLOCKING = 4  # CU_CTX_SCHED_BLOCKING_SYNC
THREADS = 128, 64, 256, 32  # threads per block of PTX, best first if occupancy is equal
TARGETS = (7, 0), (8, 0), (9, 0)  # compute capabilities of compiled code; later ones accept it
# Fused multiply-adds in float64 per multiprocessor and cycle, by compute capability; others 2
FUSED = {(7, 0): 32, (8, 0): 32, (9, 0): 64, (10, 0): 64}


class Device(NamedTuple):
    """A GPU, by its number.

    capability : compute capability
    processors : number of multiprocessors
    clock : [Hz]
    memory : bytes
    driver : CUDA version that the driver supports
    """

    number: int
    name: str
    capability: tuple[int, int]
    processors: int
    clock: float
    memory: int
    driver: tuple[int, int]

    @property
    def peak(self) -> float:
        """Largest number of float64 operations per second; a fused multiply-add counts as two.

        Source: CUDA C++ Programming Guide, throughput of native arithmetic instructions.
        """
        return 2.0 * self.processors * self.clock * FUSED.get(self.capability, 2)


def _library() -> Any:
    """Return the functions of the driver; raise NoDevice if they or the driver are missing."""
    try:
        from cuda.bindings import driver
    except ImportError:
        rule = "needs the package cuda-bindings: pip install 'rigidmc[cuda]'"
        raise NoDevice(f"cuda: {rule}") from None
    return driver


def call_driver(name: str, *arguments: Any) -> Any:
    """Call a function of the driver and return its answer; raise NoDevice with the reason."""
    driver = _library()
    try:
        error, *answer = getattr(driver, name)(*arguments)
    except RuntimeError as missing:  # the driver's library, or a function in it, is missing
        raise NoDevice(f"cuda: the NVIDIA driver is missing or too old: {missing}") from None
    if int(error) != 0:
        words = (_text(tell(error)[1]) for tell in (driver.cuGetErrorName, driver.cuGetErrorString))
        raise NoDevice(f"cuda: {name} failed: {', '.join(words)}")
    return answer[0] if len(answer) == 1 else answer


def _text(text: bytes | None) -> str:
    return (text or b"unknown").partition(b"\0")[0].decode(errors="replace").strip()


@cache
def devices() -> tuple[Device, ...]:
    """Return the GPUs of this machine; raise NoDevice if there are none."""
    call_driver("cuInit", 0)
    # Queried once per process: a GPU added later is not seen.
    version = call_driver("cuDriverGetVersion")
    attributes = _library().CUdevice_attribute

    def device(number: int) -> Device:
        handle = call_driver("cuDeviceGet", number)

        def attribute(word: str) -> int:
            kind = getattr(attributes, f"CU_DEVICE_ATTRIBUTE_{word}")
            return int(call_driver("cuDeviceGetAttribute", kind, handle))

        return Device(
            number,
            _text(call_driver("cuDeviceGetName", 256, handle)),
            (attribute("COMPUTE_CAPABILITY_MAJOR"), attribute("COMPUTE_CAPABILITY_MINOR")),
            attribute("MULTIPROCESSOR_COUNT"),
            1e3 * attribute("CLOCK_RATE"),
            int(call_driver("cuDeviceTotalMem", handle)),
            (version // 1000, version % 1000 // 10),
        )

    devices_here = tuple(map(device, range(call_driver("cuDeviceGetCount"))))
    if not devices_here:
        raise NoDevice("cuda: the driver finds no GPU")
    return devices_here


def select_devices(number: int | None) -> tuple[Device, ...]:
    """Return the GPUs that a run should use: the one with a number, or all that are recent enough.

    Raises NoDevice if there is none.
    """
    every = devices()
    if number is not None and number >= len(every):
        raise NoDevice(f"cuda:{number}: the devices are cuda:0 to cuda:{len(every) - 1}")
    wanted = every if number is None else every[number : number + 1]
    # PTX is made for a capability or a later one, so an older GPU rejects it.
    usable = tuple(device for device in wanted if device.capability >= TARGETS[0])
    if not usable:
        rule = "{}.{}; code requires {}.{} or later".format(*wanted[0].capability, *TARGETS[0])
        raise NoDevice(f"cuda:{wanted[0].number}: {wanted[0].name} has compute capability {rule}")
    return usable


class Module:
    """The code and numbers of a program, loaded on a GPU.

    ptx, kernel : the code, and the name of the function to launch
    numbers : addresses of copies of arrays
    threads, resident : threads per block of PTX, and threads resident per multiprocessor
    """

    def __init__(self, device: Device, ptx: str, kernel: str, arrays: Sequence[Array]) -> None:
        handle = call_driver("cuDeviceGet", device.number)
        with suppress(NoDevice):  # a waiting thread leaves its core to others
            call_driver("cuDevicePrimaryCtxSetFlags", handle, BLOCKING)
        self._context = call_driver("cuDevicePrimaryCtxRetain", handle)
        with self.entered():
            self._handle = call_driver("cuModuleLoadData", ptx.encode() + b"\0")
            self.kernel = call_driver("cuModuleGetFunction", self._handle, kernel.encode())
            self.threads, self.resident = self._threads()
            self._held = [call_driver("cuMemAlloc", array.nbytes) for array in arrays]
            self.numbers = list(map(int, self._held))
            for address, array in zip(self.numbers, arrays, strict=True):
                call_driver("cuMemcpyHtoD", address, array.ctypes.data, array.nbytes)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Make this device current for this thread in the body of a `with`."""
        call_driver("cuCtxPushCurrent", self._context)
        try:
            yield
        finally:
            call_driver("cuCtxPopCurrent")

    def _threads(self) -> tuple[int, int]:
        name = "cuOccupancyMaxActiveBlocksPerMultiprocessor"
        at_work = {size: size * int(call_driver(name, self.kernel, size, 0)) for size in THREADS}
        best = max(at_work, key=lambda size: at_work[size])
        return best, at_work[best]

    def __del__(self) -> None:
        with suppress(Exception), self.entered():  # the driver may be gone at exit
            for address in self._held:
                call_driver("cuMemFree", address)
            call_driver("cuModuleUnload", self._handle)


class CudaStream:
    """A stream of a GPU, and the memory of its work."""

    def __init__(self, module: Module) -> None:
        self.module, self._held = module, list[Any]()
        self._pinned: tuple[Array, int] = (np.empty(0), 0)
        with module.entered():
            self._handle = call_driver("cuStreamCreate", 1)  # 1: it does not wait for the others

    def room(self, size: int) -> int:
        """Allocate `size` bytes on the GPU until `free`, and return their address."""
        self._held.append(call_driver("cuMemAlloc", max(1, size)))
        return int(self._held[-1])

    def put(self, array: Array) -> int:
        """Copy an array to the GPU until `free`, and return the address of the copy."""
        address = self.room(array.nbytes)
        if array.nbytes:
            self.write(address, array)
        return address

    def write(self, address: int, array: Array) -> None:
        """Copy an array to the GPU."""
        call_driver("cuMemcpyHtoDAsync", address, array.ctypes.data, array.nbytes, self._handle)
        self.wait()

    def read(self, array: Array, address: int) -> None:
        """Copy from the GPU to an array."""
        call_driver("cuMemcpyDtoHAsync", array.ctypes.data, address, array.nbytes, self._handle)
        self.wait()

    def pinned(self, count: int) -> Array:
        """Return host memory for `count` numbers that a GPU writes to at full speed."""
        if self._pinned[0].size < count:
            self._unpin()
            address = int(call_driver("cuMemAllocHost", 8 * count))
            memory = (ctypes.c_double * count).from_address(address)
            self._pinned = np.ctypeslib.as_array(memory), address
        return self._pinned[0][:count]

    def launch(self, frame: int, members: int) -> None:
        """Launch one thread per member, which takes it through the steps of a frame on the GPU."""
        size = self.module.threads
        packed = (frame, 0, members), (ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
        grid = -(-members // size), 1, 1, size, 1, 1
        call_driver("cuLaunchKernel", self.module.kernel, *grid, 0, self._handle, packed, 0)

    def wait(self) -> None:
        """Wait until all work queued on the GPU is done."""
        call_driver("cuStreamSynchronize", self._handle)

    def free(self) -> None:
        """Free the memory of `room` and `put`."""
        while self._held:
            with suppress(NoDevice):  # a lost GPU has already raised an error
                call_driver("cuMemFree", self._held.pop())

    def _unpin(self) -> None:
        _, address = self._pinned
        self._pinned = np.empty(0), 0
        if address:
            call_driver("cuMemFreeHost", address)

    def __del__(self) -> None:
        with suppress(Exception), self.module.entered():  # the driver may be gone at exit
            self.free()
            self._unpin()
            call_driver("cuStreamDestroy", self._handle)

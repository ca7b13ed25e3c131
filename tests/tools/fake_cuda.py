"""A stand-in for the driver of NVIDIA: device memory is this machine's, and a launch runs the
kernel's own code here, one member after the other.

Its functions have the names, arguments and answers of `cuda.bindings.driver`. Memory is only what
was taken and not yet given back: other addresses are refused.
"""

import ctypes
import functools
import sys
import threading
import types

import llvmlite.binding as llvm
import numpy as np
import pytest

from rigidmc.engine import linked
from rigidmc.engine.cuda import devices as cuda_device
from rigidmc.engine.cuda import program as cuda
from rigidmc.engine.linked import link_kernel, optimise


class Code(int):
    """A CUresult."""


OK, INVALID, MEMORY, NO_CONTEXT, LOST = map(Code, (0, 1, 2, 201, 719))
FOREVER = []  # all device memory: no address is used twice, so that no stream frees another's
GUARD = 64  # bytes after each piece of memory, which nothing may change
NAMES = {1: "INVALID_VALUE", 2: "OUT_OF_MEMORY", 201: "INVALID_CONTEXT", 719: "LAUNCH_FAILED"}


class Attributes:
    """CUdevice_attribute and CUfunction_attribute: their numbers are their names."""

    def __getattr__(self, name):
        return name.removeprefix("CU_DEVICE_ATTRIBUTE_").removeprefix("CU_FUNC_ATTRIBUTE_")


def current(method):
    """A function of the driver that works for the context that is current in this thread."""

    def checked(self, *arguments):
        return method(self, *arguments) if self.context() is not None else (NO_CONTEXT,)

    return checked


class Thing:
    """A stream or a function of a device; a stream has what was asked of it and is not done."""

    def __init__(self, context, of=None):
        self.context, self.of, self.asked = context, of, []


class FakeDriver(types.ModuleType):
    """devices : how many;  memory : bytes of each;  fail_at : the launch that fails
    shown : bytes that are said to be free, in place of those that are

    As on a device, each thread has a context of its own, memory and streams are of one context, and
    copies and launches are made when a stream is waited for.
    """

    CUdevice_attribute = CUfunction_attribute = Attributes()

    def __init__(self, devices=1, memory=2**30, fail_at=None, shown=None):
        super().__init__("driver")
        self.count, self.size, self.fail_at, self.shown = devices, memory, fail_at, shown
        self.held, self.taken, self.host = {}, 0, {}
        self.launches, self.most, self.used = [], 0, set()
        self.stacks = threading.local()

    def context(self):
        stack = getattr(self.stacks, "all", [])
        return stack[-1] if stack else None

    def cuInit(self, flags):
        return (OK,)

    def cuDriverGetVersion(self):
        return OK, 13000

    def cuDeviceGetCount(self):
        return OK, self.count

    def cuDeviceGet(self, number):
        return OK, number

    def cuDeviceGetName(self, length, device):
        return OK, (f"Fake {device}".encode() + b"\0").ljust(length)  # as cuda-bindings pads it

    def cuDeviceGetAttribute(self, name, device):
        known = {
            "COMPUTE_CAPABILITY_MAJOR": 9,
            "COMPUTE_CAPABILITY_MINOR": 0,
            "MULTIPROCESSOR_COUNT": 132,
            "CLOCK_RATE": 1_980_000,
        }
        return OK, known[name]

    def cuDeviceTotalMem(self, device):
        return OK, self.size

    def cuGetErrorName(self, error):
        return OK, b"CUDA_ERROR_" + NAMES[int(error)].encode()

    def cuGetErrorString(self, error):
        return OK, NAMES[int(error)].lower().replace("_", " ").encode()

    def cuDevicePrimaryCtxSetFlags(self, device, flags):
        return (OK,)

    def cuDevicePrimaryCtxRetain(self, device):
        return OK, device

    def cuCtxPushCurrent(self, context):
        self.stacks.all = [*getattr(self.stacks, "all", []), context]
        self.used.add(context)
        return (OK,)

    def cuCtxPopCurrent(self):
        return OK, self.stacks.all.pop()

    @current
    def cuStreamCreate(self, flags):
        return OK, Thing(self.context())

    @current
    def cuStreamDestroy(self, stream):
        return (OK,)

    @current
    def cuStreamSynchronize(self, stream):
        if stream.context != self.context():
            return (INVALID,)
        done, stream.asked = stream.asked, []
        for work in done:
            if (error := work()) is not None:
                return (error,)
        return (OK,)

    @current
    def cuMemGetInfo(self):
        return OK, self.shown or self.size - self.taken, self.size

    @current
    def cuMemAlloc(self, size):
        if self.taken + size > self.size:
            return MEMORY, None
        array = np.full(size + GUARD, 0xFF, np.uint8)  # device memory is not zero
        self.held[array.ctypes.data] = array, self.context()
        FOREVER.append(array)
        self.taken += size
        self.most = max(self.most, self.taken)
        return OK, array.ctypes.data

    @current
    def cuMemFree(self, address):
        if int(address) not in self.held:  # of a stream of an earlier stand-in
            return (INVALID,)
        array, context = self.held.pop(int(address))
        assert context == self.context()
        self.taken -= array.size - GUARD
        assert (array[-GUARD:] == 0xFF).all(), "a kernel wrote beyond memory"
        return (OK,)

    @current
    def cuMemAllocHost(self, size):
        array = np.zeros(size, np.uint8)
        self.host[array.ctypes.data] = array
        return OK, array.ctypes.data

    @current
    def cuMemFreeHost(self, address):
        del self.host[address]
        return (OK,)

    def _inside(self, address, size):
        """Whether these bytes are memory of the current context."""
        return any(
            a <= address and address + size <= a + x.size - GUARD and of == self.context()
            for a, (x, of) in list(self.held.items())  # other threads take memory
        )

    def _copied(self, device, to, source, size, stream):
        if not self._inside(device, size) or stream.context != self.context():
            return (INVALID,)
        stream.asked.append(lambda: ctypes.memmove(to, source, size) and None)
        return (OK,)

    @current
    def cuMemcpyHtoD(self, to, source, size):
        if not self._inside(to, size):
            return (INVALID,)
        ctypes.memmove(to, source, size)
        return (OK,)

    @current
    def cuMemcpyHtoDAsync(self, to, source, size, stream):
        return self._copied(to, to, source, size, stream)

    @current
    def cuMemcpyDtoHAsync(self, to, source, size, stream):
        return self._copied(source, to, source, size, stream)

    @current
    def cuModuleLoadData(self, text):
        return OK, Thing(self.context(), machine_code(text.rstrip(b"\0").decode()))

    @current
    def cuModuleUnload(self, module):
        return (OK,)

    @current
    def cuModuleGetFunction(self, module, name):
        kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
        function = kind(module.of.get_function_address(name.decode()))
        function.engine = module.of  # which owns the code
        return OK, Thing(module.context, function)

    @current
    def cuFuncGetAttribute(self, name, function):
        return OK, {"NUM_REGS": 176, "LOCAL_SIZE_BYTES": 2800}[name]  # as rk4 with gravity has

    @current
    def cuOccupancyMaxActiveBlocksPerMultiprocessor(self, function, threads, memory):
        return OK, 256 // threads  # as many registers as rk4 with gravity has

    @current
    def cuLaunchKernel(self, function, *rest):
        x, y, z, a, b, c, shared, stream, (values, _), extra = rest
        frame, first, count = values
        assert (y, z, b, c, shared, extra) == (1, 1, 1, 1, 0, 0) and (x - 1) * a < count <= x * a
        if {function.context, stream.context} != {self.context()} or not self._inside(frame, 1):
            return (INVALID,)

        def work():
            if len(self.launches) == self.fail_at:
                return LOST
            self.launches.append(count)
            for i in range(count):
                function.of(frame, first + i, 1)
            return None

        stream.asked.append(work)
        return (OK,)


@functools.cache
def optimised_text(text):
    """A kernel's code, optimised for this processor: many tests take the same scene."""
    return str(optimise(llvm.parse_assembly(text), host()))


@functools.cache
def machine_code(text):
    """The engine that has a kernel's code, made for this processor."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(text), host())
    engine.finalize_object()
    return engine


def host():
    """This processor, as LLVM compiles for it."""
    target = llvm.Target.from_default_triple()
    features = llvm.get_host_cpu_features().flatten()
    return target.create_target_machine(llvm.get_host_cpu_name(), features, opt=3, jit=True)


@pytest.fixture
def fake(monkeypatch):
    """Make a FakeDriver the driver: fake(devices=2).

    compiled : whether kernels are compiled for this processor, so that launches run them
    """

    def install(compiled=True, **settings):
        driver = FakeDriver(**settings)
        package = types.ModuleType("cuda")
        package.bindings = types.ModuleType("cuda.bindings")
        package.bindings.driver = driver
        monkeypatch.setitem(sys.modules, "cuda", package)
        monkeypatch.setitem(sys.modules, "cuda.bindings", package.bindings)
        monkeypatch.setitem(sys.modules, "cuda.bindings.driver", driver)
        if compiled:
            monkeypatch.setattr(linked, "link_kernel", lambda *given: link_kernel(*given[:3]))
            monkeypatch.setattr(cuda, "ptx_of", lambda module, _: optimised_text(str(module)))
            # which is no PTX and must not go to the disk cache
            monkeypatch.setattr(linked, "cached_text", lambda entry, make: make())
        cuda_device.devices.cache_clear()
        return driver

    yield install
    cuda_device.devices.cache_clear()

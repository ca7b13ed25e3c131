"""A stand-in for the driver of NVIDIA: device memory is this machine's, and a launch runs the
kernel's own code here, one member after the other.

Its functions have the names, arguments and answers of `cuda.bindings.driver`. Memory is only what
was taken and not yet given back: other addresses are refused.
"""

import ctypes
import sys
import types
from functools import partial

import llvmlite.binding as llvm
import numpy as np
import pytest

from rigidmc.engine import cuda, cuda_device
from rigidmc.engine.cuda_code import kernel_of, optimised


class Code(int):
    """A CUresult."""


OK, INVALID, MEMORY, LOST = Code(0), Code(1), Code(2), Code(719)
FOREVER = []  # all device memory: no address is used twice, so that no seat frees another's
GUARD = 64  # bytes after each piece of memory, which nothing may change
NAMES = {1: "INVALID_VALUE", 2: "OUT_OF_MEMORY", 719: "LAUNCH_FAILED"}


class Attributes:
    """CUdevice_attribute: its numbers are its names."""

    def __getattr__(self, name):
        return name.removeprefix("CU_DEVICE_ATTRIBUTE_")


class FakeDriver(types.ModuleType):
    """devices : how many;  memory : bytes of each;  fail_at : the launch that fails
    shown : bytes that are said to be free, in place of those that are
    """

    CUdevice_attribute = Attributes()

    def __init__(self, devices=1, memory=2**30, fail_at=None, shown=None):
        super().__init__("driver")
        self.count, self.size, self.fail_at = devices, memory, fail_at
        self.shown = shown
        self.held, self.taken, self.host = {}, 0, {}
        self.launches, self.most, self.used = [], 0, set()

    def cuInit(self, flags):
        return (OK,)

    def cuDriverGetVersion(self):
        return OK, 13000

    def cuDeviceGetCount(self):
        return OK, self.count

    def cuDeviceGet(self, number):
        return OK, number

    def cuDeviceGetName(self, length, device):
        return OK, f"Fake {device}".encode().ljust(length, b"\0")

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

    def cuDevicePrimaryCtxRetain(self, device):
        return OK, device

    def cuCtxSetCurrent(self, context):
        self.used.add(context)
        return (OK,)

    def cuCtxPushCurrent(self, context):
        return (OK,)

    def cuCtxPopCurrent(self):
        return OK, 0

    def cuStreamCreate(self, flags):
        return OK, object()

    def cuStreamSynchronize(self, stream):
        return (OK,)

    def cuMemGetInfo(self):
        return OK, self.shown or self.size - self.taken, self.size

    def cuMemAlloc(self, size):
        if self.taken + size > self.size:
            return MEMORY, None
        array = np.full(size + GUARD, 0xFF, np.uint8)  # device memory is not zero
        self.held[array.ctypes.data] = array
        FOREVER.append(array)
        self.taken += size
        self.most = max(self.most, self.taken)
        return OK, array.ctypes.data

    def cuMemFree(self, address):
        if int(address) not in self.held:  # of a seat of an earlier stand-in
            return (INVALID,)
        array = self.held.pop(int(address))
        self.taken -= array.size - GUARD
        assert (array[-GUARD:] == 0xFF).all(), "a kernel wrote beyond memory"
        return (OK,)

    def cuMemAllocHost(self, size):
        array = np.zeros(size, np.uint8)
        self.host[array.ctypes.data] = array
        return OK, array.ctypes.data

    def cuMemFreeHost(self, address):
        del self.host[address]
        return (OK,)

    def _inside(self, address, size):
        return any(
            a <= address and address + size <= a + x.size - GUARD for a, x in self.held.items()
        )

    def cuMemcpyHtoDAsync(self, to, source, size, stream):
        if not self._inside(to, size):
            return (INVALID,)
        ctypes.memmove(to, source, size)
        return (OK,)

    def cuMemcpyDtoHAsync(self, to, source, size, stream):
        if not self._inside(source, size):
            return (INVALID,)
        ctypes.memmove(to, source, size)
        return (OK,)

    def cuModuleLoadData(self, text):
        module = llvm.parse_assembly(text.rstrip(b"\0").decode())
        engine = llvm.create_mcjit_compiler(module, host())
        engine.finalize_object()
        return OK, engine

    def cuModuleUnload(self, engine):
        return (OK,)

    def cuStreamDestroy(self, stream):
        return (OK,)

    def cuModuleGetFunction(self, engine, name):
        kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
        function = kind(engine.get_function_address(name.decode()))
        function.engine = engine  # which owns the code
        return OK, function

    def cuOccupancyMaxActiveBlocksPerMultiprocessor(self, function, threads, memory):
        return OK, 384 // threads  # as many registers as rk4 with gravity has

    def cuLaunchKernel(self, function, *rest):
        x, y, z, a, b, c, shared, _stream, (values, _), extra = rest
        frame, first, count = values
        assert (y, z, b, c, shared, extra) == (1, 1, 1, 1, 0, 0) and (x - 1) * a < count <= x * a
        if len(self.launches) == self.fail_at:
            return (LOST,)
        self.launches.append(count)
        for i in range(count):
            function(frame, first + i, 1)
        return (OK,)


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
            monkeypatch.setattr(cuda, "kernel_of", partial(kernel_of, host=True))
            monkeypatch.setattr(cuda, "ptx_of", lambda module, _: str(optimised(module, host())))
            # which is no PTX and must not go to the disk cache
            monkeypatch.setattr(cuda, "kept_text", lambda types, more, make: make())
        cuda_device.devices.cache_clear()
        return driver

    yield install
    cuda_device.devices.cache_clear()

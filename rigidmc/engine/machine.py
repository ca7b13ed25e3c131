"""This machine: its widest vectors, cache lines, cores, and its description in results."""

import os
import platform
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
from numpy.typing import DTypeLike, NDArray

from rigidmc.version import VERSION

config: Any = numba.config
# Bytes of a cache line and of the widest vectors: across two lines they need two accesses.
LINE = 64
UNCOMPILED = {"compiled": "no (NUMBA_DISABLE_JIT)"}  # results of compiled code have no such entry


def use_widest_vectors() -> None:
    """Allow LLVM 512-bit vectors if the CPU has them: x1.3 to x1.5 where LLVM prefers 256 bit.

    Works only before the first compilation of the process; a user's NUMBA_CPU_FEATURES or
    NUMBA_CPU_NAME wins.
    """
    if config.CPU_FEATURES is None and config.CPU_NAME is None:
        features = llvm.get_host_cpu_features()
        if features.get("avx512f"):
            config.CPU_FEATURES = features.flatten() + ",-prefer-256-bit"


def vector_bits() -> int:
    """Return the width of the widest vector registers that kernels may use [bit].

    On ARM these are the 128 bits of NEON: LLVM makes no other code of vectors of a fixed length,
    whatever the length of the CPU's SVE registers.
    """
    text = config.CPU_FEATURES
    features = (llvm.get_host_cpu_features().flatten() if text is None else text).split(",")
    if "+avx512f" in features and "+prefer-256-bit" not in features:
        return 512
    return 256 if "+avx2" in features or "+avx512f" in features else 128


def vector_registers() -> int:
    """Return how many vector registers kernels may use: 32 of 512 bits or of ARM, else 16."""
    on_arm = platform.machine().lower() in ("aarch64", "arm64")
    return 32 if on_arm or vector_bits() == 512 else 16


def allocate_aligned(
    count: int, dtype: DTypeLike, make: Callable[..., NDArray[Any]] = np.zeros
) -> NDArray[Any]:
    """Return an array that begins on a cache line.

    Half of all arrays are 32 bytes off, and every 512-bit vector then needs two accesses.
    """
    array = make(count + LINE // 4, dtype)  # a line more, for numbers of 4 bytes, the smallest
    offset = (-array.ctypes.data % LINE) // array.itemsize
    return array[offset : offset + count]


def allocate_block(
    rows: int, members: int, make: Callable[..., NDArray[Any]] = np.empty
) -> NDArray[np.float64]:
    """Return the rows of a block, each on whole cache lines.

    Across two of them, loads take 3 % of a short run of rk8.
    """
    return allocate_aligned(rows * members, float, make).reshape(rows, members)


def threads_available() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def this_machine(*more: str) -> tuple[dict[str, str], str]:
    """Return (versions of packages that compute and write, the CPU that code is compiled for).

    The last bits of results may depend on the versions, but not on the CPU. The versions include
    UNCOMPILED if nothing is compiled.

    more : names of other packages that draw numbers of a scene
    """
    names = ("numpy", "numba", "llvmlite", "netCDF4", *more)
    processor = f"{platform.machine()} {llvm.get_host_cpu_name()}, {vector_bits()} bit"
    plain = UNCOMPILED if is_uncompiled() else {}
    # a source tree on the path is not listed among installed packages
    versions = {"rigidmc": VERSION, **{name: version(name) for name in names}}
    return {**versions, **plain}, processor


def is_uncompiled() -> bool:
    """Return whether NUMBA_DISABLE_JIT makes Python compute the steps.

    This is thousands of times slower, and without fused products, so last bits differ. No other
    setting of Numba changes a bit.
    """
    return bool(config.DISABLE_JIT)

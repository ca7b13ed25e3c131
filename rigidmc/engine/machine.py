"""This machine: its widest vectors, its cores, and what a result says of it."""

import os
import platform
from importlib.metadata import version
from typing import Any

import llvmlite.binding as llvm
import numba

from rigidmc.version import VERSION

config: Any = numba.config
UNCOMPILED = {"compiled": "no (NUMBA_DISABLE_JIT)"}  # compiled code has no such entry


def use_widest_vectors() -> None:
    """Let LLVM use 512-bit vectors if the CPU has them: x1.3 to x1.5 if LLVM tunes it for 256 bit.

    Works only before the first compilation of the process; a user's NUMBA_CPU_FEATURES or
    NUMBA_CPU_NAME wins.
    """
    if config.CPU_FEATURES is None and config.CPU_NAME is None:
        features = llvm.get_host_cpu_features()
        if features.get("avx512f"):
            config.CPU_FEATURES = features.flatten() + ",-prefer-256-bit"


def vector_bits() -> int:
    """Width of the widest vector registers that kernels of this process may use [bit]."""
    text = config.CPU_FEATURES
    features = (llvm.get_host_cpu_features().flatten() if text is None else text).split(",")
    if "+avx512f" in features and "+prefer-256-bit" not in features:
        return 512
    return 256 if "+avx2" in features or "+avx512f" in features else 128


def threads_available() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def this_machine(*more: str) -> tuple[dict[str, str], str]:
    """(versions of what computes and writes, the processor that code is compiled for).

    The last bits of results may depend on the versions, and on no processor. Among them is
    UNCOMPILED if nothing is compiled.
    more : names of other packages that draw numbers of a scene
    """
    names = ("numpy", "numba", "llvmlite", "netCDF4", *more)
    processor = f"{platform.machine()} {llvm.get_host_cpu_name()}, {vector_bits()} bit"
    plain = UNCOMPILED if is_uncompiled() else {}
    # a source tree on the path has no entry among installed packages
    versions = {"rigidmc": VERSION, **{name: version(name) for name in names}}
    return {**versions, **plain}, processor


def is_uncompiled() -> bool:
    """Whether NUMBA_DISABLE_JIT lets Python make the steps: thousands of times slower, and without
    fused products, so that last bits differ. No other setting of Numba changes a bit."""
    return bool(config.DISABLE_JIT)

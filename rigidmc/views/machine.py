"""Facts of this machine and installation that decide speed and bits."""

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version

from rigidmc.engine.cache_folder import cache_folder
from rigidmc.engine.cuda_device import Device, devices
from rigidmc.engine.machine import this_machine, threads_available, vector_bits
from rigidmc.engine.program import lanes_for
from rigidmc.errors import NoDevice

PACKAGES = (
    "rigidmc", "numpy", "numba", "llvmlite", "xarray",
    "netCDF4", "scipy", "pydantic", "matplotlib", "cuda-bindings",
)  # fmt: skip


def machine_facts() -> dict[str, str | int]:
    """{fact: value} of processor, kernel cache, Python and packages."""
    folder, bits = cache_folder(), vector_bits()
    kernels = [
        os.path.join(top, file)
        for top, _, files in os.walk(folder)
        for file in files
        if file.endswith(".nbc")
    ]
    size = sum(map(os.path.getsize, kernels)) / 1e6
    lanes = f"{lanes_for('float64')} members are worked on side by side"
    facts: dict[str, str | int] = {
        "cpu": _cpu(),
        "cores": f"{threads_available()} usable of {os.cpu_count()}",
        "code": f"generated for {this_machine()[1]}",
        "vectors": f"{bits} bit, {bits // 64} float64 lanes; {lanes}",
        "threads": threads_available(),
        "kernel cache": f"{folder} ({len(kernels)} kernels, {size:.1f} MB)",
        "python": sys.version.split()[0],
        "system": platform.platform(),
        **_devices(),
    }
    for package in PACKAGES:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "not installed"
    return facts


def _devices() -> dict[str, str]:
    """{device: what it is} of graphics processors, or why there are none."""
    try:
        found = devices()
    except NoDevice as error:
        return {"cuda": str(error).removeprefix("cuda: ")}
    return {f"cuda:{one.number}": _in_words(one) for one in found}


def _in_words(one: Device) -> str:
    """What a graphics processor is."""
    capability, driver = (".".join(map(str, pair)) for pair in (one.capability, one.driver))
    return (
        f"{one.name}, compute capability {capability}, {one.processors} multiprocessors at"
        f" {one.clock / 1e9:.2f} GHz, {one.memory / 2**30:.0f} GiB, {one.peak / 1e12:.3g} T"
        f" operations in float64 a second at most, driver for CUDA {driver}"
    )


def _cpu() -> str:
    """The name of the processor."""
    try:
        with open("/proc/cpuinfo") as file:
            lines = (line for line in file if line.startswith("model name"))
            return next(lines).split(":", 1)[1].strip()
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()

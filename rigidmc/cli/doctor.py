"""rigidmc doctor: the properties of this machine and installation that decide speed and bits."""

import json
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Annotated

import typer

from rigidmc.cli.app import FLAGGED
from rigidmc.cli.reporting import report_errors
from rigidmc.errors import NoDevice
from rigidmc.version import VERSION

if TYPE_CHECKING:
    from rigidmc.engine.cuda.devices import Device


def doctor_command(
    machine: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    cuda_check: Annotated[
        bool,
        typer.Option(
            "--cuda-check",
            help="Check that every integrator gives the same bits on the GPUs as on this CPU, then"
            " measure steps per second. Exit code 4 if any bit differs.",
        ),
    ] = False,
) -> None:
    if cuda_check:
        with report_errors():
            if _different():
                raise typer.Exit(FLAGGED)
        return

    facts = machine_facts()
    if machine:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        print(f"{key:16s} {value}")


def _different() -> int:
    """Print how GPUs compare with this CPU; return the number of cases with different bits."""
    from rigidmc.engine.cuda.devices import select_devices
    from rigidmc.studies.bits import compare_devices, speeds

    wrong = 0
    for device in select_devices(None):
        word, equal = f"cuda:{device.number}", list[bool]()
        print(f"{word}: {device.name}")
        for name, same in compare_devices(word):
            print(f"{'same bits     ' if same else 'DIFFERENT BITS'}  {name}", flush=True)
            equal.append(same)
        print(f"{sum(equal)} of {len(equal)} cases agree with this CPU to the bit")
        wrong += len(equal) - sum(equal)
        for name, steps, operations in speeds(word):
            share = 100 * operations / device.peak
            print(f"{steps / 1e9:8.2f} G steps/s, {share:.0f} % of the float64 peak  {name}")
    return wrong


PACKAGES = (
    "numpy", "numba", "llvmlite", "xarray",
    "netCDF4", "scipy", "pydantic", "matplotlib", "cuda-bindings",
)  # fmt: skip


def machine_facts() -> dict[str, str | int]:
    """Return {fact: value} of CPU, GPUs, kernel cache, Python and packages."""
    # these import Numba, which must not read settings here: only after `keep_apart`
    from rigidmc.engine.compiler.disk_cache import cache_folder
    from rigidmc.engine.machine import this_machine, threads_available, vector_bits
    from rigidmc.engine.program import lanes_for

    folder, bits = cache_folder(), vector_bits()
    kernels = [
        os.path.join(top, file)
        for top, _, files in os.walk(folder)
        for file in files
        if file.endswith((".bc", ".o"))
    ]
    size = sum(map(os.path.getsize, kernels)) / 1e6
    lanes = f"{lanes_for('float64')} members move side by side"
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
        "rigidmc": VERSION,  # `version` fails for a source tree that is not installed
    }
    for package in PACKAGES:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "not installed"
    return facts


def _devices() -> dict[str, str]:
    """Return {device: description} of the GPUs, or the reason why there is none."""
    from rigidmc.engine.cuda.devices import devices

    try:
        present = devices()
    except NoDevice as error:
        return {"cuda": str(error).removeprefix("cuda: ")}
    return {f"cuda:{device.number}": _in_words(device) for device in present}


def _in_words(device: "Device") -> str:
    """Describe a GPU."""
    capability, driver = (".".join(map(str, pair)) for pair in (device.capability, device.driver))
    return (
        f"{device.name}, compute capability {capability}, {device.processors} multiprocessors at"
        f" {device.clock / 1e9:.2f} GHz, {device.memory / 2**30:.0f} GiB,"
        f" peak of {device.peak / 1e12:.3g} T"
        f" float64 operations per second, driver for CUDA {driver}"
    )


def _cpu() -> str:
    """Return the name of the CPU."""
    try:
        with open("/proc/cpuinfo") as file:
            lines = (line for line in file if line.startswith("model name"))
            return next(lines).split(":", 1)[1].strip()
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()

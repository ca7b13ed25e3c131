"""The baselines in C and CUDA C: built at run time with gcc and nvcc, called through ctypes."""

import ctypes
import os
import platform
import shutil
import subprocess
import tempfile

FLAGS = (
    "-O3",
    "-march=native",
    "-ffast-math",
    "-fopenmp",
    "-shared",
    "-fPIC",
    *(("-mprefer-vector-width=512",) if platform.machine() in ("x86_64", "AMD64") else ()),
)
_HERE = os.path.dirname(os.path.abspath(__file__))


def compiler_version():
    """The version of gcc, or None without gcc."""
    gcc = shutil.which("gcc")
    return (
        subprocess.run([gcc, "-dumpfullversion"], capture_output=True, text=True).stdout.strip()
        if gcc
        else None
    )


def build(source, *options):
    """Compile bench/baselines/SOURCE in a temporary folder and load it; OSError if that fails."""
    if shutil.which("gcc") is None:
        raise OSError("no gcc on this machine: the C baselines are left out")
    with tempfile.TemporaryDirectory() as folder:
        target = os.path.join(folder, "baseline.so")
        command = ["gcc", *FLAGS, *options, os.path.join(_HERE, source), "-o", target, "-lm"]
        made = subprocess.run(command, capture_output=True, text=True)
        if made.returncode != 0:
            raise OSError(f"{' '.join(command)}: {made.stderr.strip()}")
        library = ctypes.CDLL(target)  # stays mapped after the file is deleted
    for name in ("rk4_free", "rk4_heavy", "rk4_free_512", "rk4_heavy_512"):
        if hasattr(library, name):
            function = getattr(library, name)
            function.argtypes, function.restype = (
                [ctypes.c_void_p, ctypes.c_long, ctypes.c_long, ctypes.c_double],
                None,
            )
    if hasattr(library, "rk4_free_saves"):
        function, number = library.rk4_free_saves, ctypes.c_long
        function.argtypes, function.restype = (
            [ctypes.c_void_p, number, number, ctypes.c_double, number, ctypes.c_void_p],
            None,
        )
    if hasattr(library, "fma_peak"):
        library.fma_peak.argtypes, library.fma_peak.restype = (
            [ctypes.c_long, ctypes.c_int],
            ctypes.c_double,
        )
    return library


def build_cuda():
    """Compile bench/baselines/tops.cu for the GPU of this machine and load it; OSError if that
    fails."""
    if shutil.which("nvcc") is None:
        raise OSError("no nvcc on this machine: the baseline in CUDA C is left out")
    with tempfile.TemporaryDirectory() as folder:
        target = os.path.join(folder, "baseline.so")
        source = os.path.join(_HERE, "tops.cu")
        options = "-O3", "-std=c++17", "-arch=native", "-shared", "-Xcompiler", "-fPIC"
        made = subprocess.run(
            ["nvcc", *options, source, "-o", target], capture_output=True, text=True
        )
        if made.returncode != 0:
            raise OSError(f"nvcc: {made.stderr.strip()}")
        library = ctypes.CDLL(target)
    number = ctypes.c_long
    library.rk4_cuda.argtypes = [ctypes.c_void_p, number, number, ctypes.c_double, ctypes.c_int]
    library.rk4_cuda.restype = ctypes.c_double
    return library

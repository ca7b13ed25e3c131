"""Helper processes: the one way in which this package starts another Python.

A helper imports nothing from the working directory, which may hold a downloaded result beside a
file netCDF4.py. It is isolated (`python -I`), its folders of modules are those of this process
without the working directory, and it works in the folder of the package, because libraries look for
settings where they are (Numba for .numba_config.yaml, matplotlib for matplotlibrc).
"""

import os
import subprocess
import sys
from typing import Any

PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_PLACES = ("RIGIDMC_CACHE_DIR", "MPLCONFIGDIR", "MATPLOTLIBRC", "NUMBA_CACHE_DIR", "TMPDIR")


def can_start() -> bool:
    """Whether there is a Python to start: programs that embed or freeze one may have none."""
    name = os.path.basename(sys.executable or "").lower()
    return "python" in name and not hasattr(sys, "frozen")


def start(module: str, answers: bool = True) -> "subprocess.Popen[str]":
    """A process that runs `main` of a module of this package; it is written to through its stdin.

    answers : whether its stdout is read
    """
    words = [sys.executable, "-I", "-B"] if sys.dont_write_bytecode else [sys.executable, "-I"]
    more: dict[str, Any] = {}
    if sys.platform == "win32":
        more["creationflags"] = subprocess.CREATE_NO_WINDOW
    return subprocess.Popen(
        [*words, os.path.join(PACKAGE, "files", "helper_main.py"), module, *folders()],
        cwd=PACKAGE,
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE if answers else subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        **more,
    )


def folders() -> list[str]:
    """The folders that this process imports from, without the working directory.

    The folder that holds the package comes last if it is the working directory: what is installed
    there is found, and shadows nothing.
    """
    here, home = _place(os.curdir), os.path.dirname(PACKAGE)
    known = [path for path in sys.path if os.path.isabs(path) and _place(path) != here]
    return known if home in known else [*known, home]


def environment() -> dict[str, str]:
    """The environment of a helper: this one, without the variables that steer Python, and with
    places that do not depend on where the helper works. netCDF reads no .ncrc there."""
    known = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    places = {name: os.path.abspath(known[name]) for name in _PLACES if known.get(name)}
    return {**known, **places, "NCRCENV_IGNORE": "1"}


def _place(path: str) -> str:
    try:
        return os.path.realpath(path)
    except OSError:  # the working directory was deleted
        return path

"""What is compiled is said before it begins, with how long it takes; nothing is said where all is in memory or in the disk cache."""

import contextlib
import logging
import math
import os
import time

from rigidmc.engine.machine import cache_folder
from rigidmc.progress import say

log = logging.getLogger("rigidmc")
compiled: list[str] = []  # labels of what this process has compiled

# CPU seconds in a process that compiles nothing else; 2 cores of AMD EPYC (family 25, model 17). In brackets the extremes of what was measured.
PIECES = {
    "enter": 0.4, "leave": 0.1, "begin": 1.2, "look": 0.85, "record": 0.4, "advance": 2.5,  # begin of splittings 2.5
    "begin_watch": 0.9, "watch": 0.75, "seek": 0.5, "begin_near": 1.0, "meet": 0.5,  # flips 1.4 and 1.0, nutation 0.7 and 0.5
    "formulas": 1.5,  # of closed forms 0.7 to 3.1
}  # fmt: skip
MARCH = {"rk8": 2.6}  # of a free body; of the others 1.0 (strang) to 1.7 (rk4)
OTHERS = 1.6
TORQUE = 1.4  # with gravity 2.1 (strang), 3.2 (rk4), 4.1 (rk8)
EFFECT = 0.45  # each more: 11.8 of all 17 that are not random by rk4, 4.7 of gravity alone, `begin` included
NOISE = 1.8  # a bath by strang 3.9
LATER = 0.45  # of what a process compiles later, functions that pieces share being there: 0.24 to 0.58


@contextlib.contextmanager
def announced(label, missing, effects=()):
    """Say what is compiled within this, and learn from it how fast this machine is.

    label : of the program;  missing : names of its pieces that are to be compiled;  effects : of the program
    """
    if not missing:
        yield
        return
    cold, known, began = not compiled, seconds(label, missing, effects), time.process_time()
    say(f"compiling {summary(label, missing)}, first use: about {rounded(known)} s")
    yield
    compiled.append(label)
    if cold and known > 1.0:  # by CPU time, which other processes do not lengthen
        _learn(_pace() * (time.process_time() - began) / known)


def seconds(label, missing, effects=()):
    """About how long it takes to compile some pieces of a program on this machine."""
    total = sum(PIECES.get(name, 0.0) for name in missing)
    if "march" in missing:
        total += MARCH.get(label.split(" ")[0], OTHERS) + TORQUE * bool(effects) + EFFECT * max(0, len(effects) - 1)
        total += NOISE * any("noise" in effect._fields for effect in effects)
    return _pace() * total * (LATER if compiled else 1.0)


def rounded(number):
    """Seconds for people."""
    return f"{number:.0f}" if number >= 0.95 else f"{max(0.1, number):.1f}"


def listed(label, missing):
    """What is compiled, every piece by its name."""
    return ", ".join([f"march of {label}"] * ("march" in missing) + [name for name in missing if name != "march"])


def summary(label, missing):
    """What is compiled, in the words of a scene."""
    if label in missing:
        return label
    words = {"seek": "events", "watch": "running observables", "meet": "neighbour", "record": "saves"}
    if "seek" in missing:  # which `watch` then sees
        del words["watch"]
    found = [word for name, word in words.items() if name in missing]
    if "march" in missing:
        return " + ".join([label, *(word for word in found if word != "saves")])
    return f"{', '.join(found or missing)} of {label}"


def _pace():
    """How much longer than the seconds above this machine took when a process last began to compile, 1 if that is not known."""
    with contextlib.suppress(OSError, ValueError), open(_file(), encoding="ascii") as file:
        found = float(file.read(32))
        return min(5.0, max(0.2, found)) if math.isfinite(found) else 1.0
    return 1.0


def _learn(pace):
    """Keep the pace for other processes, where there is a cache."""
    with contextlib.suppress(OSError):
        with open(f"{_file()}.{os.getpid()}", "w", encoding="ascii") as file:
            file.write(f"{pace:.3f}\n")
        os.replace(file.name, _file())


def _file():
    return os.path.join(cache_folder(), "pace")

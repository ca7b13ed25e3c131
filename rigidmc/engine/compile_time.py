"""An announcement before compilation, with the time it will take.

The estimate is CPU seconds measured once, times the pace of this machine. Each process measures the
pace afresh with its first program. Nothing is announced if all code is in memory or in the disk
cache.
"""

import contextlib
import logging
import math
import os
import time
from collections.abc import Collection, Iterator, Sequence
from typing import Any

from rigidmc.engine.compiler.disk_cache import cache_home, write_whole
from rigidmc.files.opening import open_plain
from rigidmc.processes.progress import say

log = logging.getLogger("rigidmc")
compiled: list[str] = []  # labels of the programs this process has compiled

# CPU seconds in a process that has compiled the shared functions, on 2 cores of Intel Xeon (family
# 6, model 167).
KERNELS = {
    "gather": 0.08, "scatter": 0.04, "initialise": 0.2, "assess": 0.2, "record": 0.12,
    "advance": 0.8, "begin_monitors": 0.14, "monitor_steps": 0.95, "refine_event": 0.12,
    "begin_growth": 0.1, "record_growth": 0.12,
    "formulas": 0.8,  # 0.4 to 1.5
    "kernel": 2.5,  # of a GPU, all kernels for one member in one: 2.2 (rk4) to 5.4 (rk8)
}  # fmt: skip
MARCH = {"rk8": 1.2, "gbs12": 1.9}  # of a free body
OTHERS = 0.5  # 0.46 (rk4, midpoint), 0.4 (exact); splittings 0.3, and 0.3 more to initialise
TORQUE = 0.05  # with gravity 0.51 (rk4), 1.27 (rk8)
# Each further effect; for rk8 multiplied by the ratio of free steps. All 17 that are not random:
# 3.9 by rk4 (this table: 4.2), 8.8 by rk8 (this table: 8.2).
EFFECT = 0.2
FIRST = 0.3  # once a process
START = 0.5  # until a second process compiles its first kernel
APART = 1.1  # a second process takes longer by this factor: it lacks the shared functions
GAIN = 0.5  # smallest saving of waiting time that justifies a second process
# Factor once a process has compiled a program, because the functions that kernels share are there:
# 0.3 to 0.8.
LATER = 0.6


@contextlib.contextmanager
def announce_compiling(
    label: str, missing: Sequence[str], effects: Sequence[Any] = (), theirs: Collection[str] = ()
) -> Iterator[None]:
    """Announce what the body compiles, and measure from it how fast this machine is.

    label : of the program
    missing : names of its kernels to compile
    effects : of the program
    theirs : see `split_work`
    """
    if not missing:
        yield
        return
    is_first, started = _cold(), time.process_time()
    wait = seconds_text(seconds(label, missing, effects, theirs))
    say(f"compiling {summary(label, missing)}, first use: about {wait} s")
    expected = seconds(label, [name for name in missing if name not in theirs], effects)
    yield
    compiled.append(label)
    # CPU time, which other processes do not lengthen.
    if is_first and "march" in missing:
        _learn(_pace() * (time.process_time() - started) / expected)


def seconds(
    label: str, missing: Sequence[str], effects: Sequence[Any] = (), theirs: Collection[str] = ()
) -> float:
    """Estimate how long it takes to compile kernels of a program on this machine.

    theirs : the kernels that a second process compiles meanwhile
    """
    costs = {name: _cost(name, label, effects) for name in missing}
    own_time = sum(cost for name, cost in costs.items() if name not in theirs)
    own_time = FIRST + own_time if _cold() else LATER * own_time
    helper_time = START + APART * sum(costs[name] for name in theirs) if theirs else 0.0
    return _pace() * max(own_time, helper_time)


def split_work(
    label: str, missing: Sequence[str], effects: Sequence[Any], able: Collection[str]
) -> list[str]:
    """Return names of the kernels that a second process should compile.

    `march` stays here. The others, most costly first, go to the less loaded process. None goes to
    the second process unless this shortens the wait by GAIN.

    able : names of the kernels that another process could compile
    """
    costs = {name: _cost(name, label, effects) for name in missing}
    own_time, factor = (FIRST, 1.0) if _cold() else (0.0, LATER)
    helper_time, theirs = START, list[str]()
    for name in sorted(costs, key=lambda name: (name != "march", -costs[name])):
        if name in able and helper_time + APART * costs[name] < own_time + factor * costs[name]:
            theirs.append(name)
            helper_time += APART * costs[name]
        else:
            own_time += factor * costs[name]
    gain = seconds(label, missing, effects) - seconds(label, missing, effects, theirs)
    return theirs if gain >= GAIN else []


def _cost(name: str, label: str, effects: Sequence[Any]) -> float:
    """Return the CPU seconds of a kernel on the machine above, as the first to be compiled."""
    if name != "march":
        return KERNELS.get(name, 0.0)
    free = MARCH.get(label.split(" ")[0], OTHERS)
    return free + TORQUE * bool(effects) + EFFECT * max(0, len(effects) - 1) * free / OTHERS


def _cold() -> bool:
    """Return whether this process has compiled no program yet; formulas share nothing with them."""
    return not set(compiled) - {"formulas"}


def seconds_text(number: float) -> str:
    """Return seconds as text for people."""
    return f"{number:.0f}" if number >= 0.95 else f"{max(0.1, number):.1f}"


def list_kernels(label: str, missing: Sequence[str]) -> str:
    """Return the names of all kernels to compile."""
    march = [f"march of {label}"] * ("march" in missing)
    return ", ".join(march + [name for name in missing if name != "march"])


def summary(label: str, missing: Sequence[str]) -> str:
    """Name what is compiled, as the scene names it."""
    if label in missing:
        return label
    words = {
        "refine_event": "events",
        "monitor_steps": "running observables",
        "record_growth": "growth of a tangent",
        "record": "saves",
    }
    if "refine_event" in missing:  # then the steps are monitored for the events
        del words["monitor_steps"]
    parts = [word for name, word in words.items() if name in missing]
    if "march" in missing:
        return " + ".join([label, *(word for word in parts if word != "saves")])
    return f"{', '.join(parts or missing)} of {label}"


def _pace() -> float:
    """Return the time this machine last took to compile, relative to the seconds above.

    1 if that is not known.
    """
    with (
        contextlib.suppress(OSError, ValueError),
        open(_file(), encoding="ascii", opener=open_plain) as file,
    ):
        # Bounded because the file may be damaged, or come from another machine.
        pace = float(file.read(32))
        return min(5.0, max(0.2, pace)) if math.isfinite(pace) else 1.0
    return 1.0


def _learn(pace: float) -> None:
    """Save the pace for other processes, if there is a cache."""
    with contextlib.suppress(OSError, ValueError):
        write_whole(_file(), f"{pace:.3f}\n".encode())


def _file() -> str:
    """Return the file of the pace; raise OSError if the cache folder is not private."""
    return os.path.join(cache_home(), "pace")

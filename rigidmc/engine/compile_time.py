"""What is compiled is said before it begins, with how long it takes; nothing is said where all is in memory or in the disk cache."""

import contextlib
import logging
import math
import os
import time

from rigidmc.engine.cache import cache_folder
from rigidmc.progress import say

log = logging.getLogger("rigidmc")
compiled: list[str] = []  # labels of what this process has compiled

# CPU seconds in a process that compiles nothing else; 2 cores of Intel Xeon (family 6, model 167): within 15 % of what programs of rk4, rk8 and strang took.
PIECES = {
    "enter": 0.1, "leave": 0.1, "begin": 0.4, "look": 0.4, "record": 0.2, "advance": 1.3,
    "begin_watch": 0.4, "watch": 0.6, "seek": 0.4, "begin_near": 0.4, "meet": 0.4, "formulas": 1.0,  # 0.5 to 1.9
}  # fmt: skip
MARCH = {"rk8": 2.6}  # of a free body
OTHERS = 1.2  # 1.0 (cf4) to 1.2 (rk4); of splittings 2.0 with what their `begin` takes longer
TORQUE = 0.9  # with gravity 1.8 (cf4), 2.1 (rk4), 3.7 (rk8)
EFFECT = 0.45  # each more, by rk8 as many times as much as a free step: all 17 that are not random 11.5 by rk4 (table 12.1), 23.7 by rk8 (table 21.9)
FIRST = 0.3  # once a process
START = 0.4  # until a second process has begun: 0.3 to 0.4
APART = 1.3  # what it compiles takes longer, without the functions that pieces share
GAIN = 0.5  # a wait that is shorter by less needs no second process
LATER = 0.45  # of what a process compiles after its first program, functions that pieces share being there: 0.3 to 0.6


@contextlib.contextmanager
def announced(label, missing, effects=(), theirs=()):
    """Say what is compiled within this, and learn from it how fast this machine is.

    label : of the program;  missing : names of its pieces that are to be compiled;  effects : of the program;  theirs : see `divided`
    """
    if not missing:
        yield
        return
    cold, began = _cold(), time.process_time()
    say(
        f"compiling {summary(label, missing)}, first use: about {rounded(seconds(label, missing, effects, theirs))} s"
    )
    known = seconds(label, [name for name in missing if name not in theirs], effects)
    yield
    compiled.append(label)
    if cold and "march" in missing:  # by CPU time, which other processes do not lengthen
        _learn(_pace() * (time.process_time() - began) / known)


def seconds(label, missing, effects=(), theirs=()):
    """About how long it takes to compile some pieces of a program on this machine; theirs : those that a second process compiles meanwhile."""
    costs = {name: _cost(name, label, effects) for name in missing}
    own = sum(cost for name, cost in costs.items() if name not in theirs)
    own = FIRST + own if _cold() else LATER * own
    return _pace() * max(
        own, START + APART * sum(costs[name] for name in theirs) if theirs else 0.0
    )


def divided(label, missing, effects, fit):
    """Names of the pieces that a second process is to compile: `march` stays here, and the others, the most costly first, go where less is to do.

    None where the wait would not be shorter by half a second, or more. fit : names of those that another process could compile
    """
    costs = {name: _cost(name, label, effects) for name in missing}
    own, share = (FIRST, 1.0) if _cold() else (0.0, LATER)
    other, theirs = START, list[str]()
    for name in sorted(costs, key=lambda name: (name != "march", -costs[name])):
        if name in fit and other + APART * costs[name] < own + share * costs[name]:
            theirs.append(name)
            other += APART * costs[name]
        else:
            own += share * costs[name]
    return (
        theirs
        if seconds(label, missing, effects) - seconds(label, missing, effects, theirs) >= GAIN
        else []
    )


def _cost(name, label, effects):
    """CPU seconds that a piece of a program takes, where nothing else of it is compiled yet and a machine is as fast as the one above."""
    if name != "march":
        return PIECES.get(name, 0.0)
    free = MARCH.get(label.split(" ")[0], OTHERS)
    return free + TORQUE * bool(effects) + EFFECT * max(0, len(effects) - 1) * free / OTHERS


def _cold():
    """Whether this process has compiled no program yet, formulas aside, which share nothing with programs."""
    return not set(compiled) - {"formulas"}


def rounded(number):
    """Seconds for people."""
    return f"{number:.0f}" if number >= 0.95 else f"{max(0.1, number):.1f}"


def listed(label, missing):
    """What is compiled, every piece by its name."""
    return ", ".join(
        [f"march of {label}"] * ("march" in missing) + [name for name in missing if name != "march"]
    )


def summary(label, missing):
    """What is compiled, in the words of a scene."""
    if label in missing:
        return label
    words = {
        "seek": "events",
        "watch": "running observables",
        "meet": "neighbour",
        "record": "saves",
    }
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

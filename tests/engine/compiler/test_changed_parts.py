"""Custom parts that a user changes while Python runs, as every notebook does: compiled code gives
what Python gives now, after a change and after its reversal, in one process and the next.

`WAYS` changes what the file `MINE` reads in one way each. All methods of all kinds of parts compute
with `law`, so one formula, compiled, compares all kinds with plain Python.
"""

import importlib
import json
import os
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from rigidmc.engine.compiler.frozen import frozen, frozen_class
from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.formulas import evaluate
from rigidmc.errors import PartError
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects.protocol import torque
from rigidmc.physics.integrators.protocol import step
from rigidmc.physics.observables.compiled import begin, level, update, value
from tests.tools.commands import python

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")

MINE = """
import functools
from typing import NamedTuple

import numba
import numpy as np

import beside_changed as beside
from beside_changed import imported

NUMBER, PAIR, SHARE, TABLE = 1.0, (1.0, (2.0, 1.0)), np.float64(1.0), np.array([1.0, 2.0])


class Numbers(NamedTuple):
    one: float
    two: float = 1.0


KNOWN = Numbers(1.0)
inner = lambda x: 1.0 * x
outer = lambda x: inner(x)
quick_number = 1.0


def deep(x):
    return 1.0 * x


def helper(x):
    return 1.0 * deep(x)


def made():
    held = 1.0

    def closed(x):
        return held * x

    def hold(value):
        nonlocal held
        held = value

    return closed, hold


closed, hold = made()


def defaults(x, by=1.0):
    return by * x


@numba.njit
def quick(x):
    return quick_number * quick_helper(x)


@numba.njit
def quick_helper(x):
    return 1.0 * x


@numba.njit(cache=True)
def cached(x):
    return cached_number * x


cached_number = 1.0


def doubled(function):
    @functools.wraps(function)
    def wrapper(x):
        return 2.0 * function(x)

    return wrapper


@doubled
def decorated(x):
    return 0.5 * x


def law(x):
    x = NUMBER * PAIR[1][1] * SHARE * KNOWN.one * Numbers(x, 1.0).two * TABLE[0] * x
    x = outer(helper(closed(defaults(x))))
    x = quick(cached(decorated(x)))
    return beside.law(beside.NUMBER * imported(x))


class Base(NamedTuple):
    size: float

    def torque(self, q):
        return law(self.size) * q[0], law(q[1]), 0.0 * q[2]

    def energy_scale(self):
        return law(self.size)


class Push(Base):
    pass


class Step(NamedTuple):
    size: float

    def step(self, h, q, l):
        return (q[0], q[1], q[2], law(q[3])), (l[0], l[1], law(self.size) * l[2])


class Seen(NamedTuple):
    size: float

    def value(self, q):
        return (law(self.size) * q[0],)


class Happens(NamedTuple):
    size: float

    def level(self, q):
        return law(self.size) * q[0]


class Total(NamedTuple):
    size: float

    def begin(self, q):
        return (law(q[0]),)

    def update(self, state, q):
        return (state[0] + law(self.size) * q[0],)
"""
BESIDE = """
NUMBER = 1.0


def law(x):
    return helper(x)


def helper(x):
    return 1.0 * x


def imported(x):
    return helper(x)
"""
KINDS = "Push", "Step", "Seen", "Happens", "Total"
NEW = 3.0  # in place of 1: no product of the others gives it by accident


def put(name, there=1.0):
    """A change of a global from `there` to the same with NEW in place of 1, and back."""

    def change(module, back):
        factor = 1.0 if back else NEW
        setattr(module, name, there(factor) if callable(there) else there * factor)

    return change


def put_in(name, what, new):
    """A change of an attribute of something in the file."""

    def change(module, back):
        thing, kept = module, vars(module).setdefault("__kept__", {})
        for word in name.split("."):
            thing = getattr(thing, word)
        kept.setdefault((name, what), getattr(thing, what))
        setattr(thing, what, kept[name, what] if back else new(module))

    return change


def reload(module, back):
    beside = sys.modules["beside_changed"]
    text = BESIDE if back else BESIDE.replace("return 1.0 * x", f"return {NEW} * x")
    with open(beside.__file__, "w") as file:
        file.write(text)
    importlib.invalidate_caches()
    os.utime(beside.__file__, (0, 1 if back else 10**6))  # the time of the bytecode's source
    sys.path.insert(0, os.path.dirname(beside.__file__))
    importlib.reload(beside)
    sys.path.pop(0)


def again(source):
    """A change of a definition by running its cell again, with NEW in place of 1.0."""

    def change(module, back):
        start = MINE.index(source)
        text = MINE[start : MINE.index("\n\n\n", start)]
        text = text if back else text.replace("1.0", str(NEW))
        exec(compile(text, module.__file__, "exec"), vars(module))

    return change


WAYS = {
    "a global number": put("NUMBER"),
    "a nested tuple": put("PAIR", lambda x: (1.0, (2.0, x))),
    "a number of NumPy": put("SHARE", lambda x: np.float64(x)),
    "a new array": put("TABLE", lambda x: np.array([x, 2.0])),
    "an array in place": lambda module, back: module.TABLE.__setitem__(0, 1.0 if back else NEW),
    "a NamedTuple as a global": lambda module, back: setattr(
        module, "KNOWN", module.Numbers(1.0 if back else NEW)
    ),
    "a lambda": again("inner ="),
    "a helper by the same name": again("def helper"),
    "a helper of a helper": again("def deep"),
    "a closure": lambda module, back: module.hold(1.0 if back else NEW),
    "a default": put_in("defaults", "__defaults__", lambda module: (NEW,)),
    "the code of a helper": put_in(
        "helper", "__code__", lambda module: (lambda x: 3.0 * x).__code__
    ),
    "a global of njit": put("quick_number"),
    "a helper of njit": again("@numba.njit\ndef quick_helper"),
    "a global of njit with a cache": put("cached_number"),
    "a decorated function": put("decorated", lambda x: lambda y: x * y),
    "a function of a module": put_in("beside", "law", lambda module: lambda x: NEW * x),
    "a number of a module": put_in("beside", "NUMBER", lambda module: NEW),
    "a helper of an imported function": put_in(
        "beside", "helper", lambda module: lambda x: NEW * x
    ),
    "a module that is reloaded": reload,
    "the method of a base class": put_in(
        "Base", "torque", lambda module: lambda self, q: (NEW * self.size * q[0], q[1], 0.0 * q[2])
    ),
    "a method of each class": lambda module, back: [
        change(module, back)
        for change in (
            put_in("Push", "torque", lambda _: lambda self, l: (NEW * self.size * l[0], 0.0, l[1])),
            put_in("Seen", "value", lambda _: lambda self, l: (NEW * self.size * l[0],)),
            put_in("Happens", "level", lambda _: lambda self, l: NEW * self.size * l[0]),
        )
    ],
    "the code of a method": put_in(
        "Seen.value", "__code__", lambda _: (lambda self, l: (3.0 * self.size * l[0],)).__code__
    ),
}  # fmt: skip
BODY = MassProperties.of((0.61, 0.83, 1.07), (0.053, -0.022, 0.31))
STATE = np.array([0.5, 0.5, 0.1, 0.7, 1.0, 2.0, 3.0])


class All(NamedTuple):
    """A formula with a method of each kind of part."""

    parts: Any
    q: Any
    l: Any

    def values(self):
        push, one, seen, happens, total = self.parts
        q, l, h = self.q, self.l, 0.0 * self.l[0]
        none = (h, h, h, h)
        end, moved = step(one, BODY, (), h, h, (h, h, h), q, l, ())
        state = begin(total, BODY, (), h, q, l)
        return (
            torque(push, BODY, h, q, l)
            + end
            + moved
            + value(seen, BODY, (), h, q, l, none, ())
            + (level(happens, BODY, (), h, q, l),)
            + update(total, state, BODY, (), h, q, l)
        )


def load(folder):
    """The file in a folder, with the one beside it, as fresh modules."""
    for name, text in (("beside_changed", BESIDE), ("mine_changed", MINE)):
        (folder / f"{name}.py").write_text(text)
        sys.modules.pop(name, None)
    sys.path.insert(0, str(folder))
    try:
        return importlib.import_module("mine_changed")
    finally:
        sys.path.remove(str(folder))


def parts_of(module):
    return tuple(getattr(module, kind)(0.5) for kind in KINDS)


def state_of():
    return tuple(STATE[:4].tolist()), tuple(STATE[4:].tolist())


def without_numba(names):
    """Replace functions of njit, which keep what they have read, by their plain ones."""
    for name, thing in list(names.items()):
        names[name] = getattr(thing, "py_func", thing)


def plain(module):
    before = dict(vars(module))
    without_numba(vars(module))
    try:
        return np.array(All(parts_of(module), *state_of()).values())
    finally:
        vars(module).update(before)


def compiled(module, side=8):
    parts = parts_of(module)
    rows = np.repeat(np.concatenate([[0.5] * len(parts), STATE])[:, None], 2, axis=1)
    formula = All(tuple(type(part)(0.0) for part in parts), (0.0,) * 4, (0.0,) * 3)
    return evaluate(formula, len(plain(module)), rows, threads=1, side=side)[:, 0]


def follow(module, way, seen, order=(False, True, False)):
    """Whether `seen(module)` gives what Python gives, for a change and its reversal."""
    found = []
    for changed in order:
        WAYS[way](module, not changed)
        found.append((seen(module), plain(module)))
    WAYS[way](module, True)
    assert not np.array_equal(found[0][1], found[1][1]), way  # the change is one
    return max(float(np.abs(one - other).max()) for one, other in found)


@pytest.mark.parametrize("way", WAYS)
def test_a_copy_computes_what_the_class_computes_now(way, tmp_path):
    """Without a compiler: copies call nothing that may change later."""
    module, copies, kept = load(tmp_path), [], []

    def of_copy(module):
        copies.append(frozen(parts_of(module)))
        for part in copies[-1]:
            for function in frozen_class(type(part)).functions:
                without_numba(function.__globals__)
        kept.append(All(copies[-1], *state_of()).values())
        return np.array(kept[-1])

    assert follow(module, way, of_copy) == 0.0
    # later changes leave a copy as it is, and their reversal gives it again
    assert [All(parts, *state_of()).values() for parts in copies] == kept
    first, middle, last = ([type(part) for part in parts] for parts in copies)
    assert first == last != middle


QUICK = ("a helper of njit",)


@pytest.mark.parametrize("ways", [QUICK, pytest.param((*WAYS,), marks=pytest.mark.slow)])
def test_compiled_code_computes_what_the_class_computes_now(ways, tmp_path):
    module = load(tmp_path)
    for way in ways:
        assert follow(module, way, compiled) < 1e-15, way  # measured 0


NEXT = """
from typing import NamedTuple
import rigidmc as rm
from rigidmc.engine.compiler import kernels, machine_code
from rigidmc.protocols import observable

SIZE = 1.0

@observable(units="1", long_name="size", dims=())
class Size(NamedTuple):
    def value(self, t):
        return (SIZE + 0.0 * t,)

scene = rm.Scene(rm.Body((1.0, 2.0, 2.8)), (), rm.Start(omega=(0.1, 2.0, 0.1)))
for SIZE, is_next_process in ((1.0, False), (2.0, False), (2.0, True)):
    if is_next_process:
        kernels._addresses, machine_code._addresses, machine_code.lower = {}, {}, None
    run = rm.simulate(scene, "rk4", dt=0.1, t_end=0.1, members=1, save=(Size(),))
    assert (run.size == SIZE).all()
print(len(machine_code._addresses))
"""


def test_a_changed_class_is_loaded_from_the_disk(tmp_path):
    """A class that has changed in one process: code from the disk is that of its present form."""
    (tmp_path / "next.py").write_text(NEXT)
    out, log = python(tmp_path / "next.py", cache=tmp_path / "cache")
    assert int(out) > 0 and "cannot use" not in log, log


CHECK = """
import json, pathlib, sys
import tests.engine.compiler.test_changed_parts as here
module = here.load(pathlib.Path(sys.argv[1]))
order = json.loads(sys.argv[2])
worst = {way: here.follow(module, way, here.compiled, order) for way in here.WAYS}
print(json.dumps(worst))
"""


@pytest.mark.slow
def test_no_process_takes_the_code_of_another_content(tmp_path):
    for order in ([False, True, False], [True, False, True]) * 2:
        out, _ = python(CHECK, tmp_path, json.dumps(order), cache=tmp_path / "cache")
        assert max(json.loads(out).values()) < 1e-15  # measured 0


def test_facts_that_are_compiled_give_another_copy(tmp_path):
    module = load(tmp_path)
    first, new = frozen_class(module.Push), module.Numbers.__new__
    for thing, what, there, other in (
        (module.Push, "is_random", False, True),
        (new, "__defaults__", new.__defaults__, (3.0,)),
    ):
        setattr(thing, what, other)
        assert frozen_class(module.Push) is not first
        setattr(thing, what, there)
        assert frozen_class(module.Push) is first


REFUSED = {
    "an import in the code": "def law(x):\n    import beside_changed\n    return x\n",
    "a module as a value": "def law(x):\n    them = beside\n    return them.NUMBER * x\n",
    "a global that is changed": "def law(x):\n    global NUMBER\n    NUMBER = 2.0\n    return x\n",
    "a class in the code": "def law(x):\n    class A: pass\n    return x\n",
}


@pytest.mark.parametrize("way", REFUSED)
def test_what_cannot_be_followed_is_refused(way, tmp_path):
    module = load(tmp_path)
    exec(REFUSED[way], vars(module))
    with pytest.raises(PartError, match="Push: law "):
        frozen(parts_of(module))


TAUGHT = """
import numba
from numba.extending import overload

FACTOR = 1.0


def taught(x):
    return FACTOR * x


@overload(taught)
def of_numba(x):
    return lambda x: FACTOR * x


@numba.vectorize
def by_element(x):
    return FACTOR * x
"""
REFUSE = """
import pathlib, sys
import tests.engine.compiler.test_changed_parts as here
from rigidmc.engine.compiler.frozen import frozen
from rigidmc.errors import PartError

module = here.load(pathlib.Path(sys.argv[1]))
exec(here.TAUGHT, vars(module))
exec(f"def law(x):\\n    return {sys.argv[2]}(x)", vars(module))
frozen(here.parts_of(module))
exec(sys.argv[3], vars(module))
try:
    frozen(here.parts_of(module))
except PartError as error:
    print(error)
"""


AGAIN = "@overload(taught)\ndef of_numba(x):\n    return lambda x: 2.0 * x"
KEPT = [("taught", "FACTOR = 2.0"), ("by_element", "FACTOR = 2.0"), ("taught", AGAIN)]


@pytest.mark.parametrize(
    ("name", "change"),
    [KEPT[0], *(pytest.param(*each, marks=pytest.mark.slow) for each in KEPT[1:])],
)
def test_code_that_numba_keeps_is_refused_once_it_changes(name, change, tmp_path):
    """In a process of its own: who extends Numba does so for good."""
    told, _ = python(REFUSE, tmp_path, name, change)
    assert "has changed since Numba compiled it" in told

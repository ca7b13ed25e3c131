"""Python that the compiler does not take, in each compiled method of each kind of custom part: a
short message names class, method, line and cure, before anything runs."""

import itertools
import linecache

import pytest

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from rigidmc.errors import RigidmcError

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")

TOP = """
import contextlib
import functools
from typing import NamedTuple

import numpy as np

from rigidmc.protocols import (
    effect, event, linear_combination, normalised, observable, running, scaled, state_rates,
)

DICT, LIST, SIZE = {"a": 1.0}, [1.0], 2.0
part = functools.partial(lambda x, y: x * y, 1.0)
cached = functools.lru_cache(lambda x: x)


def starred(*terms):
    return terms[0]


def keyword(x, *, by=1.0):
    return by * x


def wrapped(function):
    def wrapper(*given, **named):
        return function(*given, **named)

    return wrapper


@wrapped
def decorated(x):
    return x


class Plain:
    number = 1.0


def euler(body, effects, t, h, q, l):
    rates = state_rates(scaled(body, h), effects, body, t, h, q, l)
    q, l = linear_combination((q, l), (1.0,), (rates,))
    return normalised(q), l

"""
TERMS = {  # a term of value 1 or so, and a word of the cure
    "a generator expression": ("max(x for x in (1.0, 0.5))", "generator expression"),
    "a dictionary": ('{"a": 1.0}["a"]', "dictionary"),
    "a dictionary comprehension": ("{1: float(i) for i in range(2)}[1]", "dictionary"),
    "a set": ("float(len({1.0}))", "a set"),
    "a set comprehension": ("float(len({i * 0 for i in range(3)}))", "set comprehension"),
    "a formatted text": ('float(f"{1}")', "text"),
    "a global dictionary": ('DICT["a"]', "DICT, a dict"),
    "a global list": ("LIST[0]", "LIST, a list"),
    "a partial function": ("part(1.0)", "part, a partial function"),
    "a cached function": ("cached(1.0)", "cached, a decorated function"),
    "a decorated function": ("decorated(1.0)", "star"),
    "a starred helper": ("starred(*LIST)", "star"),
    "a keyword": ("keyword(1.0, by=1.0)", "star"),
    "a class attribute": ("self.gain", "self.gain, which is not a field"),
    "another method": ("self.helped()", "self.helped, another method"),
    "an attribute of a class": ("Plain.number", "Plain, a class"),
    "an object": ("Plain().number", "Plain, a class"),
    "isinstance": ("(1.0 if isinstance(self, Plain) else 1.0)", "isinstance"),
    "a map": ("sum(map(abs, (1.0,)))", "sum"),
    "sorted": ("sorted((1.0, 2.0))[0]", "sorted"),
    "an array": ("np.ones(3)[0]", "np.ones, which works on arrays"),
    "a list comprehension": ("[float(i) for i in (1, 2)][0]", "list comprehension"),
}
STATEMENTS = {
    "try": ("try:\n            x = 1.0\n        except ValueError:\n            x = 2.0", "try"),
    "with": ("with contextlib.nullcontext():\n            x = 1.0", "with"),
    "an import": ("import contextlib as there", "import"),
    "a class in the method": ("class There:\n            pass", "class"),
    "global": ("global SIZE\n        SIZE = 1.0", "changes a global"),
    "a list that grows": ("there = []\n        there.append(1.0)", "a list"),
    "a generator": ("there = (x for x in (1.0,))", "generator expression"),
}
KINDS = {  # the class, with its methods: (arguments, result)
    "effect": (
        '@effect(units={"size": "N m"}, in_body=())\nclass Own(NamedTuple):\n    size: float\n',
        {
            "torque": ("q", "(0.0 * TERM, 0.0 * q[0], 0.0 * self.size)"),
            "energy": ("q", "0.0 * q[0] * TERM"),
            "energy_scale": ("", "self.size * TERM"),
            "kick": ("l", "(l[0] * TERM, l[1], l[2])"),
            "torque_rate": ("w", "(0.0 * w[0] * TERM, 0.0 * w[0], 0.0 * w[1])"),
        },
    ),
    "observable": (
        '@observable(units="1", long_name="x", dims=())\nclass Own(NamedTuple):\n    size: float\n',
        {"value": ("q", "(q[0] * TERM,)")},
    ),
    "event": (
        '@event(outputs={"n": ("1", "n", ())})\nclass Own(NamedTuple):\n    size: float\n'
        "    def results(self, record):\n        return {'n': record.count}\n",
        {"level": ("q", "q[0] * TERM"), "armed": ("level", "level * TERM < 0.0")},
    ),
    "running": (
        '@running(state_size=1, outputs={"n": ("1", "n", ())})\n'
        "class Own(NamedTuple):\n    size: float\n"
        "    def results(self, state, steps):\n        return {'n': state[0]}\n",
        {"begin": ("q", "(q[0] * TERM,)"), "update": ("state, q", "(state[0] + q[0] * TERM,)")},
    ),
    "integrator": (
        "class Own(NamedTuple):\n"
        "    order, evaluations, is_reversible, conserves = 1, 1, False, ()\n"
        '    accepts, compensated = "any torque", False\n',
        {"step": ("body, effects, t, h, q, l", "euler(body, effects, t, h * TERM, q, l)")},
    ),
}
FIRST = {"effect": "torque", "event": "level", "running": "begin"}
NUMBERS = itertools.count()


def own(kind, method, term="1.0", statement="pass"):
    """The class of a kind, with a term or a statement in one method, and its line there."""
    head, methods = KINDS[kind]
    text = f"{TOP}\n{head}    gain = 1.0\n    def helped(self):\n        return 1.0\n"
    for name, (arguments, result) in methods.items():
        needed = name in (method, FIRST.get(kind)) or kind == "running"
        if not needed:
            continue
        here = (statement, term) if name == method else ("pass", "1.0")
        words = ", ".join(filter(None, ("self", arguments)))
        text += f"    def {name}({words}):\n        {here[0]}\n"
        text += f"        return {result.replace('TERM', here[1])}\n"
    file = f"<own {next(NUMBERS)}>"
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    names = {"__name__": "own_uncompilable"}
    exec(compile(text, file, "exec"), names)
    return names["Own"]


def checked(kind, cls):
    part = cls() if kind == "integrator" else cls(1.0)
    body, start = rm.Body((1.0, 2.0, 2.8)), rm.Start(omega=(0.3, 2.0, 0.2))
    scene = rm.Scene(body, part if kind == "effect" else (), start)
    save = [part] if kind in ("observable", "event", "running") else ["omega"]
    integrator = part if kind == "integrator" else "rk4"
    rm.prepare(scene, integrator, members=2, dt=0.05, t_end=0.5, every=0.25, save=save)


def complaint(kind, method, **code):
    with pytest.raises(RigidmcError) as caught:
        checked(kind, own(kind, method, **code))
    text = str(caught.value)
    assert len(text.splitlines()) <= 25 and len(text) < 900, text
    assert "Own" in text and "numba" not in text.lower(), text
    return text


QUICK = "a generator expression", "a class attribute", "a partial function", "a dictionary"


@pytest.mark.parametrize("name", QUICK)
def test_a_term_in_energy_scale_is_told(name):
    term, word = TERMS[name]
    text = complaint("effect", "energy_scale", term=term)
    assert "Own.energy_scale" in text and word in text and "line" in text, text


ALL = [(kind, method) for kind, (_, methods) in KINDS.items() for method in methods]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "method"), ALL)
def test_each_construct_is_told_with_method_line_and_cure(kind, method):
    left = []
    for name, (term, word) in TERMS.items():
        try:
            text = complaint(kind, method, term=term)
        except BaseException as error:
            left.append((name, f"{type(error).__name__} {error}"[:600]))
            continue
        if not (f"Own.{method}" in text and word in text):
            left.append((name, text))
    for name, (statement, word) in STATEMENTS.items():
        try:
            text = complaint(kind, method, statement=statement)
        except BaseException as error:
            left.append((name, f"{type(error).__name__} {error}"[:600]))
            continue
        if word not in text:
            left.append((name, text))
    assert not left, "\n".join(f"{name}: {text}" for name, text in left)

"""Trials in Python of the methods of custom classes, before they are compiled.

They check the arguments of each method, loops whose length depends on numbers, and results.
"""

import ast
import inspect
import linecache
import textwrap
import traceback
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import PartError, SceneError, hint_of, nearest
from rigidmc.physics.dynamics.methods import Method, arguments, implements, old_word

RULE = (
    "compiled code uses floats and small tuples: no arrays, no lists, no calls except of math, "
    "and no loop whose length depends on numbers"
)
_STATES = 8  # random states at which methods are tried
# Former names of arguments of methods, and their present names; until 1.0.
OLD_ARGUMENTS = {"kept": "state", "part": "substep"}


class State(NamedTuple):
    """A state in which methods are tried."""

    t: float
    q: tuple[float, ...]
    l: tuple[float, ...]


def states() -> Iterator[State]:
    """Yield random states, always the same."""
    some = np.random.default_rng(1)
    for _ in range(_STATES):
        q, l = some.normal(size=4), some.normal(size=3)
        yield State(
            float(some.uniform(0.0, 2.0)),
            tuple((q / np.linalg.norm(q)).tolist()),
            tuple(l.tolist()),
        )


class Trial(NamedTuple):
    """A custom class under trial.

    at : the table of the scene that names it, for messages
    part : an instance whose numbers are floats, as in compiled code
    """

    at: str
    part: Any

    def complaint(self, name: str, rule: str, line: int | None = None) -> PartError:
        """Return the error about a method or a fact of the class, with its line if known."""
        kind = type(self.part)
        # a class defined in a notebook has no file
        file = getattr(kind, name).__code__.co_filename if line else ""
        place = f"{file}, line {line}: {linecache.getline(file, line).strip()}: " if line else ""
        return PartError.of(kind, place + rule, self.at, name, line)

    def refuse_old(self, words: Mapping[str, str]) -> None:
        """Raise SceneError for a method or a fact with a former name; words : {old: new}."""
        if found := old_word(self.part, words):
            old, new = found
            raise self.complaint(old, f"is now called {new}")

    def read(self, *methods: Method) -> None:
        """Raise SceneError for a method with an unknown argument, or with a loop whose length
        depends on numbers."""
        for method in methods:
            if implements(self.part, method.__name__):
                self._check_arguments(method)
                self._check_loops(method.__name__)

    def number(self, method: Method, values: Mapping[str, Any]) -> float:
        """Return the result of a method, which must be one finite number."""
        value = self.called(method, values)
        self._check_list(method, value, "a number")
        if isinstance(value, tuple) or not _is_number(value):
            raise self.complaint(method.__name__, f"returns {value!r}, expected a number")
        self._check_finite(method, value, (value,))
        return float(value)

    def numbers(
        self, method: Method, values: Mapping[str, Any], size: int | None = None
    ) -> tuple[Any, ...]:
        """Return the result of a method: a tuple of `size` finite numbers, or of any number."""
        value = self.called(method, values)
        many = "numbers" if size is None else f"{size} number{'s' * (size != 1)}"
        expected = f"a tuple of {many}"
        self._check_list(method, value, expected)
        right = isinstance(value, tuple) and (size is None or len(value) == size)
        if not right or not all(map(_is_number, value)):
            raise self.complaint(method.__name__, f"returns {value!r}, expected {expected}")
        self._check_finite(method, value, value)
        found: tuple[Any, ...] = value
        return found

    def called(self, method: Method, values: Mapping[str, Any]) -> Any:
        """Return the result of a method, or of its default, for values by name."""
        function = getattr(type(self.part), method.__name__, None)
        if function is None:
            return method(self.part, *(values.get(name) for name in method.available))
        return self.run(method.__name__, *(values[name] for name in arguments(function)))

    def run(self, name: str, *values: Any) -> Any:
        """Return the result of a method; raise SceneError with the line if it raises."""
        function = getattr(type(self.part), name)
        try:
            return function(self.part, *values)
        except Exception as error:  # custom code may raise anything
            if isinstance(error, SceneError):
                raise
            frames = traceback.extract_tb(error.__traceback__)
            lines = [f.lineno for f in frames if f.filename == function.__code__.co_filename]
            rule = f"raises {type(error).__name__}: {error}"
            raise self.complaint(name, rule, lines[-1] if lines else None) from None

    def _check_list(self, method: Method, value: Any, expected: str) -> None:
        parts = value if isinstance(value, tuple) else (value,)
        wrong = [x for x in (value, *parts) if isinstance(x, (np.ndarray, list))]
        if wrong:
            rule = f"returns {type(wrong[0]).__name__}, expected {expected}; {RULE}"
            raise self.complaint(method.__name__, rule)

    def _check_finite(self, method: Method, value: Any, parts: tuple[Any, ...]) -> None:
        if not np.isfinite(np.array(parts, dtype=float)).all():
            raise self.complaint(method.__name__, f"returns {value!r}, which is not finite")

    def _check_arguments(self, method: Method) -> None:
        for argument in arguments(getattr(type(self.part), method.__name__)):
            if argument not in method.available:
                close = OLD_ARGUMENTS.get(argument) or nearest(argument, method.available)
                known = ", ".join(method.available) or "nothing"
                rule = f"unknown argument '{argument}'; it may name {known}{hint_of(close)}"
                raise self.complaint(method.__name__, rule)

    def _check_loops(self, name: str) -> None:
        """Reject a loop whose length depends on numbers: members of a vector loop together."""
        method = getattr(type(self.part), name)
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(method)))
        except (OSError, TypeError, SyntaxError):  # typed into a shell
            return
        for node in ast.walk(tree):
            if isinstance(node, ast.For):
                call = node.iter if isinstance(node.iter, ast.Call) else None
                counted = call is None or all(isinstance(a, ast.Constant) for a in call.args)
            elif isinstance(node, ast.While):
                counted = False
            else:
                continue
            if not counted:
                line = method.__code__.co_firstlineno + node.lineno - 1
                rule = f"a loop whose length depends on numbers; {RULE}"
                raise self.complaint(name, rule, line)


def _is_number(value: Any) -> bool:
    return bool(np.isscalar(value) and not isinstance(value, (str, bytes)) and np.isreal(value))

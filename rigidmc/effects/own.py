"""A user's own effect, looked at before it is compiled: what it asks for, what it gives back, and whether its torque is that of its energy."""

import ast
import importlib.util
import inspect
import linecache
import os
import textwrap
import traceback
from typing import Any

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.so3 import exponential, multiply
from rigidmc.effects import EFFECTS, protocol
from rigidmc.effects.parameters import filled, numbers
from rigidmc.errors import SceneError, nearest

_VERBS = {
    "torque": 3,
    "kick": 3,
    "shake": 3,
    "torque_rate": 3,
    "energy": 1,
    "energy_scale": 1,
}  # and how many numbers each gives
RULE = "kernels take floats and small tuples in and out: no arrays, no lists, no calls but of math, and no loop whose length depends on numbers"


_modules: dict[tuple, object] = {}


def class_of(folder, path, name, table):
    """The class of an effect in a Python file, which is run: only where the user allowed it. SceneError for a file without it."""
    file = os.path.realpath(os.path.join(folder, path))
    if not os.path.isfile(file) or not file.endswith(".py"):
        raise SceneError(
            table,
            "module",
            path,
            "is no Python file (.py)" if os.path.isfile(file) else f"there is no file {file}",
        )
    place = file, os.stat(file).st_mtime_ns  # anew where it was changed
    if place not in _modules:
        spec: Any = importlib.util.spec_from_file_location(f"own_effects_{len(_modules)}", file)
        module = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        except Exception as error:  # the user's own code: anything may come
            line = next(
                (
                    f.lineno
                    for f in reversed(traceback.extract_tb(error.__traceback__))
                    if f.filename == file
                ),
                None,
            )
            where = f" (line {line})" if line else ""
            raise SceneError(
                table, "module", path, f"raises {type(error).__name__}{where}: {error}"
            ) from None
        _modules[place] = module
    kind = getattr(_modules[place], name, None)
    if not isinstance(kind, type) or not hasattr(kind, "_fields"):
        made = [
            k
            for k, v in vars(_modules[place]).items()
            if isinstance(v, type) and hasattr(v, "_fields")
        ]
        raise SceneError(
            table,
            "module",
            path,
            f"has no NamedTuple {name}; it has {', '.join(made) or 'none'}",
            nearest(name, made),
        )
    return kind


def source_of(kind):
    """The file of a user's own class, None where it is in none (a notebook, or the shell)."""
    verb = next(getattr(kind, verb) for verb in _VERBS if hasattr(kind, verb))
    file = verb.__code__.co_filename
    return os.path.abspath(file) if os.path.isfile(file) else None


def check_own(effect):
    """Raise SceneError for an effect that is none of EFFECTS and that a kernel could not use, with its class, line and rule."""
    kind = type(effect)
    if kind in EFFECTS.values():
        return
    for verb in _VERBS:
        if hasattr(kind, verb):
            _arguments(kind, verb)
            _loops(kind, verb)
    sample = filled(
        kind,
        [
            float(np.ravel(value)[0]) if isinstance(value, (float, np.ndarray)) else 0.1
            for _, _, value in numbers(effect)
        ],
    )
    some = np.random.default_rng(1)
    for _ in range(8):
        q = some.normal(size=4)
        q, l, t = (
            tuple((q / np.linalg.norm(q)).tolist()),
            tuple(some.normal(size=3).tolist()),
            float(some.uniform(0.0, 2.0)),
        )
        for verb, size in _VERBS.items():
            if hasattr(kind, verb):
                _gives(kind, verb, size, _called(sample, verb, t, q, l))
        if hasattr(kind, "energy") and hasattr(kind, "torque"):
            _gradient(sample, t, q, l)


_BODY = MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3))


def _complaint(kind, verb, rule, line=None):
    file = getattr(
        kind, verb
    ).__code__.co_filename  # of the method: a class of a notebook has no file
    source = f"{file}, line {line}: {linecache.getline(file, line).strip()}: " if line else ""
    return SceneError("effects", f"{kind.__name__}.{verb}", None, source + rule)


def _arguments(kind, verb):
    known = getattr(protocol, verb).available
    for name in list(inspect.signature(getattr(kind, verb)).parameters)[1:]:
        if name not in known:
            close = nearest(name, known)
            raise _complaint(
                kind,
                verb,
                f"asks for '{name}'; it may name {', '.join(known)}"
                + (f" (did you mean '{close}'?)" if close else ""),
            )


def _loops(kind, verb):
    """A loop has to be as long whatever the numbers: lanes of members take it together."""
    method = getattr(kind, verb)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(method)))
    except (OSError, TypeError, SyntaxError):  # of a shell
        return
    for node in ast.walk(tree):
        counted = (
            not isinstance(node, ast.For)
            or not isinstance(node.iter, ast.Call)
            or all(isinstance(a, ast.Constant) for a in node.iter.args)
        )
        if isinstance(node, ast.While) or not counted:
            raise _complaint(
                kind,
                verb,
                f"a loop whose length depends on numbers; {RULE}",
                method.__code__.co_firstlineno + node.lineno - 1,
            )


def _called(effect, verb, t, q, l):
    given = {"body": _BODY, "t": t, "h": 0.1, "q": q, "l": l, "w": l}
    names = list(inspect.signature(getattr(type(effect), verb)).parameters)[1:]
    try:
        return getattr(effect, verb)(*(given[name] for name in names))
    except Exception as error:  # the user's own code: anything may come
        frames = [
            f
            for f in traceback.extract_tb(error.__traceback__)
            if f.filename == getattr(type(effect), verb).__code__.co_filename
        ]
        line = frames[-1].lineno if frames else None
        raise _complaint(
            type(effect), verb, f"raises {type(error).__name__}: {error}", line
        ) from None


def _gives(kind, verb, size, value):
    if isinstance(value, (np.ndarray, list)):
        raise _complaint(
            kind,
            verb,
            f"gives {type(value).__name__}, expected {'a number' if size == 1 else 'a tuple of 3 numbers'}; {RULE}",
        )
    parts = value if isinstance(value, tuple) else (value,)
    if (
        len(parts) != size
        or (size == 3) != isinstance(value, tuple)
        or not all(np.isscalar(x) and np.isreal(x) for x in parts)
    ):
        raise _complaint(
            kind,
            verb,
            f"gives {value!r}, expected {'a number' if size == 1 else 'a tuple of 3 numbers'}",
        )
    if not np.isfinite(np.array(parts, dtype=float)).all():
        raise _complaint(kind, verb, f"gives {value!r}, which is not finite")


def _gradient(effect, t, q, l, step=1e-5):
    """The torque has to be minus the change of energy as the body turns."""
    torque, slopes = np.array(_called(effect, "torque", t, q, l)), []
    for axis in np.eye(3):
        ahead, behind = (
            multiply(q, exponential(tuple(sign * step * axis))) for sign in (1.0, -1.0)
        )
        slopes.append(
            (_called(effect, "energy", t, ahead, l) - _called(effect, "energy", t, behind, l))
            / (2.0 * step)
        )
    size = max(np.abs(torque).max(), np.abs(slopes).max())
    if np.abs(torque + slopes).max() > 1e-6 * size:
        opposite = np.abs(torque - slopes).max() <= 1e-6 * size
        told, own = ", ".join(f"{-s:.6g}" for s in slopes), ", ".join(f"{x:.6g}" for x in torque)
        raise _complaint(
            type(effect),
            "torque",
            f"({own}) is not that of its energy, ({told}){', but the opposite of it' if opposite else ''}, at the attitude "
            f"{', '.join(f'{x:.4g}' for x in q)}; it has to be minus the change of energy as the body turns about its axes",
        )

"""Walks through a running package, for `bench.house`.

`bench.house` defines how each is counted.
"""

import _thread
import contextlib
import copy
import dis
import io
import linecache
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

from bench.tools.house_counts import SCENE, SCENE_BASES

# Names of the package, which a move may change.
SCENES = {SCENE, *SCENE_BASES}
ERRORS = {"RigidmcError", "ValidationError", "ValueError"}
ENTRY = ("rigidmc.cli", "main")  # the function that the command line calls
PATH_SCENE = "heavy_top"
# parameters that may hold a member's state: attitude and momentum, or everything stored of it
STATE = {"q", "l", "state", "block", "rows", "frame", "flat", "member", "moving", "work"}
# an observable by its classes (the other ones are its compiled parts); and its name
OBSERVABLE, OBSERVABLE_NAME = {"Flips", "Component", "FlipLevel"}, "flips"
FREE_SCENE = "dzhanibekov"  # of the walk of an observable

MOST, DEEP = 32, 3  # elements of a collection that are inspected; nesting of collections
WALKS = ("scene", "dt", "state", "observable", "parameter", "error")
PARAMETER = "effects.gravity.g"  # by which a run of PATH_SCENE differentiates


class Visit(NamedTuple):
    """A visit to a function: its file below the root, its name, and a note."""

    file: str
    function: str
    note: str = ""


def load_package(root: Path) -> Any:
    """Import the package of a root."""
    sys.path.insert(0, str(root.parent))
    package = import_module(root.name)
    assert Path(package.__file__).resolve().parent == root, f"{package.__file__} is not of {root}"
    return package


def follow(run: Callable[[], Any], root: Path, sees: Callable[[FrameType], str]) -> list[Visit]:
    """Return the functions of a package that a call enters, in order.

    sees : returns the note of a visit, "" if it does not count
    """
    visits: list[Visit] = []
    front = f"{root}{os.sep}"

    def enter(frame: FrameType) -> None:
        file = frame.f_code.co_filename
        if file.startswith(front) and (note := sees(frame)):
            visits.append(Visit(file[len(front) :], frame.f_code.co_qualname, note))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _enter.append(enter)
        sys.setprofile(_hear)
        try:
            run()
        finally:
            sys.setprofile(None)
            _enter.clear()
    return visits


_enter: list[Callable[[FrameType], None]] = []  # callbacks for each call


def _hear(frame: FrameType, event: str, _: Any) -> None:
    """A profile function for all threads."""
    if event == "call":
        for enter in _enter:
            enter(frame)


def _listen() -> None:
    """Let `follow` record calls in threads that start later, including the package's pools."""
    begin = _thread.start_new_thread

    def start_new_thread(function: Any, given: Any, *rest: Any) -> int:
        def work(*words: Any, **named: Any) -> None:
            sys.setprofile(_hear)
            function(*words, **named)

        return begin(work, given, *rest)

    _thread.start_new_thread = start_new_thread
    threading.setprofile(_hear)


def arguments(frame: FrameType) -> Iterator[tuple[str, Any]]:
    """Yield (name, value) of each argument of a call."""
    code, values = frame.f_code, frame.f_locals
    stars = bool(code.co_flags & 4) + bool(code.co_flags & 8)
    for name in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount + stars]:
        if name in values:
            yield name, values[name]


def holds(value: Any, kinds: set[str], depth: int = 1) -> bool:
    """Return whether a value is an object of classes, by their names, or a tuple, list or dict of
    these.

    depth : nesting of collections; a NamedTuple does not count as a collection
    """
    if any(one.__name__ in kinds for one in type(value).__mro__):
        return True
    if depth == 0 or type(value) not in (tuple, list, dict):
        return False
    parts = tuple(value.values()) if type(value) is dict else value[:MOST]
    return any(holds(one, kinds, depth - 1) for one in parts)


def sees_kinds(kinds: set[str], depth: int = 1) -> Callable[[FrameType], str]:
    """Return, for `follow`, the parameters that hold an object of classes, by their names."""
    return lambda frame: ", ".join(
        name for name, value in arguments(frame) if holds(value, kinds, depth)
    )


def is_of_module(frame: FrameType) -> str:
    """Accept functions of modules, for `follow`, but no methods, lambdas or nested functions."""
    name = frame.f_code.co_qualname
    return "" if "." in name or "<" in name else " "


def sees_state(frame: FrameType) -> str:
    """Return, for `follow`, the parameters that have a member's state."""
    return ", ".join(
        name
        for name, value in arguments(frame)
        if name in STATE and not isinstance(value, (str, int, type(None)))
    )


def sees_name(frame: FrameType) -> str:
    """Return, for `follow`, the arguments that are or contain the name of PARAMETER."""
    return ", ".join(
        name
        for name, value in arguments(frame)
        if PARAMETER in ([value] if isinstance(value, str) else _texts(value))
    )


def _texts(value: Any) -> list[str]:
    """Return the texts of a collection."""
    parts = value if isinstance(value, (tuple, list, dict)) else ()
    return [part for part in parts if isinstance(part, str)]


@cache
def reads_dt(code: CodeType) -> bool:
    """Return whether a function reads a name or attribute `dt`."""
    lines = (line for line in dis.get_instructions(code) if line.opname.startswith("LOAD"))
    loads = (x.argval if isinstance(x.argval, tuple) else (x.argval,) for x in lines)
    return any("dt" in names for names in loads)


def climbs(visits: Iterable[Visit], height: dict[str, int]) -> set[tuple[str, str]]:
    """Return pairs of files, entered in succession, of which the second is in a higher layer."""

    def of(file: str) -> int:
        return height.get(file.split("/")[0].removesuffix(".py"), len(height) + 1)

    files = [one.file for one in visits]
    return {(a, b) for a, b in pairwise(files) if of(b) > of(a)}


def simulate_call(package: Any, name: str, **settings: Any) -> Callable[[], Any]:
    """Return a function that runs a shipped scene as for the first time, with compiled code."""
    scene = package.Scene.load(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        package.simulate(copy.copy(scene), **settings)
    return lambda: package.simulate(scene, **settings)


def walk_of_path(root: Path, sees: Callable[[FrameType], str]) -> list[Visit]:
    """Return the functions that a warm `simulate` of 32 members of PATH_SCENE enters."""
    package = load_package(root)
    return follow(simulate_call(package, PATH_SCENE, members=32, t_end=1.0), root, sees)


def interpreted(root: Path) -> Any:
    """Return the package in a process without compilation, so that the walk enters kernels."""
    assert "numba" not in sys.modules, "too late: Numba compiles"
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    return load_package(root)


def walk(what: str, root: Path) -> list[Visit]:
    """Return the functions that a thing passes in a run, in order."""
    if what == "error":
        return walk_of_error(root)
    _listen()
    if what == "scene":
        return walk_of_path(root, sees_kinds(SCENES))
    if what == "dt":
        return walk_of_path(root, lambda frame: "reads dt" * reads_dt(frame.f_code))
    settings: dict[str, Any] = {"members": 32, "t_end": 1.0, "wrt": (PARAMETER,)}
    if what == "parameter":
        return follow(simulate_call(load_package(root), PATH_SCENE, **settings), root, sees_name)
    package = interpreted(root)
    scene = package.Scene.load(FREE_SCENE if what == "observable" else PATH_SCENE)
    settings = {"members": 2, "t_end": 4 * scene.run.dt, "threads": 1}
    if what == "observable":
        settings["save"] = ("omega", OBSERVABLE_NAME)
    sees = sees_kinds(OBSERVABLE, DEEP) if what == "observable" else sees_state
    return follow(lambda: package.simulate(scene, **settings), root, sees)


BAD = """[body]
moments = [1.0, 2.0, 3.0]
[start]
omega = [0.0, 1.0, 0.01]
[run]
dt = "one"
t_end = 1.0
"""


def walk_of_error(root: Path) -> list[Visit]:
    """Return functions that raise, pass, catch or are called with the error of a wrong `run.dt`.

    The command line runs a scene file. The walk starts with the first error of a value and ends
    when the message is on the screen.
    """
    load_package(root)
    main = getattr(import_module(ENTRY[0]), ENTRY[1])
    front, visits, open_in = f"{root}{os.sep}", list[Visit](), dict[FrameType, str]()

    def note(frame: FrameType, text: str) -> None:
        visits.append(Visit(frame.f_code.co_filename[len(front) :], frame.f_code.co_qualname, text))

    def is_error(value: Any) -> bool:
        return holds(value, ERRORS, 0)

    def trace(frame: FrameType, event: str, arg: Any) -> Any:
        if not frame.f_code.co_filename.startswith(front):
            return None
        if event == "call" and visits:
            for name, value in arguments(frame):
                if is_error(value):
                    note(frame, f"is called with it, as {name}")
        elif event == "exception" and is_error(arg[1]):
            first = arg[2].tb_next is None
            note(frame, f"{'raises' if first else 'passes'} {arg[0].__name__}")
            open_in[frame] = arg[0].__name__
        elif event == "line" and frame in open_in:
            line = linecache.getline(frame.f_code.co_filename, frame.f_lineno).lstrip()
            if line.startswith("except"):  # not "finally", and not the exit of a "with"
                note(frame, f"catches {open_in.pop(frame)}")
        elif event == "return":
            open_in.pop(frame, None)
        return trace

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bad.toml"
        file.write_text(BAD, "utf-8")
        words, sys.argv = sys.argv, [root.name, "run", str(file)]
        try:
            with contextlib.redirect_stderr(io.StringIO()), contextlib.suppress(SystemExit):
                sys.settrace(trace)
                main()
        finally:
            sys.settrace(None)
            sys.argv = words
    return visits


def first_visits(visits: Iterable[Visit]) -> list[Visit]:
    """Return each function once, at its first visit."""
    found: dict[tuple[str, str], Visit] = {}
    for one in visits:
        found.setdefault(one[:2], one)
    return list(found.values())

"""Errors that state the value given, its place, the allowed values and the nearest valid word."""

import difflib
import os
import re
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from pydantic import ValidationError

_SCREEN, _WORD = 1600, 200  # longest message and word, in characters: foreign files may have more
_MANY = 200  # most valid words that a message lists
# C0 without tab and newline, C1, and marks that change the writing direction
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


class RigidmcError(ValueError):
    """A mistake in the user's input; the command line exits with code 3, see `rigidmc.cli.app`.

    The message names file, place, value, rule and the nearest valid word, each also an attribute.

    Parameters
    ----------
    rule : str
        the rule that the input breaks
    at : str, optional
        place of the mistake: a path such as "run.dt", "effects.gravity.g", or an argument "threads"
    table : str, optional
        leading part of `at` that the message shows in brackets as the table; by default all but
        the last word
    value : object, optional
        the value given; None if the message does not show it
    nearest : str, optional
        the nearest valid word
    file : str, optional
        file with the mistake

    Attributes
    ----------
    table, key : str
        the two parts of `at`, such as "effects.gravity" and "g"; the table may be ""

    Examples
    --------
    >>> try:
    ...     rm.Body.from_moments((1.0, 2.0, -3.0))
    ... except rm.RigidmcError as error:
    ...     error.at, error.rule
    ('body.moments', 'principal moments must be positive')
    """

    def __init__(
        self,
        rule: str,
        *,
        at: str = "",
        table: str | None = None,
        value: Any = None,
        nearest: str | None = None,
        file: str | None = None,
    ) -> None:
        super().__init__(rule)
        self.rule, self.at, self.value = rule, at, value
        self.nearest, self.file, self._table = nearest, file, table

    @property
    def table(self) -> str:
        return self.at.rpartition(".")[0] if self._table is None else self._table

    @property
    def key(self) -> str:
        return self.at[len(self.table) + 1 :] if self.table else self.at

    def __reduce__(self) -> tuple[Any, ...]:  # cluster workers send errors pickled
        return type(self), (self.rule,), self.__dict__

    def __str__(self) -> str:
        return self.text(self.key)

    def text(self, key: str) -> str:
        """Return the message with another word for the key, such as a command-line option."""
        file = f"{_cut(self.file)}: " if self.file else ""
        place = f"[{_cut(self.table, _WORD)}] " if self.table else ""
        value = "" if self.value is None else f" = {_short(self.value)}"
        hint = hint_of(_cut(self.nearest, _WORD) if self.nearest else "")
        subject = f"{place}{_cut(key, _WORD)}{value}: "
        subject = "" if file and subject == "file: " else subject  # the name of the file says it
        return terminal_text(f"{file}{subject}{_cut(self.rule)}{hint}")


class SceneError(RigidmcError):
    r"""A scene that cannot be run, or a body or motion that cannot be computed.

    Examples
    --------
    >>> rm.Scene.loads("body.moments = [1, 2, 3]\nstart.omeg = [0, 1, 0]")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.SceneError: scene: [start] omeg: no such key; known: omega, momentum, attitude...
    """


class PartError(SceneError):
    """A mistake in a custom effect, observable, integrator or distribution.

    Its path continues after the table with the class and its method or attribute, such as
    "effects.Wind.torque".

    Parameters
    ----------
    rule : str
        the rule that the class breaks
    source : str, optional
        Python file of the class, if known
    line : int, optional
        line in this file
    **place
        other parameters of `RigidmcError`

    Examples
    --------
    >>> from typing import NamedTuple
    >>> class Wind(NamedTuple):
    ...     speed: float
    ...     def torque(self, v):
    ...         return v, 0.0, 0.0
    >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), (Wind(3.0),), rm.Start(omega=(0.0, 1.0, 0.0)))
    >>> rm.prepare(scene)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.PartError: [effects] Wind.torque: unknown argument 'v'; it may name ...
    """

    def __init__(
        self, rule: str, *, source: str | None = None, line: int | None = None, **place: Any
    ) -> None:
        super().__init__(rule, **place)
        self.source, self.line = source, line

    @classmethod
    def of(
        cls, part: object, rule: str, at: str, name: str = "", line: int | None = None
    ) -> "PartError":
        """Return the error about a class, or its method or attribute `name`, in the table `at`."""
        kind = part if isinstance(part, type) else type(part)
        code = getattr(getattr(kind, name, None), "__code__", None)
        codes = [getattr(x, "__code__", None) for key, x in vars(kind).items() if key[0] != "_"]
        # a class defined in a notebook or shell has no file
        files = [each.co_filename for each in (code, *codes) if each is not None]
        source = next((file for file in files if os.path.isfile(file)), None)
        if source is not None and line is None and code is not None:
            line = code.co_firstlineno
        word = getattr(part, "__name__", kind.__name__)
        path = f"{at}.{word}.{name}" if name else f"{at}.{word}"
        return cls(rule, at=path, table=at, source=source, line=line)


class OptionError(RigidmcError):
    """An option of the command line, or an argument of a function, that cannot be used.

    Examples
    --------
    >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0)
    >>> rm.rerun(ds, member=9)
    Traceback (most recent call last):
    rigidmc.errors.OptionError: member = 9: the result has the members 0 to 3
    """


class FileError(RigidmcError):
    """A file or run directory that cannot be used: not a regular file, damaged, or not a result.

    Examples
    --------
    >>> rm.open(".")
    Traceback (most recent call last):
    rigidmc.errors.FileError: run = '.': is not a run directory: no run.json
    """

    @property
    def table(self) -> str:  # dots, as in scene.toml, belong to the file name
        return self._table or ""


class OutputExists(FileExistsError):
    """A result that would overwrite a file; nothing was written.

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    >>> rm.simulate(scene, output="flips.nc").close()
    >>> rm.simulate(scene, output="flips.nc")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.OutputExists: flips.nc exists; nothing was written...
    """


class NoSuchScene(FileNotFoundError):
    """A name that matches neither a shipped scene nor a file."""


class NoRoom(OSError):
    """Insufficient free memory or disk space."""


class NoDevice(OSError):
    """No usable GPU, or a GPU that fails during the run.

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    >>> rm.simulate(scene, device="cuda:999")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.NoDevice: cuda...
    """


class SceneWarning(UserWarning):
    """A scene that runs, but perhaps not as intended.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as notes:
    ...     warnings.simplefilter("always")
    ...     ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, dt=0.3, t_end=1.0)
    >>> print(notes[0].message)
    dt reduced from 0.3 to 0.2 s, which divides t_end and every
    """


def warn(note: str) -> None:
    """Show a note on a scene or a result as a SceneWarning, at the user's line."""
    warnings.warn(note, SceneWarning, stacklevel=_frames_of_rigidmc() + 1)


def _frames_of_rigidmc() -> int:
    """Return the number of frames of rigidmc between the caller and the user's line, which a
    warning shows."""
    frame, count = sys._getframe(1), 0
    while frame.f_back and frame.f_globals.get("__name__", "").startswith("rigidmc."):
        frame, count = frame.f_back, count + 1
    return count


class Renamed:
    """Base of classes with renamed attributes: the error for an old name gives the new one.

    Version 1.0 removes this class and the tables of old names.
    """

    _OLD_NAMES: ClassVar[Mapping[str, str]] = {}

    if not TYPE_CHECKING:  # type checkers would accept any attribute

        def __getattr__(self, name: str) -> None:
            kind = type(self)
            if name in kind._OLD_NAMES:
                raise AttributeError(
                    f"{kind.__name__}.{name} is now called {kind._OLD_NAMES[name]}"
                )
            raise AttributeError(f"'{kind.__name__}' object has no attribute '{name}'")


def nearest(word: object, words: Iterable[object]) -> str | None:
    """Return the member of `words` that ends in `word`, "run.t_end" for "t_end", else the one that
    it is a synonym of, else the most similar one, else the first with a part like it,
    "effects.gravity.g" for "gravity"; None if none is similar."""
    from rigidmc.inputs.synonyms import NAMES

    # a file may have a million long names, and comparing two takes the product of their lengths
    spelled = {str(w).lower(): str(w) for w in islice(words, _MANY) if len(str(w)) <= _WORD}
    if len(str(word)) > _WORD:
        return None
    asked = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", str(word)).lower().strip().replace("-", "_")

    def ending(name: str) -> Iterator[str]:
        # a vector such as "omega" has its components only
        tails = (rf"\.{re.escape(name)}{end}$" for end in ("", r"(\.\d+)+"))
        return (spelled[w] for tail in tails for w in spelled if re.search(tail, w))

    names = NAMES.get(asked.replace(" ", "_"), ())
    same = (spelled[w] for name in names for w in (name, name.replace("_", "")) if w in spelled)
    if found := next(chain(ending(str(word).lower()), same, *map(ending, names)), None):
        return found
    # similarity: "foo" and "book" 0.57, "sphere" and "shell" 0.55
    if close := difflib.get_close_matches(str(word).lower(), spelled, n=1, cutoff=0.6):
        return spelled[close[0]]
    parts = {
        part: key for key in reversed(spelled) for part in key.split(".")[1:] if not part.isdigit()
    }
    # a part must be more similar than a whole name, because there are many
    close = difflib.get_close_matches(str(word).lower(), parts, n=1, cutoff=0.8)
    return spelled[parts[close[0]]] if close else None


def hint_of(word: str | None) -> str:
    """Return the hint at the nearest right word that ends a message, "" for none."""
    return f" (did you mean '{word}'?)" if word else ""


def unknown(
    kind: str,
    words: Iterable[str],
    *,
    at: str = "",
    key: str | None = None,
    table: str | None = None,
    value: Any = None,
    error: type[RigidmcError] = SceneError,
) -> RigidmcError:
    """Return the error for a word not among `words`: the value at a path, or the key in a table.

    kind : the kind of name expected, such as "effect"
    """
    words = list(words)
    more = f" and {len(words) - _MANY:,} more" if len(words) > _MANY else ""
    rule = f"no such {kind}; known: {', '.join(words[:_MANY])}{more}"
    if key is None:
        return error(rule, at=at, table=table, value=value, nearest=nearest(value, words))
    return error(rule, at=path_of(at, key), table=at, nearest=nearest(key, words))


def from_pydantic(
    error: "ValidationError", at: str, names: Iterable[str], values: Mapping[str, Any]
) -> RigidmcError:
    """Convert pydantic's first complaint about a table to a SceneError; the only place that does.

    names : keys of the table;  given : {key: value} from the user
    """
    # a misspelt key comes before the missing key that it stands for
    first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    key = str(first["loc"][0]) if first["loc"] else "scene"
    if first["type"] == "extra_forbidden":
        return unknown("key" if at else "table or key", names, at=at, key=key)
    rule, value = first["msg"][0].lower() + first["msg"][1:], values.get(key)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, RigidmcError):  # about several keys
        return cause
    if isinstance(cause, ValueError):  # from a validator, which has only the value and the rule
        rule, value = str(cause), first["input"]
    if first["type"] == "tuple_type":  # TOML has no tuples
        rule = "expected names in brackets, or one name"
    if first["type"] == "missing":
        rule, value = "is missing", None
    if first["type"] == "dict_type" and not isinstance(value, Mapping):
        name = f"{key}.NAME" if key in ("effects", "observables") else key
        rule = f"expected a table: write [{name}] in single brackets"
    return SceneError(rule, at=path_of(at, key), table=at, value=value)


@contextmanager
def in_file(file: str) -> Iterator[None]:
    """Add the file name to errors raised while its text is read or used, unless they have one."""
    try:
        yield
    except RigidmcError as error:
        error.file = error.file or file
        raise


def path_of(at: str, key: str) -> str:
    """Return the path of a key in a table; the key alone without a table."""
    return f"{at}.{key}" if at else key


def terminal_text(text: str) -> str:
    """Make a text safe to print: escape characters that control a terminal or change the writing
    direction. Titles and names may come from untrusted files."""
    if text.isascii() and text.isprintable():
        return text
    return _CONTROLS.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


def _short(value: object) -> str:
    if isinstance(value, (list, tuple)) and len(value) > _MANY:  # a repr of all would take long
        value = [*value[:3], ...]
    try:
        # repr raises for an integer of more than 4300 digits
        text = repr(value) if not isinstance(value, int) or abs(value) < 10**80 else "a huge number"
    except Exception:  # of an object of the user
        text = f"a {type(value).__name__}"
    text = " ".join(text.split())  # the repr of a Series has several lines
    # the end of a path identifies the file
    return text if len(text) <= 80 else f"{text[:38]}...{text[-39:]}"


def _cut(text: str, most: int = 0) -> str:
    """Shorten a text to its beginning and end, about `most` characters; by default a screen."""
    most = most or _SCREEN
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 3 :]}"

"""Errors that tell what was given, where it stands, what is allowed, and the nearest right word."""

import difflib
import re
import warnings
from collections.abc import Iterable
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

_SCREEN, _WORD = 1600, 200  # letters of a message, and of a word: files of others may have more
_MANY = 200  # words that are known
# C0 without tab and newline, C1, and what changes the direction of writing
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


class RigidmcError(ValueError):
    """A mistake in what the user gave, whatever it is; the command line ends with exit code 3, see
    `rigidmc.cli.app`.

    The text names file, table, key, value, rule and the nearest right word, and each is an
    attribute.

    Parameters
    ----------
    table : str
        of the scene file, such as "body"; "" if there is none
    key : str
        in the table, or the name of an argument
    value : object
        what was given; None if it is not shown
    rule : str
        what is allowed
    nearest : str, optional
        the nearest right word
    file : str, optional
        in which the mistake is

    Examples
    --------
    >>> try:
    ...     rm.Body.from_moments((1.0, 2.0, -3.0))
    ... except rm.RigidmcError as error:
    ...     error.table, error.key, error.rule
    ('body', 'moments', 'principal moments must be positive')
    """

    def __init__(
        self,
        table: str,
        key: str,
        value: Any,
        rule: str,
        nearest: str | None = None,
        file: str | None = None,
    ) -> None:
        super().__init__(rule)
        self.table, self.key, self.value = table, key, value
        self.rule, self.nearest, self.file = rule, nearest, file

    def __reduce__(self) -> tuple[Any, ...]:  # the workers of a cluster send errors pickled
        return type(self), (self.table, self.key, self.value, self.rule, self.nearest, self.file)

    def __str__(self) -> str:
        file = f"{_cut(self.file)}: " if self.file else ""
        place = f"[{_cut(self.table, _WORD)}] " if self.table else ""
        given = "" if self.value is None else f" = {_short(self.value)}"
        hint = f" (did you mean '{_cut(self.nearest, _WORD)}'?)" if self.nearest else ""
        return shown(f"{file}{place}{_cut(self.key, _WORD)}{given}: {_cut(self.rule)}{hint}")


class SceneError(RigidmcError):
    r"""A scene that cannot be run, or a body or motion that cannot be computed.

    Examples
    --------
    >>> rm.Scene.loads("body.moments = [1, 2, 3]\nstart.omeg = [0, 1, 0]")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.SceneError: scene: [start] omeg: no such key; known: omega, momentum, attitude...
    """


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
    """A file or run directory that cannot be used: no regular file, damaged, or no result.

    Examples
    --------
    >>> rm.open(".")
    Traceback (most recent call last):
    rigidmc.errors.FileError: run = '.': is no run directory: it has no run.json
    """


class OutputExists(FileExistsError):
    """A result would overwrite a file; nothing was written.

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    >>> rm.simulate(scene, output="flips.nc").close()
    >>> rm.simulate(scene, output="flips.nc")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.OutputExists: flips.nc exists; nothing was written...
    """


class NoSuchScene(FileNotFoundError):
    """A word that is the name of no shipped scene, and of no file."""


class NoRoom(OSError):
    """More memory or disk is needed than is free."""


class NoDevice(OSError):
    """No graphics processor that can be used, or one that fails on the way.

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    >>> rm.simulate(scene, device="cuda:999")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    rigidmc.errors.NoDevice: cuda...
    """


class SceneWarning(UserWarning):
    """A scene that runs, but perhaps not as meant.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as notes:
    ...     warnings.simplefilter("always")
    ...     ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, dt=0.3, t_end=1.0)
    >>> print(notes[0].message)
    dt reduced from 0.3 to 0.2 s, which divides t_end and every
    """


def nearest(word: object, words: Iterable[object]) -> str | None:
    """The word of `words` that `word` is another name of, or else the one most like it; None if
    none is like it."""
    from rigidmc.synonyms import NAMES

    # a file may have a million long names: how alike two are takes the product of their lengths
    known = {str(w).lower(): str(w) for w in islice(words, _MANY) if len(str(w)) <= _WORD}
    if len(str(word)) > _WORD:
        return None
    asked = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", str(word)).lower().strip().replace("-", "_")
    for name in NAMES.get(asked.replace(" ", "_"), ()):
        if same := next((known[w] for w in (name, name.replace("_", "")) if w in known), None):
            return same
    # "foo" and "book" are 0.57 alike, "sphere" and "shell" 0.55
    close = difflib.get_close_matches(str(word).lower(), known, n=1, cutoff=0.6)
    return known[close[0]] if close else None


def unknown(
    table: str,
    key: str,
    value: Any,
    kind: str,
    words: Iterable[str],
    error: type[RigidmcError] = SceneError,
) -> RigidmcError:
    """The error for a word that is none of `words`."""
    words = list(words)
    more = f" and {len(words) - _MANY:,} more" if len(words) > _MANY else ""
    rule = f"no such {kind}; known: {', '.join(words[:_MANY])}{more}"
    return error(table, key, value, rule, nearest(value if value is not None else key, words))


def flag(bad: ArrayLike, rule: str, table: str = "", key: str = "input") -> None:
    """Raise SceneError if all elements are bad; warn with their number if some are, because they
    are nan in the result."""
    count, size = int(np.count_nonzero(bad)), np.size(bad)
    if count and count == size:
        every = f"{rule} (all of {count:,} are bad)" if count > 1 else rule
        raise SceneError(table, key, None, every)
    if count:
        some = f"{count:,} of {size:,} elements are nan in the result: {rule}"
        warnings.warn(some, SceneWarning, stacklevel=4)


def shown(text: str) -> str:
    """A text as a terminal may show it: what controls a terminal, or turns the direction of
    writing, is there as an escape. Titles and names come from files of others."""
    return text if text.isascii() and text.isprintable() else _CONTROLS.sub(_escaped, text)


def _escaped(found: re.Match[str]) -> str:
    return found[0].encode("unicode_escape").decode("ascii")


def _short(value: object) -> str:
    # repr of a number of more than 4300 digits is an error of its own
    text = repr(value) if not isinstance(value, int) or abs(value) < 10**80 else "a huge number"
    text = " ".join(text.split())  # a Series shows itself on several lines
    # the end of a path tells which file it is
    return text if len(text) <= 80 else f"{text[:38]}...{text[-39:]}"


def _cut(text: str, most: int = 0) -> str:
    """A text of at most `most` letters, by default a screen: its begin and its end."""
    most = most or _SCREEN
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 3 :]}"

"""Errors for people: what was given, where it stands, what is allowed, and the nearest right word."""

import difflib
import warnings

import numpy as np


class SceneError(ValueError):
    """A scene that cannot be run. Its text names file, table, key, value, rule and the nearest right word."""

    def __init__(self, table, key, value, rule, nearest=None, file=None):
        super().__init__(rule)
        self.table, self.key, self.value, self.rule, self.nearest, self.file = (
            table,
            key,
            value,
            rule,
            nearest,
            file,
        )

    def __reduce__(self):  # from the workers of a cluster
        return type(self), (self.table, self.key, self.value, self.rule, self.nearest, self.file)

    def __str__(self):
        file = f"{self.file}: " if self.file else ""
        place = f"[{self.table}] " if self.table else ""
        given = "" if self.value is None else f" = {_short(self.value)}"
        hint = f" (did you mean '{self.nearest}'?)" if self.nearest else ""
        return f"{file}{place}{self.key}{given}: {self.rule}{hint}"


class OutputExists(FileExistsError):
    """A result would overwrite a file; nothing was written."""


class SceneWarning(UserWarning):
    """A scene that runs, but perhaps not as meant."""


def nearest(word, words):
    """The closest of some words, or None."""
    known = {str(w).lower(): str(w) for w in words}
    close = difflib.get_close_matches(str(word).lower(), known, n=1, cutoff=0.5)
    return known[close[0]] if close else None


def unknown(table, key, value, kind, words):
    """The SceneError for a word that is none of `words`."""
    return SceneError(
        table,
        key,
        value,
        f"no such {kind}; known: {', '.join(words)}",
        nearest(value if value is not None else key, words),
    )


def flag(bad, rule, table="", key="input"):
    """SceneError where all elements are bad, a SceneWarning that counts them where some are; they are nan in the result."""
    count, size = int(np.count_nonzero(bad)), np.size(bad)
    if count and count == size:
        raise SceneError(
            table, key, None, f"{rule} (all of {count:,} are bad)" if count > 1 else rule
        )
    if count:
        warnings.warn(
            f"{count:,} of {size:,} elements are nan in the result: {rule}",
            SceneWarning,
            stacklevel=4,
        )


def _short(value):
    text = repr(value) if not isinstance(value, str) else f"{value!r}"
    return text if len(text) <= 80 else text[:77] + "..."


class NoRoom(OSError):
    """More memory or disk is needed than is free."""

"""The scene that a result carries: its text, and the rows that this text refers to."""

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import FileError

ROWS = (
    10_000_000  # below this many members a selection is spread out to all indices: 80 MB a column
)


def scene_text(dataset: xr.Dataset) -> str:
    """The TOML text of the scene of a result; FileError if the Dataset is no result."""
    text = dataset.attrs.get("scene")
    if not isinstance(text, str):
        rule = "not a result of rigidmc: it has no attribute 'scene' with the text of one"
        raise FileError("", "scene", None, rule, file=dataset.encoding.get("source"))
    return text


def stored_rows(dataset: xr.Dataset, file: str) -> Callable[[str], NDArray[Any] | None]:
    """A function that gives the rows (..., members) of a variable of a result, None if it has none.

    The members may be any selection, in any order: members between them have no rows and need none.
    """

    def stored(name: str) -> NDArray[Any] | None:
        if name not in dataset.variables or dataset[name].dims[-1:] != ("member",):
            return None
        members, rows = _members(dataset, file), dataset[name].values
        if rows.dtype.kind not in "iuf" or "scale_factor" in dataset[name].attrs:
            rule = "has no rows of plain numbers"
            raise FileError("", name, None, rule, file=file)
        count = int(members.max()) + 1
        if count > max(ROWS, 100 * members.size):
            rule = (
                f"has the rows of {members.size:,} members only, up to member {count - 1:,}: "
                "open the whole result"
            )
            raise FileError("", "member", None, rule, file=file)
        whole = np.repeat(rows[..., :1], count, axis=-1)
        whole[..., members] = rows
        return whole

    return stored


def _members(dataset: xr.Dataset, file: str) -> NDArray[Any]:
    """The indices of the members; FileError if a result cannot have them."""
    if "member" not in dataset.variables or dataset.sizes["member"] < 1:
        raise FileError("", "member", None, "a result has at least one", file=file)
    members = dataset["member"].values
    if members.ndim != 1 or members.dtype.kind not in "iu" or members.min() < 0:
        raise FileError("", "member", None, "expected indices of members", file=file)
    refuse_twice(members, file)
    return np.asarray(members)


def refuse_twice(members: NDArray[Any], file: str) -> None:
    """FileError if a result has a member more than once, as two results put together have."""
    known, times = np.unique(members, return_counts=True)
    if (times > 1).any():
        rule = (
            f"has member {known[times > 1][0]} more than once: these are members of several runs"
            " put together; take the result of one run"
        )
        raise FileError("", "member", None, rule, file=file)

"""Checkpoints: arrays in a file, which is ignored unless it is complete and matches its run."""

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import FileError
from rigidmc.files.outputs import Path, write_bytes
from rigidmc.files.reading import bytes_of, json_of

Arrays = Mapping[str, NDArray[Any]]
_MAGIC = b"rigidmc checkpoint 1\n"
_SUM = 32  # bytes of a sha256
_KINDS = "biuf"


def write_checkpoint(path: Path, key: str, arrays: Arrays) -> bool:
    """Write {name: array}, replacing an existing file; False on failure: a run continues without.

    key : identifies the run and the state in the arrays
    """
    about = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    header = json.dumps({"key": key, "arrays": about}).encode() + b"\n"
    parts = [_MAGIC, header, *(np.ascontiguousarray(array).tobytes() for array in arrays.values())]
    data = b"".join(parts)
    with contextlib.suppress(OSError):
        os.makedirs(os.path.dirname(path), exist_ok=True)
        write_bytes(path, data + hashlib.sha256(data).digest(), force=True)
        return True
    return False


def read_checkpoint(path: Path, key: str, most: int) -> dict[str, NDArray[Any]] | None:
    """Read the arrays of a checkpoint; None unless it exists, is complete and has this key.

    most : largest number of bytes of the arrays; a larger file is not read
    """
    try:
        data = memoryview(bytes_of(path, most + 10_000))
    except (OSError, FileError):
        return None
    body, told = data[: -_SUM or None], bytes(data[-_SUM:])
    if hashlib.sha256(body).digest() != told or bytes(body[: len(_MAGIC)]) != _MAGIC:
        return None
    at = bytes(body).find(b"\n", len(_MAGIC)) + 1
    try:
        about = json_of(bytes(body[len(_MAGIC) : at]).decode())
        if about["key"] != key:
            return None
        return _arrays(body[at:], about["arrays"])
    except (ValueError, TypeError, KeyError, OverflowError):  # a checksum proves no author
        return None


def _arrays(data: memoryview, about: list[Any]) -> dict[str, NDArray[Any]]:
    """Read consecutive arrays from memory; ValueError if they do not fit."""
    found, at = dict[str, NDArray[Any]](), 0
    for name, kind, shape in about:
        dtype, sizes = np.dtype(str(kind)), [int(size) for size in shape]
        if dtype.kind not in _KINDS or min(sizes, default=0) < 0:
            raise ValueError(kind)
        count = math.prod(sizes)
        if at + count * dtype.itemsize > len(data):
            raise ValueError(name)
        found[str(name)] = np.frombuffer(data, dtype, count, at).reshape(sizes)
        at += count * dtype.itemsize
    return found

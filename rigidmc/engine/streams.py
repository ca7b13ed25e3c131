"""Counter-based random numbers: a member's draws are a function of (seed, stream, member) alone.

Philox4x64-10 (Salmon et al. 2011) from numpy, key from the seed, counter = [member + 1, draw,
stream, 0]: contiguous members are contiguous counters, so a block of members is one call.
"""

import hashlib
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray


def stream_of(name: str) -> int:
    """Return the stream number of a named quantity.

    Another random quantity in a scene has another stream, and changes no draw of this one.
    """
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little")


@cache
def key_of(seed: int) -> tuple[Any, ...]:
    """Return the two words of a seed's key."""
    return tuple(np.random.SeedSequence(seed).generate_state(2, np.uint64))


def uniforms(seed: int, name: str, first: int, count: int, draw: int = 0) -> NDArray[np.float64]:
    """Return (4, count) independent numbers, uniform in the open interval (0, 1).

    They belong to members first ... first + count - 1.
    """
    counter = np.array([first, draw, stream_of(name), 0], np.uint64)
    raw = np.random.Philox(key=key_of(seed), counter=counter).random_raw(4 * count)
    # 52 bits and a half: with 53 the largest would round to 1, and its normal deviate be infinite
    words = raw.reshape(count, 4).T >> np.uint64(12)
    return np.ascontiguousarray((words.astype(np.float64) + 0.5) * 2.0**-52)

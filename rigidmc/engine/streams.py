"""Counter-based random numbers: a member's draws are a function of (seed, stream, member) and of nothing else.

Philox4x64-10 (Salmon et al. 2011) as numpy has it, key from the seed, counter = [member + 1, draw, stream, 0]: contiguous
members are contiguous counters, so that a block of members is one call.
"""

import hashlib
from functools import cache

import numpy as np


def stream_of(name):
    """The stream number of a named quantity: adding another random quantity to a scene changes no draw of this one."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little")


@cache
def key_of(seed):
    """The two words of a seed's key."""
    return tuple(np.random.SeedSequence(seed).generate_state(2, np.uint64))


def uniforms(seed, name, first, count, draw=0):
    """(4, count) independent numbers, uniform in the open interval (0, 1), for members first ... first + count - 1."""
    # 52 bits and a half: with 53 the largest would round to 1, and a normal deviate would be infinite
    raw = np.random.Philox(
        key=key_of(seed), counter=np.array([first, draw, stream_of(name), 0], np.uint64)
    ).random_raw(4 * count)
    return np.ascontiguousarray(
        ((raw.reshape(count, 4).T >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52
    )

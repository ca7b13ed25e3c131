"""Compiled functions, found by the types of their arguments."""

import gc
import sys
import threading
from typing import Any

import numba
import numpy as np
from numba import njit, typeof

from rigidmc.engine.compile_time import announced
from rigidmc.engine.fused import FLAGS
from rigidmc.engine.machine import cached, is_cached, use_widest_vectors
from rigidmc.engine.numbers import Lanes

config: Any = numba.config
_options: Any = {"nogil": True, **FLAGS}
DEEPEST = (
    5000  # Python's 1000 frames are too few: each plain function that a kernel calls, and each element of a tuple, takes 30 or so
)
use_widest_vectors()


def kind_of(argument):
    """What tells apart whatever `typeof` tells apart, ten times as fast: 9 us a call of the kernel in place of 90."""
    if isinstance(argument, tuple):
        return type(argument), *map(kind_of, argument)
    if isinstance(argument, np.ndarray):
        flags = argument.flags
        return argument.dtype, argument.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable, flags.aligned
    return argument if isinstance(argument, Lanes) else type(argument)


class Compiled:
    """A plain function that is compiled, outside Python's global lock, when it is first called with some types.

    Numba's own call takes tuples of different NamedTuples for one type (its fingerprint of nested tuples leaves the class out), and
    would run the kernel of the first effect it met for every other; `typeof` tells them apart.
    """

    def __init__(self, function, told=""):
        self.function, self.told, self.plain = (
            function,
            told,
            bool(config.DISABLE_JIT),
        )  # told : what to call it before it is compiled
        self.dispatcher: Any = function if config.DISABLE_JIT else cached(njit(**_options)(function))
        self._entries: dict[tuple, Any] = {}
        self._compiling = threading.Lock()

    def is_ready(self, *arguments):
        """Whether nothing has to be compiled for the types of these arguments: the code is in memory or in the disk cache."""
        if config.DISABLE_JIT or tuple(map(kind_of, arguments)) in self._entries:
            return True
        signature = tuple(typeof(a) for a in arguments)
        return signature in self.dispatcher.overloads or is_cached(self.dispatcher, signature)

    def entry(self, *arguments):
        """The machine code for the types of these arguments."""
        if config.DISABLE_JIT:
            return self.function
        key = tuple(map(kind_of, arguments))
        if key not in self._entries:
            with self._compiling:
                signature, deepest, collects = tuple(typeof(a) for a in arguments), sys.getrecursionlimit(), gc.isenabled()
                sys.setrecursionlimit(max(deepest, DEEPEST))
                gc.disable()  # a sixth of the time, for 70 MB
                missing = (self.told,) if self.told and not is_cached(self.dispatcher, signature) else ()
                try:
                    with announced(self.told, missing):
                        self.dispatcher.compile(signature)
                finally:
                    sys.setrecursionlimit(deepest)
                    if collects:
                        gc.enable()
                self._entries[key] = self.dispatcher.overloads[signature].entry_point
        return self._entries[key]

    def __call__(self, *arguments):
        return self.entry(*arguments)(*arguments)

"""Where the members of a run move: on this processor, or on graphics processors.

No bit of a result depends on it.
"""

import contextlib
import re
from collections.abc import Iterator
from contextvars import ContextVar

from rigidmc.engine.cuda_device import chosen
from rigidmc.errors import NoDevice, OptionError, nearest

WORDS = ("cpu", "cuda", "auto")
_NOW = ContextVar("device", default="cpu")


@contextlib.contextmanager
def device(word: str | None) -> Iterator[str]:
    """Let runs and studies in the body of a `with` move their members on a device.

    The device is that of the thread that calls this, and no bit of a result depends on it. With
    CUDA, a thread of a graphics processor takes each member through its steps; the package
    `cuda-bindings` is needed, `pip install 'rigidmc[cuda]'`.

    Parameters
    ----------
    word : str or None
        "cpu", "cuda" for all graphics processors, "cuda:1" for one, "auto" for all of them if there
        are any that can be used, else "cpu"; None for the device that runs take anyway

    Yields
    ------
    str
        "cpu", "cuda" or "cuda:1"

    Raises
    ------
    OptionError
        for another word
    NoDevice
        if there is no such device, or no driver

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    >>> with rm.device("auto"):
    ...     ds = rm.simulate(scene)
    """
    token = _NOW.set(device_now() if word is None else settled_device(word))
    try:
        yield _NOW.get()
    finally:
        _NOW.reset(token)


def use(word: str) -> None:
    """Let all runs and studies from here on move their members on a device, as `device`."""
    _NOW.set(settled_device(word))


def device_now() -> str:
    """The device that runs take now: "cpu", "cuda" or "cuda:1"."""
    return _NOW.get()


def settled_device(word: str) -> str:
    """The device of a word, which has to be there; raises as `device`."""
    if word not in WORDS and not re.fullmatch(r"cuda:\d{1,3}", word):
        rule = "expected cpu, cuda, cuda:NUMBER or auto"
        raise OptionError("", "device", word, rule, nearest(word, WORDS))
    if word == "auto":
        try:
            chosen(None)
        except NoDevice:
            return "cpu"
        return "cuda"
    if word != "cpu":
        chosen(number_of(word))
    return word


def number_of(word: str) -> int | None:
    """The number of the one device of a word, None for all."""
    _, _, number = word.partition(":")
    return int(number) if number else None

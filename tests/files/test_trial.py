"""Whatever interrupts the trial of a file, each later file gets its own verdict.

A sequence of good and bad files of every kind, and an exception at a random instant of some trials:
KeyboardInterrupt, MemoryError and one of the user's own, raised by a signal handler.
"""

import os
import random
import signal
import sys

import netCDF4
import pytest

from rigidmc.errors import FileError
from rigidmc.files import trial
from tests.tools.hostile import CUBE

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


class OwnError(Exception):
    pass


ERRORS = KeyboardInterrupt, MemoryError, OwnError, ValueError


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """{(kind, path): whether it is sound}."""
    folder = tmp_path_factory.mktemp("trial")
    with netCDF4.Dataset(folder / "good.nc", "w") as file:
        file.createDimension("x", 5)
        file.createVariable("a", "f8", ("x",))[:] = 1.0
    (folder / "bad.nc").write_bytes((folder / "good.nc").read_bytes()[:700] + bytes(5000))
    (folder / "good.stl").write_text(CUBE)
    (folder / "slow.stl").write_text(CUBE * 2000)
    (folder / "bad.stl").write_text(CUBE.replace("vertex 1 0 0", "vertex x"))
    return {
        ("netCDF" if name.endswith("nc") else "mesh", str(folder / name)): "bad" not in name
        for name in sorted(os.listdir(folder))
    }


def is_sound(kind, path):
    trial._sound.clear()
    try:
        trial.refuse_unreadable(path, kind)
    except FileError:
        return False
    return True


def follow(files, some, count):
    """Try `count` files, some of them interrupted; return how many raised."""
    raised = 0

    def handler(*_):
        raise some.choice(ERRORS)

    before = signal.signal(signal.SIGALRM, handler)
    try:
        for _ in range(count):
            (kind, path), sound = some.choice(list(files.items()))
            try:
                if some.random() < 0.4:
                    delay = some.choice((0.001, 0.01, 0.1, 0.5)) * some.random()
                    signal.setitimer(signal.ITIMER_REAL, max(1e-6, delay))
                assert is_sound(kind, path) is sound, path
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            except ERRORS:
                raised += 1
            if some.random() < 0.02 and trial._idle:
                trial._idle[0].send_signal(signal.SIGINT)  # as a terminal does on Ctrl-C
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    return raised


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_a_file_after_an_unread_answer_gets_its_own_verdict(files, error, monkeypatch):
    (bad, _), *_ = files.items()
    sound = next(file for file, is_good in files.items() if is_good)
    assert is_sound(*sound)
    with monkeypatch.context() as patch, pytest.raises(error):
        patch.setattr(trial, "_line", lambda helper: (_ for _ in ()).throw(error))
        is_sound(*sound)
    assert not is_sound(*bad)
    assert is_sound(*sound)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a helper dropped
def test_each_file_gets_its_own_verdict_after_many_interrupts(files):
    assert follow(files, random.Random(2), 400) > 80


def test_a_fork_has_its_own_helper(files):
    (bad, _), *_ = files.items()
    child = os.fork()
    if child == 0:
        os._exit(is_sound(*bad))
    assert not is_sound(*bad)
    assert os.waitpid(child, 0)[1] == 0

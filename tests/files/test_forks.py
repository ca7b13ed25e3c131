"""Forks that another thread makes while a file is being written: they hold no lock of it, and
write nothing to it."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks")

# a fork at every call of the library that writes; it lives until the file has been read, and ends
# in the ordinary way (`how` 0), in which the library closes its files, or at once
FORKS = """
import ctypes, os, sys
import numpy as np
import rigidmc as rm
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.create import create
from rigidmc.results import writer
folder, how = sys.argv[1], int(sys.argv[2])
scene = rm.Scene.load("tennis_racket").with_run(members=64, t_end=1.0, every=0.1, save=("omega",))
expected, in_netcdf_thread, forks = rm.simulate(scene).omega.values, writer.in_netcdf_thread, []

def forking(function, *arguments):
    def then_fork():
        function(*arguments)
        done, until = os.pipe()
        pid = os.fork()
        if pid == 0:
            os.close(until)
            for _, other in forks:
                os.close(other)
            os.read(done, 1)
            if how:
                os._exit(0)
            ctypes.CDLL(None).exit(0)
        os.close(done)
        forks.append((pid, until))
    return in_netcdf_thread(then_fork)

writer.in_netcdf_thread = forking
with rm.simulate(scene, output=f"{folder}/one.nc") as made:
    assert np.array_equal(made.omega.values, expected)
directory = create(scene, f"{folder}/run")
resume.resume(directory)
forks_there = len(forks)
resume.resume(f"{folder}/run")  # its lock is free
made = rm.open(f"{folder}/run")
assert np.array_equal(made.omega.values, expected)
for pid, until in forks:
    os.close(until)
    os.waitpid(pid, 0)
for name in ("one.nc", "run"):
    with rm.open(f"{folder}/{name}") as made:
        assert np.array_equal(made.omega.values, expected)
assert forks_there >= 6, forks_there
"""


@pytest.mark.parametrize("how", [0, 1])
def test_forks_do_not_hold_or_change_what_is_written(tmp_path, how):
    words = [sys.executable, "-W", "ignore", "-c", FORKS, tmp_path, str(how)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr[-2000:]

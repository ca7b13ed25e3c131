"""Kernels of a study compiled by two processes at once: each takes 3 s, Numba compiles one at a time, and a study needs up to twenty."""

import json
import subprocess
import sys
import time

from rigidmc.errors import SceneError
from rigidmc.planning.tolerance.pilot import first_steps, follow, pilot
from rigidmc.scene.scene import Scene


def compile_ahead(found, candidates):
    """Compile the kernels of candidates [(integrator, dtype)] for a pilot.

    Once one was not in the cache, a second process compiles from the end of the list and leaves its kernels there.
    """
    helper = None
    try:
        for place, candidate in enumerate(candidates):
            began = time.perf_counter()
            _compile(found, *candidate)
            if helper is None and time.perf_counter() - began > 0.7 and len(candidates) - place > 3:
                helper = _helper(found, candidates[place + 1 :])
    finally:
        if helper is not None:
            helper.kill()
            helper.wait()


def _compile(found, integrator, dtype):
    """The kernel of one candidate at the step where ladders are half way."""
    if integrator == "closed":
        return
    for finer in (1, 8):
        try:
            follow(
                found._replace(block=found.block[:, :32]),
                integrator,
                finer * first_steps(found),
                dtype,
            )
            return
        except SceneError:  # the step is too long for it
            continue


def _helper(found, candidates):
    """The second process; None where a scene cannot be told to it."""
    try:
        text = found.scene.dumps()
        Scene.loads(text)
    except (SceneError, ValueError):  # rows of arrays, effects of the user's own
        return None
    told = json.dumps({"scene": text, "own": found.own, "candidates": candidates})
    words = [
        sys.executable,
        "-c",
        "from rigidmc.planning.tolerance.compile_ahead import main; main()",
    ]
    made = subprocess.Popen(
        words,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert made.stdin is not None
    made.stdin.write(told)
    made.stdin.close()
    return made


def main():
    """What the second process does."""
    told = json.load(sys.stdin)
    found = pilot(Scene.loads(told["scene"]), 32)._replace(own=told["own"])
    for candidate in reversed(told["candidates"]):
        _compile(found, *candidate)

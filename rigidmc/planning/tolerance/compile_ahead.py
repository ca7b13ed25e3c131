"""Kernels of a study compiled by two processes at once: each kernel takes 3 s, Numba compiles one
at a time, and a study needs up to twenty."""

import json
import subprocess
import sys
import time
from collections.abc import Sequence

from rigidmc.errors import SceneError
from rigidmc.files.helpers import start
from rigidmc.planning.tolerance.pilot import Pilot, first_steps, follow, pilot
from rigidmc.scene.scene import Scene

Candidate = tuple[str, str]  # integrator and dtype


def compile_ahead(pilot: Pilot, candidates: Sequence[Candidate]) -> None:
    """Compile the kernels of some candidates for a pilot.

    If a kernel is not in the cache, a second process compiles from the end of the list and leaves
    its kernels there.
    """
    helper = None
    try:
        for place, candidate in enumerate(candidates):
            began = time.perf_counter()
            _compile(pilot, *candidate)
            slow = time.perf_counter() - began > 0.7
            if helper is None and slow and len(candidates) - place > 3:
                helper = _helper(pilot, candidates[place + 1 :])
    finally:
        if helper is not None:
            helper.kill()
            helper.wait()


def _compile(pilot: Pilot, integrator: str, dtype: str) -> None:
    """Compile the kernel of one candidate, at a step in the middle of its ladder."""
    if integrator == "closed":
        return
    few = pilot._replace(block=pilot.block[:, :32])
    for finer in (1, 8):
        try:
            follow(few, integrator, finer * first_steps(pilot), dtype)
            return
        except SceneError:  # the step is too long for it
            continue


def _helper(pilot: Pilot, candidates: Sequence[Candidate]) -> subprocess.Popen[str] | None:
    """The second process; None if the scene cannot be written as text."""
    try:
        text = pilot.scene.dumps()
        Scene.loads(text)
    except (SceneError, ValueError):  # rows of arrays, effects of the user's own
        return None
    task = json.dumps({"scene": text, "own": pilot.member_steps, "candidates": candidates})
    helper = start(__name__, answers=False)
    assert helper.stdin is not None
    helper.stdin.write(task)
    helper.stdin.close()
    return helper


def main() -> None:
    """The second process: compile the candidates that standard input names, the last one first."""
    task = json.load(sys.stdin)
    members = pilot(Scene.loads(task["scene"]), 32)._replace(member_steps=task["own"])
    for candidate in reversed(task["candidates"]):
        _compile(members, *candidate)

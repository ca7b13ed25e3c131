"""Compile the kernels of a search ahead, half of them in a second process.

A search uses up to twenty kernels. Each takes 3 s to compile, and Numba compiles one at a time.
"""

import json
import subprocess
import sys
import time
from collections.abc import Sequence

from rigidmc.errors import SceneError
from rigidmc.planning.tolerance.pilot import Pilot, first_steps, integrate_pilot, part_of, pilot
from rigidmc.processes.helpers import start_helper
from rigidmc.scene.scene import Scene

Precision = tuple[str, str]  # integrator and dtype


def compile_ahead(pilot: Pilot, candidates: Sequence[Precision]) -> None:
    """Compile the kernels of some candidates for a pilot.

    If a kernel is not in the cache, a second process compiles from the end of the list and stores
    its kernels in the cache.
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
    few = part_of(pilot, 32, min(1.0, 100.0 / first_steps(pilot)))
    for finer in (1, 8):
        try:
            integrate_pilot(few, integrator, finer * first_steps(few), dtype)
            return
        except SceneError:  # the step is too long for it
            continue


def _helper(pilot: Pilot, candidates: Sequence[Precision]) -> subprocess.Popen[str] | None:
    """Start the second process; return None if the scene cannot be written as text."""
    try:
        text = pilot.scene.dumps()
        Scene.loads(text)
    except (SceneError, ValueError, TypeError):  # arrays, custom effects, varied parameters
        return None
    task = json.dumps({"scene": text, "own": pilot.member_steps, "candidates": candidates})
    helper = start_helper(__name__, answers=False)
    assert helper.stdin is not None
    helper.stdin.write(task)
    helper.stdin.close()
    return helper


def main() -> None:
    """Compile, as the second process, the candidates listed on standard input, last one first."""
    task = json.load(sys.stdin)
    members = pilot(Scene.loads(task["scene"]), 32)._replace(member_steps=task["own"])
    for candidate in reversed(task["candidates"]):
        _compile(members, *candidate)

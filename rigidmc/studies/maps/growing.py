"""Adaptive maps in run directories: resumed until what is there asks for no more pixels."""

import time
from typing import Any

from rigidmc.errors import OptionError
from rigidmc.runs.resume import grow, resume
from rigidmc.scene.amounts import seconds
from rigidmc.storage.run_directory import RunDirectory
from rigidmc.studies.maps.refine import members_of, refined
from rigidmc.studies.maps.stored import there


def resume_growing(
    directory: RunDirectory,
    max_wall: float | str | None = None,
    only: range | None = None,
    allow_code: bool = False,
    **options: Any,
) -> tuple[RunDirectory, dict[str, int]]:
    """`rigidmc.runs.resume.resume`, of an adaptive map again and again: when all shards are there,
    what they say asks for more members, whose shards come next.

    Raises OptionError for a range of shards of an adaptive map.
    """
    if only is not None and directory.chosen is not None:
        rule = "all shards of an adaptive map must be there before the next are known: leave it out"
        raise OptionError("", "--shards", f"{only.start}:{only.stop}", rule)
    stop = None if max_wall is None else time.monotonic() + seconds(max_wall, "max_wall")
    options |= {"only": only, "allow_code": allow_code}
    directory, flagged = resume(directory, max_wall=max_wall, **options)
    while (level := directory.facts.get("growing")) and not directory.missing().size:
        ready, collected = there(directory, allow_code)
        state = refined(ready.question, collected.pixel_values(), level)
        directory = grow(directory, members_of(ready.question, state.wanted), state.level)
        left = None if stop is None else stop - time.monotonic()
        if not state.level or (left is not None and left <= 0.0):
            break
        directory, more = resume(directory, max_wall=left, **options)
        flagged = {word: count + more[word] for word, count in flagged.items()}
    return directory, flagged

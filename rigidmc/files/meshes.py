"""Mesh files, read by trimesh: nothing but the file itself, in one of the formats of a part."""

import io
import os
from typing import Any

from rigidmc.files.opening import regular

MESHES = (".stl", ".obj", ".ply", ".off")


def loaded(path: str) -> Any:
    """The trimesh.Trimesh of a file; what trimesh raises, and ValueError for another format."""
    import trimesh

    ending = os.path.splitext(path)[1].lower()
    if ending not in MESHES:
        raise ValueError(f"its name ends in none of {', '.join(MESHES)}")
    with open(path, "rb", opener=regular) as file:
        # by the bytes, which have no place: an OBJ file names others, of materials, and trimesh
        # looks for them beside an open file; a pipe of such a name kept it waiting for 20 s
        data = io.BytesIO(file.read())
    return trimesh.load(data, file_type=ending[1:], force="mesh", process=False)

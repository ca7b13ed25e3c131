"""Readers of files that describe a body, behind `Body.read` and `rigidmc body FILE`.

Each returns a `rigid_parts.FoundBody`: mass, centre of mass and the tensor about this centre, in
the axes of a link or drawing, with notes on what was assumed. Files of others execute nothing,
include no other file and have bounded sizes.

`urdf` and `mjcf` read robot descriptions, through `xml_tree`; `cad_text`, `cad_units` and
`cad_signs` read the mass properties that CAD programs show; `mesh_units` guesses the unit of a
mesh, which `rigidmc.mechanics.mesh` reads. To add a format, write a reader, and add its suffix
below.
"""

import os
from collections.abc import Mapping

from rigidmc.errors import FileError, SceneError
from rigidmc.files.kinds import TEXT, XML, another_kind
from rigidmc.files.reading import MESHES, text_of
from rigidmc.scene.body_files.rigid_parts import FoundBody

SUFFIXES = (*XML, *TEXT, *MESHES)


def is_mesh(path: str) -> bool:
    """Return whether the suffix of a path is that of a mesh."""
    return path.lower().endswith(MESHES)


def find_part(path: str, link: str | None, products: str | None, about: str | None) -> FoundBody:
    """Return the body of a file that is not a mesh; see `rigidmc.scene.body_readers`."""
    suffix = os.path.splitext(path)[1].lower()
    if suffix in TEXT:
        from rigidmc.scene.body_files.cad_signs import read_cad_text
        from rigidmc.scene.body_files.cad_text import LARGEST

        refuse_options({"link": link}, "a text of mass properties has none")
        return read_cad_text(text_of(path, LARGEST), products, about, path)
    if suffix not in XML:
        rule = another_kind(path, "body") or f"its name must end in one of {', '.join(SUFFIXES)}"
        raise FileError(rule, at="body file", value=path)
    refuse_options({"products": products, "about": about}, "is for texts of mass properties only")
    from rigidmc.scene.body_files.xml_tree import read_xml

    root = read_xml(path)
    if root.tag == "robot":
        from rigidmc.scene.body_files.urdf import read_urdf

        return read_urdf(root, link, path)
    if root.tag == "mujoco":
        from rigidmc.scene.body_files.mjcf import read_mjcf

        return read_mjcf(root, link, path)
    rule = "expected <robot>, as in URDF, or <mujoco>, as in MJCF"
    if root.tag == "sdf":
        rule = another_kind("model.sdf", "body") or rule
    raise FileError(rule, at="root element", value=root.tag, file=path)


def refuse_options(options: Mapping[str, object], rule: str) -> None:
    """Raise SceneError for an option that a file does not have."""
    for key, value in options.items():
        if value is not None:
            raise SceneError(rule, at=f"body.{key}", value=value)

"""Kinds of files, by their names: what a file is that stands where another kind is expected."""

import os

from rigidmc.files.reading import MESHES

XML = (".urdf", ".xml", ".mjcf", ".xacro")
TEXT = (".txt",)
_KINDS = {
    **dict.fromkeys((*XML, *TEXT, *MESHES), "body"),
    ".sdf": "SDF",
    **dict.fromkeys((".step", ".stp", ".iges", ".igs", ".dae", ".3mf", ".glb"), "CAD"),
    **dict.fromkeys((".csv", ".parquet"), "table"),
    **dict.fromkeys((".nc", ".zarr"), "result"),
    ".toml": "scene",
    **dict.fromkeys((".py", ".ipynb"), "code"),
    **dict.fromkeys((".png", ".pdf", ".svg", ".gif", ".mp4", ".webm", ".html"), "picture"),
}
_RUN = "run it first with `rigidmc run {file} -o RESULT.nc`, or watch it turn with"
_OF_BODY = '`rigidmc body {file}` shows it, and a scene names it under [body]: file = "{file}"'
_TABLE = 'a scene reads a column of it as {{ table = "{file}", column = "NAME" }}'
# {kind: what it is}, and {(kind, wanted kind): what to use}; "" for any other kind
_WHAT = {
    "body": "the file of a body",
    "SDF": "an SDF file, which rigidmc does not read",
    "CAD": "a CAD model, which rigidmc does not read",
    "table": "a table",
    "result": "a result",
    "scene": "a scene",
    "code": "code",
    "picture": "a picture",
}
_USE = {
    ("body", ""): _OF_BODY,
    ("SDF", ""): "convert it to URDF, or give mass, centre and tensor of the link under [body]",
    ("CAD", ""): "export its mass properties as text (.txt), or a mesh (.stl)",
    ("table", ""): _TABLE,
    ("result", "body"): 'rm.Scene.load("{file}").body has its body',
    ("scene", "body"): 'rm.Scene.load("{file}").body has its body',
    ("scene", "result"): f"{_RUN} `rigidmc view {{file}}`",
    ("code", "scene"): "a scene names a class in it by module, see own_parts in the documentation",
}


def another_kind(path: str, wanted: str) -> str | None:
    """Return what a file is, by its suffix, and what to use; None for the wanted kind ("scene",
    "result" or "body") and for unknown suffixes."""
    kind = _KINDS.get(os.path.splitext(path)[1].lower(), wanted)
    if kind == wanted:
        return None
    use = _USE.get((kind, wanted), _USE.get((kind, ""), ""))
    rule = f"is {_WHAT[kind]}, not a {wanted}" if "," not in _WHAT[kind] else f"is {_WHAT[kind]}"
    return f"{rule}: {use.format(file=path)}" if use else rule

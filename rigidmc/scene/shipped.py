"""The scenes that come with the package, in `rigidmc/scene/library`."""

import os
from importlib import resources

from rigidmc.errors import NoSuchScene, nearest
from rigidmc.files.reading import text_of

_FOLDER = resources.files("rigidmc.scene.library")


def shipped() -> list[str]:
    """The names of the shipped scenes."""
    return sorted(p.name[:-5] for p in _FOLDER.iterdir() if p.name.endswith(".toml"))


def read_source(source: str) -> str:
    """The TOML text of a scene file or of a shipped scene; FileNotFoundError with the nearest name
    if there is neither, NoSuchScene if it is no name of a file."""
    if source in shipped():
        return _FOLDER.joinpath(f"{source}.toml").read_text("utf-8")
    if os.path.exists(source):
        return text_of(source)
    names, (folder, name) = shipped(), os.path.split(source)
    if os.path.isdir(folder or os.curdir):
        beside = [file for file in os.listdir(folder or os.curdir) if file.endswith(".toml")]
    else:
        beside = []
    close = nearest(name, beside) or nearest(name.removesuffix(".toml"), names)
    close = os.path.join(folder, close) if close in beside else close
    hint = f" (did you mean '{close}'?)" if close else ""
    # a word like a file's name means a file, which is missing; any other is a wrong word
    is_name = not os.path.splitext(source)[1] and os.path.basename(source) == source
    raise (NoSuchScene if is_name else FileNotFoundError)(
        f"{source}: no such file, and no shipped scene of that name{hint};"
        f" shipped: {', '.join(names)}"
    )

"""The kinds of files that are written, and the endings of their names."""

import importlib.util
import os

from rigidmc.errors import OptionError

KINDS = {  # of what is written, with their endings
    "results": (".nc", ".zarr", ".csv", ".parquet"),
    "netCDF files": (".nc",),
    "pictures": (".png", ".pdf", ".svg"),
    "animations": (".gif", ".mp4", ".webm"),
    "pages": (".html",),
    "tables of bounds": (".csv",),
    "scenes": (".toml",),
}
# {ending: (module that writes it, extra of rigidmc that installs it)}
_NEEDED = {".zarr": ("zarr", "zarr"), ".parquet": ("pyarrow", "table")}


def check_suffix(path: str | os.PathLike[str], kind: str) -> None:
    """Raise OptionError if a file name lacks an ending of its kind, which would belie the content,
    or has one that needs a package which is not installed."""
    suffix, endings = os.path.splitext(path)[1], KINDS[kind]
    if suffix.lower() not in endings:
        more = "; `rigidmc run SCENE -o RUN/` makes a run directory" if kind == "results" else ""
        rule = f"a name for {kind} ends in {', '.join(endings)}, not in '{suffix}'{more}"
        raise OptionError("", "output", os.fspath(path), rule)
    module, extra = _NEEDED.get(suffix.lower(), ("", ""))
    if module and importlib.util.find_spec(module) is None:
        rule = f"needs the package {module}: pip install 'rigidmc[{extra}]'"
        raise OptionError("", "output", os.fspath(path), rule)


def is_zarr(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder that holds a zarr store."""
    return any(os.path.isfile(os.path.join(path, name)) for name in (".zgroup", "zarr.json"))

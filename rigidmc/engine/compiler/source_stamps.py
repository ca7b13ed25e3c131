"""Hashes of the sources that decide a kernel's machine code.

A kernel is decided by the module of its function, by the modules of the classes it is compiled
for, by the compiler, and by what these import. An edit elsewhere, say of a comment in `cli`, leaves
the cached kernels valid.
"""

import functools
import hashlib
import os
import re

from rigidmc.processes.helpers import PACKAGE

_IMPORT = re.compile(
    rb"^[ \t]*(?:from[ \t]+(rigidmc[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)"
    rb"|import[ \t]+(rigidmc[\w.]*))",
    re.M,
)
_NAME = re.compile(r"(\w+)(?:\s+as\s+\w+)?")


@functools.cache
def source_stamp(*modules: str) -> str:
    """Return a hash of the sources of modules of the package and of all that they import."""
    digest = hashlib.sha256()
    for path in closure_of(*modules):
        digest.update(path.encode() + b"\0" + hashlib.sha256(_sources()[path]).digest())
    return digest.hexdigest()[:32]


def closure_of(*modules: str) -> list[str]:
    """Return the files, in the package, of modules and of all that they import, directly or not."""
    paths = list(dict.fromkeys(path for module in modules if (path := _path_of(module))))
    for path in paths:  # grows
        paths.extend(other for other in _imports_of(path) if other not in paths)
    return sorted(paths)


@functools.cache
def _sources() -> dict[str, bytes]:
    """Return {path in the package: source} of all modules.

    All are read at once (5 ms), when the first kernel is asked for: an edit that is made while the
    process runs belongs to no code in its memory.
    """
    sources = {}
    for folder, _, files in os.walk(PACKAGE):
        for name in files:
            if name.endswith(".py"):
                path = os.path.join(folder, name)
                with open(path, "rb") as file:
                    sources[os.path.relpath(path, PACKAGE).replace(os.sep, "/")] = file.read()
    return sources


def _path_of(module: str) -> str | None:
    """Return the file of a module of the package, None for any other name."""
    path = "/".join(module.split(".")[1:])
    places = (f"{path}.py", f"{path}/__init__.py".lstrip("/"))
    return next((place for place in places if place in _sources()), None)


@functools.cache
def _imports_of(path: str) -> list[str]:
    """Return the files of the package that a file imports, anywhere in its text.

    The `__init__.py` of a package counts if a name is imported from it: kernels do not read what
    else Python runs on the way to a module.
    """
    imports = dict[str, None]()
    for home, names, imported in _IMPORT.findall(_sources()[path]):
        module = (home or imported).decode()
        words = _NAME.findall(re.sub(r"#.*", "", names.decode())) if home else [""]
        for word in words:
            if file := _path_of(f"{module}.{word}") or _path_of(module):
                imports[file] = None
    return list(imports)

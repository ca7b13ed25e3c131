"""Commands take no settings from the working directory, which may hold a downloaded result.

Three libraries read files where they are started: matplotlib `matplotlibrc`, which may name a
program to run as ffmpeg; Numba `.numba_config.yaml`, which may change the bits of results; netCDF
`.ncrc`. A pipe of such a name would block each command. The settings in the user's own folders
hold as before.
"""

import os
import sys
from collections.abc import Sequence
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from rigidmc.files.helpers import PACKAGE, environment

_LIBRARIES = {"matplotlib", "numba"}


def keep_apart() -> None:
    """Let the libraries that this process has not imported yet read no settings here."""
    os.environ.update(environment())
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)


class _Finder:
    """Finds the libraries as the other finders do, and wraps their loaders."""

    asked = set[str]()

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name not in _LIBRARIES or name in cls.asked:
            return None
        cls.asked.add(name)
        from importlib.util import find_spec

        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader)  # type: ignore[assignment]  # acts as one
        return spec


class _Loader:
    """The loader of a library, which loads it in the folder of this package."""

    def __init__(self, loader: Loader) -> None:
        self.loader = loader

    def __getattr__(self, name: str) -> Any:
        return getattr(self.loader, name)

    def exec_module(self, module: ModuleType) -> None:
        assert module.__spec__ is not None
        module.__spec__.loader = module.__loader__ = self.loader
        here = os.getcwd()
        os.chdir(PACKAGE)
        try:
            self.loader.exec_module(module)
        finally:
            os.chdir(here)
        if module.__name__ == "numba":
            # Numba looks for its file again whenever it compiles
            module.core.config._config_fname = os.devnull

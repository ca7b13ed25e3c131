"""`ds.rigid` on every Dataset once rigidmc and xarray are both imported, in either order.

Importing rigidmc does not import xarray, which takes 0.4 s.
"""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

ACCESSOR = "rigidmc.views.accessor"
NOTEBOOK = "rigidmc.views.notebook"


class _Finder:
    """Finds xarray once, as the other finders do, and wraps its loader in a `_Loader`."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != "xarray":
            return None
        sys.meta_path.remove(_Finder)
        from importlib.util import find_spec

        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader)  # type: ignore[assignment]  # acts as one
        return spec


class _Loader:
    """The loader of xarray, which registers the accessor after loading."""

    def __init__(self, loader: Loader) -> None:
        self.loader = loader

    def __getattr__(self, name: str) -> Any:
        return getattr(self.loader, name)

    def exec_module(self, module: ModuleType) -> None:
        assert module.__spec__ is not None
        module.__spec__.loader = module.__loader__ = self.loader
        self.loader.exec_module(module)
        import_module(ACCESSOR)


def register() -> None:
    """Register the accessor now if xarray is imported, otherwise as soon as it is; and tell a
    notebook how to show scenes and bodies."""
    if "IPython" in sys.modules:
        shell = sys.modules["IPython"].get_ipython()
        if shell is not None:
            import_module(NOTEBOOK).install(shell)
    if "xarray" in sys.modules:
        import_module(ACCESSOR)
    elif _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)

"""`ds.rigid` on every Dataset once both packages are imported, in either order: importing rigidmc costs no import of xarray (0.4 s)."""

import sys
from importlib import import_module

ACCESSOR = "rigidmc.views.accessor"


class _Finder:
    """Finds xarray as the others do, once, and gives it a loader that registers the accessor too."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name != "xarray":
            return None
        sys.meta_path.remove(_Finder)
        from importlib.util import find_spec

        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader)  # type: ignore[assignment]
        return spec


class _Loader:
    """xarray's own loader, after which the accessor is registered."""

    def __init__(self, own):
        self.own = own

    def __getattr__(self, name):
        return getattr(self.own, name)

    def exec_module(self, module):
        module.__spec__.loader = module.__loader__ = self.own
        self.own.exec_module(module)
        import_module(ACCESSOR)


def register():
    """Register the accessor now where xarray is imported, else when it is."""
    if "xarray" in sys.modules:
        import_module(ACCESSOR)
    elif _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)

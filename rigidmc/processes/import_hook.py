"""A hook that changes how a library loads when it is first imported.

`import rigidmc` takes 20 ms because it does not import xarray, and the command line sets up Numba
and matplotlib only if a command needs them. The hook delays the setup of a library until its
import.
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # imports importlib.resources: half of `import rigidmc`
    from importlib.abc import Loader

Load = Callable[[], None]  # loads the library
_waiting: dict[str, Callable[[ModuleType, Load], None]] = {}  # by the name of a library


def on_import(names: Iterable[str], act: Callable[[ModuleType, Load], None]) -> None:
    """Call act(module, load) once in place of load() when one of these libraries is imported.

    Libraries imported before are left alone.
    """
    _waiting.update({name: act for name in names if name not in sys.modules})
    if _waiting and _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)


class _Finder:
    """Finder of the waiting libraries: asks the other finders and wraps their loaders."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name not in _waiting:
            return None
        act = _waiting.pop(name)
        if not _waiting:
            sys.meta_path.remove(_Finder)
        from importlib.util import find_spec

        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader, act)  # type: ignore[assignment]  # acts as one
        return spec


class _Loader:
    """Loader of a library that delegates loading to `act`."""

    def __init__(self, loader: "Loader", act: Callable[[ModuleType, Load], None]) -> None:
        self.loader, self.act = loader, act

    def __getattr__(self, name: str) -> Any:
        return getattr(self.loader, name)

    def exec_module(self, module: ModuleType) -> None:
        assert module.__spec__ is not None
        module.__spec__.loader = module.__loader__ = self.loader
        self.act(module, lambda: self.loader.exec_module(module))

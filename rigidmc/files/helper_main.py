"""Entry point of a helper process: the interpreter runs this file by its path, see
`rigidmc.processes.helpers`.

Arguments: the module whose `main` to call, then the folders for imports.
"""

import importlib
import importlib.util
import os
import signal
import sys


def main() -> None:
    """Import from the given folders, load this package from this file's folder, and call `main`."""
    # a terminal sends Ctrl-C to all its processes; the starting process decides when a helper ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    module, *folders = sys.argv[1:]
    sys.path[:] = folders
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    # by location, not by sys.path, so that no other folder can pass for this package
    first = os.path.join(package, "__init__.py")
    spec = importlib.util.spec_from_file_location(
        "rigidmc", first, submodule_search_locations=[package]
    )
    assert spec is not None and spec.loader is not None
    sys.modules["rigidmc"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["rigidmc"])
    importlib.import_module(module).main()


if __name__ == "__main__":
    main()

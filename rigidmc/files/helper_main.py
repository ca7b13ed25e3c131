"""Where a helper process begins: the interpreter runs this file by its path, see
`rigidmc.files.processes`.

Arguments: the module whose `main` is called, then the folders that modules are imported from.
"""

import importlib
import importlib.util
import os
import sys


def main() -> None:
    """Take the folders as the path of imports, and this package from where this file is."""
    module, *folders = sys.argv[1:]
    sys.path[:] = folders
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    # by its place and not by the path: no other folder can pass for this package
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

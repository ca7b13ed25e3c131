"""Commands take no settings from the working directory, which may hold a downloaded result.

Three libraries read files where they are started: matplotlib `matplotlibrc`, which may name a
program to run as ffmpeg; Numba `.numba_config.yaml`, which may change the bits of results; netCDF
`.ncrc`. A pipe of such a name would block each command. The settings in the user's own folders
hold as before.
"""

import os
from types import ModuleType

from rigidmc.files.helpers import PACKAGE, environment
from rigidmc.import_hook import Load, on_import


def keep_apart() -> None:
    """Let the libraries that this process has not imported yet read no settings here."""
    os.environ.update(environment())
    on_import(("matplotlib", "numba"), _load)


def _load(module: ModuleType, load: Load) -> None:
    """Load a library in the folder of this package."""
    here = os.getcwd()
    os.chdir(PACKAGE)
    try:
        load()
    finally:
        os.chdir(here)
    if module.__name__ == "numba":
        # Numba looks for its file again whenever it compiles
        module.core.config._config_fname = os.devnull

"""How results are laid out, written and read."""

from rigidmc.files import refuse_existing
from rigidmc.storage.netcdf import Writer, open_result, scene_of, write

__all__ = ["Writer", "open_result", "refuse_existing", "scene_of", "write"]

"""How results are laid out, written and read."""

from rigidmc.files.outputs import refuse_existing
from rigidmc.storage.writer import Writer, encoded, open_result, scene_of, write

__all__ = ["Writer", "encoded", "open_result", "refuse_existing", "scene_of", "write"]

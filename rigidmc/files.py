"""Files that appear whole or not at all."""

import contextlib
import os
import platform
import tempfile

from rigidmc.errors import OutputExists


def refuse_existing(path, force):
    """Raise OutputExists where a result would overwrite a file."""
    if os.path.lexists(path) and not force:
        raise OutputExists(f"{path} exists; nothing was written (use --force, or force=True, to replace it)")
    folder = os.path.dirname(path) or os.curdir
    if not os.path.basename(path) or not os.path.isdir(folder):
        raise FileNotFoundError(f"{folder}: no such folder; nothing was written")
    if os.path.isdir(path):
        raise IsADirectoryError(f"{path}: is a folder; nothing was written")
    try:
        with tempfile.TemporaryFile(dir=folder):  # what os.access says of a folder is not what happens there
            pass
    except OSError as error:
        raise PermissionError(f"{folder}: not writable ({error.strerror}); nothing was written") from None


def put_in_place(temporary, path, force):
    """Make a finished file durable and give it its name; OutputExists, and no file, where one appeared there meanwhile."""
    with open(temporary, "rb") as file:
        os.fsync(file.fileno())
    if not force and os.path.lexists(path):
        os.unlink(temporary)
        raise OutputExists(f"{path} appeared while the run was on; nothing was overwritten")
    os.replace(temporary, path)
    with contextlib.suppress(OSError):  # some file systems cannot sync a folder
        folder = os.open(os.path.dirname(os.path.abspath(path)), os.O_RDONLY)
        os.fsync(folder)
        os.close(folder)


def part_of(path):
    """Where this process writes what is to be a file, before it is whole."""
    return f"{path}.part-{platform.node()}-{os.getpid()}"


def write_text(path, text, force=False):
    """Write a small file whole or not at all."""
    temporary = part_of(path)
    with open(temporary, "w", encoding="utf-8") as file:
        file.write(text)
    put_in_place(temporary, path, force)


def text_of(folder, name):
    """The bytes of a file of a folder, b"" where there is none."""
    path = os.path.join(folder, name)
    if not os.path.isfile(path):
        return b""
    with open(path, "rb") as file:
        return file.read()

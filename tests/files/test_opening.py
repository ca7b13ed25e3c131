"""Links and pipes that others planted: nothing outside is read or changed, and nothing blocks."""

import itertools
import os
import shutil

import pytest

import rigidmc as rm
from rigidmc.errors import FileError
from rigidmc.files import opening, outputs
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.resume import resume
from tests.tools.commands import invoke
from tests.tools.faulty import LINUX, within

pytestmark = LINUX
SCENE = """
[body]
moments = [1.0, 2.0, 2.8]
[start]
omega = [0.0, 1.0, { table = "rows.csv", column = "third" }]
[run]
integrator = "rk4"
dt = 0.01
t_end = 0.1
members = 40
"""
COMMANDS = (
    ["status"], ["verify", "--spot", "1"], ["resume"], ["resume", "--repair"],
    ["consolidate", "-o", "new.nc"], ["summary"], ["show"], ["extend", "--members", "50"],
)  # fmt: skip


NEEDED = ("run.json", "scene.toml", "columns.nc", "shards")


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A run directory with a file of each kind, and the name of its shard."""
    folder = tmp_path_factory.mktemp("good")
    (folder / "rows.csv").write_text("third\n" + "".join(f"{0.1 * i}\n" for i in range(40)))
    (folder / "scene.toml").write_text(SCENE)
    create(rm.Scene.load(folder / "scene.toml"), folder / "run")
    resume(folder / "run")
    return folder / "run"


def names(run):
    shard = next((run / "shards").iterdir()).name
    return ("run.json", "scene.toml", "columns.nc", "lock", "journal.jsonl", f"shards/{shard}",
            "shards", ".part-elsewhere-1-0", "shards/.part-elsewhere-1-0.nc")  # fmt: skip


def content(folder):
    files = (file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


@pytest.mark.parametrize("kind", ["copy", "link", "new", "folder", "pipe", "device"])
def test_what_is_planted_in_a_run_leads_nowhere(good, tmp_path, kind, monkeypatch):
    """A link to what stood there, to a file or a place of the user, to a folder; and a pipe."""
    user = tmp_path / "user"
    shutil.copytree(good, user)  # so that what is read through a link would be accepted
    (user / "thesis").write_text("three years")
    before = content(user)
    commands = itertools.cycle(COMMANDS)
    monkeypatch.chdir(tmp_path)
    codes = []
    for name in names(good):
        words = next(commands)
        shutil.copytree(good, tmp_path / "run")
        place = tmp_path / "run" / name
        if place.is_dir():
            shutil.rmtree(place)
        place.unlink(missing_ok=True)
        if kind == "pipe":
            os.mkfifo(place)
        else:
            same = user / name if (user / name).exists() else user / "thesis"
            where = {"copy": same, "link": user / "thesis", "new": user / "new", "folder": user}
            place.symlink_to(where.get(kind, "/dev/zero"))
        os.utime(place, (0, 0), follow_symlinks=False)
        with within(60.0):
            done = invoke(words[0], "run", *words[1:])
        assert isinstance(done.exception, SystemExit | None), (name, words, done.exception)
        assert "Traceback" not in done.stderr and content(user) == before, (name, words)
        codes.append(done.exit_code)
        shutil.rmtree(tmp_path / "run")
        (tmp_path / "new.nc").unlink(missing_ok=True)
    # a journal that cannot be read, and parts of others, are no reason to fail
    assert set(codes) <= {0, 3, 5, 74} and len([code for code in codes if code]) >= 4, codes
    assert all(code for name, code in zip(names(good), codes, strict=True) if name in NEEDED), codes


def test_planted_parts_are_passed_by(tmp_path):
    """Names of parts can be guessed: a link of the next name was written through."""
    mine = tmp_path / "mine"
    mine.write_text("mine")
    some = outputs.PartialFile(tmp_path / "x.nc")
    some.discard()
    stem, number = some.path.removesuffix(".nc").rsplit("-", 1)
    for i in range(1, 9):
        for end in ("", ".nc"):
            os.symlink(mine, f"{stem}-{int(number) + i}{end}")
    outputs.write_bytes(tmp_path / "x.nc", b"new")
    rm.simulate(rm.Scene.load("nasa_brick"), members=4, t_end=0.1, output=tmp_path / "y.nc").close()
    assert (tmp_path / "x.nc").read_bytes() == b"new" and mine.read_text() == "mine"


def test_abandoned_parts_are_freed_only_if_they_are_files(tmp_path):
    (tmp_path / "mine").write_text("mine")
    parts = [tmp_path / f".part-elsewhere-{i}-0" for i in range(4)]
    parts[0].symlink_to(tmp_path / "mine")
    os.link(tmp_path / "mine", parts[1])
    os.mkfifo(parts[2])
    parts[3].write_text("part")
    for part in parts:
        os.utime(part, (0, 0), follow_symlinks=False)
    with within(10.0), open(parts[3]) as still:
        outputs.clear(str(tmp_path), 3600.0)
        assert still.read() == ""  # the space of what a library has open is free
    assert os.listdir(tmp_path) == ["mine"] and (tmp_path / "mine").read_text() == "mine"


def test_the_openers(tmp_path):
    file, link, pipe = tmp_path / "a" / "file", tmp_path / "link", tmp_path / "pipe"
    file.parent.mkdir()
    file.write_text("text")
    link.symlink_to(file)
    os.mkfifo(pipe)
    (tmp_path / "b").symlink_to(file.parent)

    def text(path, opener, mode="r"):
        with within(5.0), open(path, mode, opener=opener) as opened:
            return opened.read()

    for opener in (opening.open_regular, opening.open_plain, opening.open_below):
        assert text(file, opener) == "text"
        for bad in (pipe, tmp_path / "a", "/dev/zero"):
            for mode in ("r", "a+"):
                with pytest.raises((FileError, IsADirectoryError)):
                    text(bad, opener, mode)
        with pytest.raises(FileNotFoundError, match="none"):
            text(tmp_path / "none", opener)
    assert text(link, opening.open_regular) == "text"
    assert text(tmp_path / "b" / "file", opening.open_plain) == "text"
    for bad, opener in (
        (link, opening.open_plain), (link, opening.open_below),
        (tmp_path / "b" / "file", opening.open_below),
    ):  # fmt: skip
        with pytest.raises(FileError, match="is a link"):
            text(bad, opener)


def test_holes_hold_nothing(tmp_path):
    with open(tmp_path / "a", "wb") as file:
        file.truncate(2**33)
        assert opening.data_bytes(file.fileno()) == 0
        file.seek(2**32)
        file.write(bytes(2**20))
        file.flush()
        assert 2**20 <= opening.data_bytes(file.fileno()) < 2**21
    (tmp_path / "b").write_bytes(bytes(10**6))
    assert opening.data_bytes_at(tmp_path / "b") == 10**6

"""Create a run directory for a scene: scene.toml, columns.nc and run.json, without shards yet."""

import contextlib
import errno
import math
import os
import tempfile
import tomllib
import warnings
import weakref
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.kernel.layout import BLOCK
from rigidmc.engine.machine import this_machine, threads_available
from rigidmc.errors import OptionError, OutputExists, SceneWarning
from rigidmc.files.locks import lock_new, refuse_lockless
from rigidmc.files.opening import refuse_unnamed
from rigidmc.files.outputs import (
    Path,
    content_of,
    folder_beside,
    make_durable,
    refuse_unwritable,
    write_bytes,
)
from rigidmc.files.stores import Store, is_url
from rigidmc.files.user_code import sources_of
from rigidmc.inputs.amounts import read_seconds
from rigidmc.inputs.arrays import Ints
from rigidmc.planning.initial import initial_block, make_sampler
from rigidmc.results.layout import ResultLayout
from rigidmc.results.sinks import Arrays
from rigidmc.results.writer import write_columns
from rigidmc.runs.directory.facts import FORMAT, MOST, facts_text, hash_of, selection_facts
from rigidmc.runs.directory.folder import CHOSEN, RunDirectory, hash_of_file
from rigidmc.runs.directory.load import growth_methods, scene_in
from rigidmc.runs.directory.shards import (
    SHARD,
    TIME,
    memory_of_shards,
    shard_members,
    shorten_shards,
)
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.resources import block_in, check_resources
from rigidmc.scene.quantities import count_rows
from rigidmc.scene.sampling import drawn_through
from rigidmc.scene.scene import Scene


class MemberSelection(NamedTuple):
    """The members with which a run starts; `rigidmc.runs.directory.resume.add_members` adds more.

    members : their indices, in whole shards of `shard` members, a multiple of LANES
    level : level of these members, stored in run.json for the search that chooses the next
    """

    members: Ints
    shard: int
    level: int


def create(
    scene: Scene,
    path: Path,
    size: float | None = None,
    only: range | None = None,
    threads: int | None = None,
    about: Mapping[str, str] = {},
    chosen: MemberSelection | None = None,
    limit: float | None = None,
    device: str | None = None,
    plots: bool = False,
) -> RunDirectory:
    """Create a run directory for a scene.

    size : approximate bytes of a shard, which has at least one block of members; default SHARD
    limit : seconds of one thread for a shard, using a measured rate; default TIME, but no limit if
        `size` or a range of shards is given, so that each machine makes the same shards. The bits
        of members depend on neither
    only : the range of shards that will be computed
    threads : number of threads that will compute, which determines the memory needed
    about : additional attributes of the result
    chosen : the members of the run, if a study chooses them
    device : where the rate is measured, as in `simulate`
    plots : whether few members save enough to plot, as in `simulate`

    Raises OutputExists if the folder contains anything, OptionError if the run has no shard in
    `only`, NoRoom if memory or disk is too small.
    """
    limit = _limit(size, limit, only)
    size = SHARD if size is None else size
    if not isinstance(size, (int, float)) or not 0.0 < size < math.inf:
        raise OptionError("expected the bytes of a shard", at="size", value=size)
    path = free_place(path)
    # fixed now: the strata are the members, and `extend` would move all points that exist
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=scene.run.first + scene.run.members)
    run = prepare_scene(scene, scene.run.members if plots else 0)
    device = resolve_device(device)
    for note in run.notes:
        warnings.warn(note, SceneWarning, stacklevel=2)
    if chosen is not None:
        run = run.with_members(chosen.members)
    block, shard = shard_members(run, size)
    if chosen is not None:
        shard = chosen.shard
        block = block_in(shard, block)
    elif limit < math.inf:
        block, shard = shorten_shards(run, block, shard, limit, device)
    members = run.members.size
    count = -(-members // shard)
    here, disk = path, members
    if is_url(path):  # each shard leaves this disk before the next is written
        here, disk = os.path.join(tempfile.gettempdir(), "shards"), min(shard, members)
    refuse_shards_beyond(only, count)
    refuse_many(count)
    threads = threads or threads_available()
    more = memory_of_shards(run, min(shard, members), block, threads)
    check_resources(run, disk, block, threads, here, more)
    return write_run_files(path, run, shard, block, about, chosen)


def _limit(size: float | None, limit: float | None, only: range | None) -> float:
    """Return the time limit of a shard [s], inf for none; OptionError if `only` excludes it."""
    if limit is None:
        return TIME if size is None and only is None else math.inf
    if only is not None:
        rule = "every task of a job array would measure its own rate: give --shard-size"
        raise OptionError(rule, at="shard_time", value=limit)
    return read_seconds(limit, "shard_time")


def write_run_files(
    path: str,
    run: PreparedRun,
    shard: int,
    block: int,
    about: Mapping[str, str],
    chosen: MemberSelection | None,
) -> RunDirectory:
    """Write the files of a new run at a free place; about, chosen : as in `create`."""
    if chosen is not None and chosen.level and is_url(path):
        rule = "this study adds members to its run, which needs a lock: stores have none"
        raise OptionError(rule, at="output", value=path)
    facts = _facts(run, shard, block, about)
    if chosen is not None:
        facts |= {"first": 0, **selection_facts(chosen.members), "growing": chosen.level}
    with new_directory(path) as folder:
        if chosen is not None:
            write_bytes(os.path.join(folder, CHOSEN), chosen.members.astype("<i8").tobytes())
        _write(folder, run, facts)
        release = (lambda: None) if is_url(path) else lock_new(folder, path)
    directory = RunDirectory(path)
    weakref.finalize(directory, release)
    return directory


def _facts(run: PreparedRun, shard: int, block: int, about: Mapping[str, str]) -> dict[str, Any]:
    """Return the facts for run.json, with the hashes of scene and columns still empty."""
    scene = run.scene
    versions, machine = this_machine(*["scipy"] * bool(drawn_through(scene.model, scene.run)))
    versions |= growth_methods(run.layout.recording)
    sources = [file for part in scene.user_parts for file in sources_of(type(part))]
    return {
        "format": FORMAT,
        "scene": "",
        "columns": "",
        "code": {file: hash_of_file(file) for file in sources},
        **({"contents": run.contents} if run.contents else {}),
        "attributes": {
            # a run opens without the user's code, the only other source of these
            **(_told(run.layout) if sources else {}),
            **({} if run.choice is None else run.choice.attributes()),
            **about,
        },
        "seed": scene.run.seed,
        "first": scene.run.first,
        "members": scene.run.members,
        "shard": shard,
        "block": block,
        "versions": versions,
        "machine": machine,
    }


def _told(layout: ResultLayout) -> dict[str, Any]:
    """Return the attributes of a result except its scene, which scene.toml has."""
    told = layout.attributes()
    return {name: value for name, value in told.items() if name != "scene"}


def _write(folder: str, run: PreparedRun, facts: dict[str, Any]) -> None:
    """Write the files of a new run; run.json comes last, with the hashes of the others."""
    scene, text = run.scene, run.layout.text()
    write_bytes(os.path.join(folder, "scene.toml"), text.encode())
    if (count := count_rows(*scene.model.quantities())) is not None:
        file = os.path.join(folder, "columns.nc")
        write_columns(file, _columns(scene, count))
        facts["columns"] = hash_of_file(file)
    facts["scene"] = hash_of(scene_in(folder, facts, True))
    write_bytes(os.path.join(folder, "run.json"), facts_text(facts).encode())


def _columns(scene: Scene, count: int) -> Arrays:
    """Return {name: rows} of quantities with one row per member, by their names in scene.toml."""

    def stored(value: Any) -> list[str]:
        if isinstance(value, dict):
            if "stored" in value:
                return [value["stored"]]
            value = list(value.values())
        return [name for v in value for name in stored(v)] if isinstance(value, list) else []

    names = sorted(set(stored(tomllib.loads(scene.dumps()))))
    model = scene.model
    drawn = model, make_sampler(model, scene.run)
    pieces = [
        initial_block(*drawn, low, min(BLOCK, count - low))[1] for low in range(0, count, BLOCK)
    ]
    return {name: np.concatenate([piece[name] for piece in pieces], axis=-1) for name in names}


@contextlib.contextmanager
def new_directory(path: str) -> Iterator[str]:
    """Create a folder for a new run, with an empty folder of shards. It is built next to its place
    and moved there when complete, so a killed process leaves nothing under that name.

    In a store, the scene is put first and refused if there is one; run.json, which makes it a run,
    is put last.

    Raises OutputExists if something appeared at that place.
    """
    if is_url(path):
        with tempfile.TemporaryDirectory(prefix="rigidmc-") as folder:
            yield folder
            store = Store(path)
            for name in ("scene.toml", "columns.nc", CHOSEN, "run.json"):
                if data := content_of(folder, name):
                    store.put(name, data, new=name == "scene.toml")
        return
    with folder_beside(path) as folder:
        os.mkdir(os.path.join(folder, "shards"))
        yield folder
        if os.name == "nt":  # Windows cannot move a folder onto another one, even an empty one
            with contextlib.suppress(OSError):
                os.rmdir(path)
        try:
            os.replace(folder, path)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                raise
            raise OutputExists(f"{path} appeared meanwhile; nothing was overwritten") from None
        make_durable(os.path.dirname(os.path.abspath(path)))


def free_place(path: Path) -> str:
    """Return the path of a new run directory; OutputExists if anything is there, OSError if the
    folder cannot be used."""
    path = place_of(path)
    if is_url(path):
        if not is_free(path):
            raise OutputExists(f"{path} exists; nothing was written")
        return path
    refuse_unnamed(path)
    if not is_free(path):
        hint = ""
        if os.path.isfile(os.path.join(path, "run.json")):
            hint = "; `rigidmc resume` continues it"
        raise OutputExists(f"{path} exists; nothing was written{hint}")
    refuse_unusable(path)
    return path


def place_of(path: Path) -> str:
    """Return the path of a new run directory; a link to a folder is resolved to that folder."""
    if is_url(path):
        return os.fspath(path).rstrip("/")
    path = os.path.normpath(os.fspath(path))
    return os.path.realpath(path) if os.path.islink(path) else path


def is_free(path: str) -> bool:
    """Return whether a new run directory may use this path: it is free, or an empty folder."""
    if is_url(path):
        return not Store(path).listed()
    return not os.path.lexists(path) or (os.path.isdir(path) and not os.listdir(path))


def refuse_unusable(path: str) -> None:
    """Raise OSError if the folder of a new run directory is not writable or lacks file locks."""
    folder = os.path.dirname(os.path.abspath(path))
    refuse_unwritable(folder)
    refuse_lockless(folder)


def refuse_many(count: int, what: str = "shards") -> None:
    """Raise OptionError if a run would have too many shards, each of which may be a task."""
    if count > MOST:
        cure = "make them larger" if what == "shards" else "use fewer"
        rule = f"{count:,} {what} are too many, a run has at most {MOST:,}: {cure}"
        raise OptionError(rule, at="shard_size" if what == "shards" else "output")


def refuse_shards_beyond(only: range | None, count: int) -> None:
    """Raise OptionError if a range does not start among the `count` shards of a run."""
    if only is None:
        return
    if not isinstance(only, range) or only.step != 1 or not only or not 0 <= only[0] < count:
        text = f"{only.start}:{only.stop}" if isinstance(only, range) else only
        rule = f"expected a range of shards; the run has 0 to {count - 1}"
        raise OptionError(rule, at="shards", value=text)

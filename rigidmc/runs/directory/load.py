"""Open a run directory: its scene and its plan, checked against the hashes from its start."""

import hashlib
import os
from collections.abc import Callable, Collection
from typing import Any

import tomli_w

from rigidmc.engine.compiler.contents import changes
from rigidmc.engine.cuda.devices import is_gpu
from rigidmc.engine.machine import UNCOMPILED, this_machine
from rigidmc.errors import FileError, SceneError
from rigidmc.files.netcdf import read
from rigidmc.files.opening import open_plain
from rigidmc.files.reading import text_of, toml
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.physics.observables.protocol import Growth
from rigidmc.runs.directory.facts import hash_of
from rigidmc.runs.directory.folder import RunDirectory, hash_of_file
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.resources import block_of_shard
from rigidmc.scene.recording import Recording
from rigidmc.scene.scene import Scene, loads
from rigidmc.scene.user_parts.registry import contents_of_parts
from rigidmc.version import VERSION

STUDY = "study"  # the attribute with the name of a study, then its request as JSON


# how the growth of a small change is found, and how it was before run.json told
GROWTH_METHODS = {"megno": OBSERVABLES["megno"].growth_method}
FORMER_METHODS = {"megno": "neighbour"}


def growth_methods(recording: Recording) -> dict[str, str]:
    """Return the entries of GROWTH_METHODS that concern the results of a run."""
    grows = any(isinstance(monitor, Growth) for _, monitor in recording.monitored)
    return GROWTH_METHODS if grows else {}


def method_of_growth(directory: RunDirectory) -> str:
    """Return how the runs of a directory find the growth of a small change."""
    return str({**FORMER_METHODS, **directory.facts["versions"]}["megno"])


def _saved(directory: RunDirectory) -> Collection[str]:
    """Return the names of what a run saves, without reading its parts."""
    tables = toml(text_of(os.path.join(directory.folder, "scene.toml"), links=False))
    return {*tables.get("run", {}).get("save", ()), *tables.get("observables", {})}


def load_run(directory: RunDirectory, allow_code: bool = False) -> PreparedRun:
    """Return the prepared run of a directory; FileError if its scene was changed."""
    refuse_study(directory)
    run = prepare_scene(scene_of_run(directory, allow_code))
    return run if directory.chosen is None else run.with_members(directory.chosen)


def block_of_run(
    directory: RunDirectory, run: PreparedRun, device: str = "cpu", block: int | None = None
) -> int:
    """Return the members of a block: by default as in run.json, on GPUs a whole shard if it fits.

    Raises SceneError for a block that does not divide the members of a shard.
    """
    facts = directory.facts
    if block is None:
        on_device = is_gpu(device)
        block = block_of_shard(run.layout, facts["shard"]) if on_device else int(facts["block"])
    if facts["shard"] % block:
        rule = f"must divide the {facts['shard']:,} members of a shard"
        raise SceneError(rule, at="run.block", value=block)
    return block


def refuse_study(directory: RunDirectory) -> None:
    """Raise FileError for a run whose shards are tasks of a study, see
    `rigidmc.runs.directory.tasks`."""
    if STUDY in directory.facts["attributes"]:
        name = directory.facts["attributes"][STUDY].partition(" ")[0]
        rule = f"has tasks of a study, not members: `rigidmc {name} {directory.path}` reports it"
        raise FileError(rule, at="run", file=directory.path)


def scene_of_run(directory: RunDirectory, allow_code: bool | None = False) -> Scene:
    """Return the scene of a run; FileError if scene.toml or a Python file of the user has changed
    since the run was started.

    allow_code : as in `rigidmc.scene.scene.loads`
    """
    facts = directory.facts
    if allow_code:
        code: dict[str, str] = facts["code"]
        changed = [
            name
            for name, checksum in code.items()
            if not os.path.isfile(name) or hash_of_file(name) != checksum
        ]
        if changed:
            rule = "is not the file that the run was started with"
            raise FileError(rule, at="code", value=", ".join(changed), file=directory.path)
    scene = scene_in(directory.folder, facts, allow_code)
    stored = facts.get("contents") if facts["versions"]["rigidmc"] == VERSION else None
    if allow_code and stored and (other := changes(stored, contents_of_parts(scene.user_parts))):
        rule = "has changed since the run was started, which its other members were computed with"
        raise FileError(rule, at="code", value=", ".join(other[:5]), file=directory.path)
    checksum = hash_of(scene)
    if checksum != facts["scene"] and scene.body.frame == "principal":
        checksum = _former_hash(scene)
    if allow_code is None:  # placeholders for code have no file that the text could name
        text = text_of_run(directory, members=1, first=0)
        checksum = hashlib.sha256(text.encode()).hexdigest()
    if checksum != facts["scene"]:
        rule = "is not the scene with which the run was started and its shards were computed"
        raise FileError(rule, at="scene.toml", file=directory.path)
    if not facts.get("chosen"):  # scene.toml has the number of members before the run was extended
        scene = scene.with_run(members=facts["members"], first=facts["first"])
    return scene


def text_of_run(directory: RunDirectory, **settings: int) -> str:
    """Return the text of a run's scene with other settings of [run], without checking its parts."""
    tables = toml(text_of(os.path.join(directory.folder, "scene.toml"), links=False))
    tables["run"] = {**tables.get("run", {}), **settings}
    return tomli_w.dumps(tables)


def scene_in(folder: str, facts: dict[str, Any], allow_code: bool | None) -> Scene:
    """Read the scene in a folder, with its rows from columns.nc; `facts` is run.json."""
    stored: Callable[[str], Any] | None = None
    if facts["columns"]:
        file = os.path.join(folder, "columns.nc")
        if not os.path.isfile(file) or hash_of_file(file, open_plain) != facts["columns"]:
            rule = "is missing or was changed: the rows of the members are lost"
            raise FileError(rule, at="columns.nc", file=folder)
        stored = read(file).get
    name = os.path.join(folder, "scene.toml")
    scene: Scene = loads(text_of(name, links=False), name, stored=stored, allow_code=allow_code)
    return scene


def _former_hash(scene: Scene) -> str:
    """Return `hash_of` a scene in principal axes by the text that the first version wrote."""
    tables = toml(scene.with_run(members=1, first=0).dumps())
    body = {key: value for key, value in tables["body"].items() if key != "axes"}
    names = {"principal_axes": "axes"}
    tables["body"] = {names.get(key, key): value for key, value in body.items()}
    return hashlib.sha256(tomli_w.dumps(tables).encode()).hexdigest()


def check_versions(directory: RunDirectory, accept: bool) -> None:
    """Raise FileError if versions on this machine differ from those at the start of the run.

    accept : continue anyway
    """
    stored = directory.facts["versions"]
    versions, _ = this_machine(*["scipy"] * ("scipy" in stored))
    compiled = dict.fromkeys(UNCOMPILED, "yes")
    former = FORMER_METHODS if "megno" in _saved(directory) else {}
    there, here = {**compiled, **former, **stored}, {**compiled, **versions}
    here |= {name: GROWTH_METHODS[name] for name in there.keys() & GROWTH_METHODS.keys()}
    other = [
        f"{name} {there.get(name)} there, {here.get(name)} here"
        for name in {**here, **there}
        if there.get(name) != here.get(name)
    ]
    if other and not accept:
        rule = (
            f"was started with other versions: {'; '.join(other)}. The bits of new members may "
            "differ from the bits of old ones; --accept continues anyway"
        )
        raise FileError(rule, at="run", value=directory.path)

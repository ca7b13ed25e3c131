"""Runs that survive: started in a directory, resumed after whatever ended them, checked, and made one file."""

import math
import os
import time

import numpy as np

from rigidmc.engine.layout import LANES
from rigidmc.engine.machine import threads_available
from rigidmc.errors import OutputExists, SceneError
from rigidmc.observables import rows_of
from rigidmc.planning import BLOCK, SLAB
from rigidmc.sampling import rows
from rigidmc.scene_file import load
from rigidmc.shards import Shards
from rigidmc.simulation import compile_kernel, compute, settled, simulate
from rigidmc.storage import Writer, open_result
from rigidmc.storage.netcdf import read
from rigidmc.storage.run_directory import FORMAT, RunDirectory, damaged, hash_of, rendered, this_machine, write_text
from rigidmc.storage.schema import attributes, coordinates, ensemble_variables, length, member_variables, saved_variables

SHARD = 64 * 2**20  # bytes of a shard: a thousand of them are 67 GB


def create(scene, path, size=SHARD):
    """The RunDirectory of a new run of a scene, in shards of about `size` bytes; OutputExists where there is anything in that folder."""
    path = os.path.normpath(os.fspath(path))
    if os.path.lexists(path) and not (os.path.isdir(path) and not os.listdir(path)):
        hint = "; `rigidmc resume` goes on with it" if os.path.isfile(os.path.join(path, "run.json")) else ""
        raise OutputExists(f"{path} exists; nothing was written{hint}")
    if rows(*scene.quantities()) is not None:
        rule = (
            "a scene with one row per member keeps its rows in its result: write a file, or give them as a table of distributions"
        )
        raise SceneError("run", "output", path, rule)
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=scene.run.first + scene.run.members)
    settled_scene, plan, units, _ = settled(scene, streaming=True)
    told, shown = (settled_scene, plan) if units is None else units.back(settled_scene, plan)
    text = attributes(told, shown)["scene"]
    each = _bytes_of_a_member(told, shown)
    values = 8 * max(1, rows_of(told.effects, *told.recorded())) * shown.times.size
    block = min(BLOCK, max(LANES, SLAB // values // LANES * LANES))
    shard = block * max(1, int(size / each / block))
    versions, machine = this_machine()
    run = told.run
    facts = {
        "format": FORMAT, "scene": "", "seed": run.seed, "first": run.first, "members": run.members, "shard": shard, "block": block,
        "versions": versions, "machine": machine,
    }  # fmt: skip
    os.makedirs(os.path.join(path, "shards"), exist_ok=True)
    write_text(os.path.join(path, "scene.toml"), text)
    facts["scene"] = hash_of(load(os.path.join(path, "scene.toml")))
    write_text(os.path.join(path, "run.json"), rendered(facts))  # last: what has it is a run
    return RunDirectory(path)


def _bytes_of_a_member(scene, plan):
    variables = {**member_variables(scene, plan.carried), **saved_variables(scene)}
    return sum(
        np.prod([1 if d == "member" else length(d, plan) for d in v.dims]) * np.dtype(v.dtype).itemsize for v in variables.values()
    )


def scene_of_run(directory, allow_code=False):
    """The scene of a run; SceneError where scene.toml is no longer the one that it was started with."""
    scene = load(os.path.join(directory.path, "scene.toml"), allow_code=allow_code)
    if hash_of(scene) != directory.facts["scene"]:
        rule = "is not the scene that the run was started with; what is there was computed with that"
        raise SceneError("", "scene.toml", None, rule, file=directory.path)
    facts = directory.facts
    return scene.with_run(members=facts["members"], first=facts["first"])


def resume(path, threads=None, progress=False, accept=False, max_wall=None, only=None, block=None, allow_code=False):
    """Compute the shards of a run that are missing; (RunDirectory, {status: members} of what was computed).

    accept : go on though versions or processor are others, whose last bits may differ
    max_wall : seconds after which no further shard is begun that would not be done by then
    only : a range of shards, of a job array whose directories are one;  block : members computed at once; nothing depends on it
    Raises SceneError for what is no run or no longer the same, OutputExists where another process writes.
    """
    directory = path if isinstance(path, RunDirectory) else RunDirectory(path)
    scene = scene_of_run(directory, allow_code)
    if not accept and (other := directory.differs()):
        rule = f"was started with others: {'; '.join(other)}. Bits of new members may differ from those of old ones; --accept takes that"
        raise SceneError("", "run", directory.path, rule)
    with directory.locked():
        began = time.monotonic()
        missing = [i for i in directory.missing() if only is None or i in only]
        scene, plan, units, _ = settled(scene, threads or 1, True, block or directory.facts["block"])
        if directory.facts["shard"] % plan.block:
            raise SceneError("run", "block", plan.block, f"has to divide the {directory.facts['shard']:,} members of a shard")
        told, shown = (scene, plan) if units is None else units.back(scene, plan)
        compiled = compile_kernel(scene, plan)
        started = time.monotonic()
        directory.note(event="begun", shards=len(missing), threads=threads, compile_seconds=round(compiled, 3))
        each, count = directory.facts["shard"] // plan.block, math.ceil(plan.members / plan.block)
        made = 0

        def blocks():
            nonlocal made
            for i in missing:
                took = (time.monotonic() - started) / made if made else 0.0
                if max_wall is not None and time.monotonic() - began + took > max_wall:
                    return
                yield from range(i * each, min((i + 1) * each, count))
                made += 1

        sink = Shards(directory, told, shown)
        try:
            flagged = compute(
                scene,
                plan,
                threads or threads_available(),
                sink,
                progress,
                units,
                blocks(),
                sum(map(len, map(directory.members, missing))),
            )
            sink.finish()
        except BaseException as error:
            sink.discard()
            directory.note(event="stopped", reason=type(error).__name__, seconds=round(time.monotonic() - started, 3))
            raise
        left = len(directory.missing())
        directory.note(
            event="ended", left=left, members=sum(flagged.values()), flagged=flagged, seconds=round(time.monotonic() - started, 3)
        )
    return directory, flagged


def extend(path, members):
    """Give a run more members; those that are there stay, but for the last shard where that was no whole one. The RunDirectory, to be resumed."""
    directory = RunDirectory(path)
    facts = directory.facts
    if members <= facts["members"]:
        raise SceneError("run", "members", members, f"the run has {facts['members']:,} already")
    if scene_of_run(directory).run.points == "latin_hypercube":
        raise SceneError("run", "members", members, "a Latin hypercube has as many members as strata: start a new run")
    with directory.locked():
        last = directory.count - 1
        if facts["members"] % facts["shard"] and last in directory.done():
            os.unlink(directory.shards()[last])
        write_text(os.path.join(directory.path, "run.json"), rendered({**facts, "members": int(members)}), force=True)
        directory.note(event="extended", members=int(members))
    return RunDirectory(path)


def status(path):
    """What of a run is done, by the names of its shards alone: {"shards", "done", "members", "members_done", "flagged", "rate", "seconds_left"}."""
    directory = RunDirectory(path)
    done = directory.done()
    members = sum(len(directory.members(i)) for i in done)
    ended = [line for line in directory.journal() if line.get("event") == "ended" and line.get("seconds")]
    rate = sum(line["members"] for line in ended) / sum(line["seconds"] for line in ended) if ended else None
    flagged: dict[str, int] = {}
    for line in ended:
        for word, count in line.get("flagged", {}).items():
            flagged[word] = flagged.get(word, 0) + count
    left = directory.facts["members"] - members
    return {
        "shards": directory.count, "done": len(done), "members": directory.facts["members"], "members_done": members,
        "flagged": flagged, "rate": rate, "seconds_left": left / rate if rate else None,
    }  # fmt: skip


def verify(path, spot=3, allow_code=False, threads=None):
    """What is wrong with a run, in words, [] for nothing: the sum of every shard, the scene, and `spot` members of each of as many shards
    computed again, to the bit."""
    directory = RunDirectory(path)
    scene = scene_of_run(directory, allow_code)
    shards = directory.shards()
    bad = {i for i, shard in shards.items() if damaged(shard)}
    found = [f"{shards[i]}: is not what was written: its sum is not that of its name" for i in sorted(bad)]
    whole = sorted(set(shards) - bad)
    for i in whole[:: max(1, len(whole) // max(1, spot))][:spot]:
        members = directory.members(i)
        for member in {members[0], members[len(members) // 2], members[-1]}:
            found += _unlike(scene, shards[i], member, threads)
    return found


def _unlike(scene, path, member, threads):
    """What of a member differs from what it is computed again."""
    again = simulate(scene, members=range(member, member + 1), threads=threads)
    kept = read(path)
    at = (kept["member"] == member).argmax()
    each = [name for name in again.data_vars if "member" in again[name].dims]
    wrong = [name for name in each if name not in kept or again[name].values.tobytes() != kept[name][..., [at]].tobytes()]
    return [f"{path}: member {member} is not what it is computed again: {', '.join(map(str, wrong))}"] if wrong else []


def repair(path):
    """Take away the shards that are damaged, to be computed again; how many there were."""
    directory = RunDirectory(path)
    with directory.locked():
        bad = [path for path in directory.shards().values() if damaged(path)]
        for path in bad:
            os.unlink(path)
        directory.note(event="repaired", shards=[os.path.basename(path) for path in bad])
    return len(bad)


def consolidate(path, output, force=False, allow_code=False):
    """Write a whole run as one file, the same as a run of that size to a file would be; SceneError where shards are missing."""
    directory = RunDirectory(path)
    scene = scene_of_run(directory, allow_code)
    if missing := directory.missing():
        raise SceneError("", "run", directory.path, f"{len(missing):,} of {directory.count:,} shards are missing: resume it first")
    settled_scene, plan, units, _ = settled(scene, 1, True, directory.facts["block"])
    told, shown = (settled_scene, plan) if units is None else units.back(settled_scene, plan)
    writer, sums = Writer(os.fspath(output), told, shown, force), dict[str, np.ndarray]()
    shards = directory.shards()
    kept = [*member_variables(told, plan.carried), *saved_variables(told)]
    counted = list(ensemble_variables(told))
    try:
        for i in range(directory.count):
            members = directory.members(i)
            writer.write(members.start, len(members), read(shards[i], *kept))
            for name, values in (read(shards[i], *counted) if counted else {}).items():
                sums[name] = sums.get(name, 0) + values
        writer.write_all(sums)
        writer.finish()
    except BaseException:
        writer.discard()
        raise
    return open_result(os.fspath(output))


def open_run(path, allow_code=False):
    """A run as one Dataset of the members that are there, read from the shards when they are asked for: no file is opened now.

    Needs dask, which comes with rigidmc[cluster]; without it `consolidate` makes one file. Histograms are sums over the shards.
    """
    import xarray as xr

    try:
        import dask.array
    except ImportError as error:
        raise SceneError(
            "", "run", os.fspath(path), f"is read through dask: pip install 'rigidmc[cluster]', or consolidate it ({error})"
        ) from None
    directory = RunDirectory(path)
    scene, plan, units, _ = settled(scene_of_run(directory, allow_code), 1, True, directory.facts["block"])
    told, shown = (scene, plan) if units is None else units.back(scene, plan)
    shards = directory.shards()
    done = sorted(shards)
    counts = [len(directory.members(i)) for i in done]
    variables = {}
    for name, (dims, dtype, attrs) in {**member_variables(told, plan.carried), **saved_variables(told)}.items():
        sizes = [counts if d == "member" else [length(d, shown)] for d in dims]
        at = dims.index("member")
        graph = {
            (f"{name}-{directory.path}", *[0] * at, j, *[0] * (len(dims) - at - 1)): (_read, shards[i], name)
            for j, i in enumerate(done)
        }
        variables[name] = (
            dims,
            dask.array.Array(graph, f"{name}-{directory.path}", tuple(map(tuple, sizes)), np.dtype(dtype)),
            attrs,
        )
    for name, (dims, dtype, attrs) in ensemble_variables(told).items():
        size = [length(d, shown) for d in dims]
        parts = [dask.array.from_delayed(dask.delayed(_read)(shards[i], name), size, np.dtype(dtype)) for i in done]
        variables[name] = dims, sum(parts), attrs
    members = np.concatenate([np.asarray(directory.members(i)) for i in done]) if done else np.empty(0, int)
    known = {
        name: ((dims, members, attrs) if name == "member" else (dims, values, attrs))
        for name, (dims, values, attrs) in coordinates(shown).items()
    }
    return xr.Dataset(variables, known, attributes(told, shown))


def _read(path, name):
    """A variable of a shard."""
    return read(path, name)[name]

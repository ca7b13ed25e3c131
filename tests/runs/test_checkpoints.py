"""Runs that are cut at any moment go on from where they were, to the same bytes."""

import hashlib
import json
import os
import shutil
import threading

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine import program
from rigidmc.runs.directory import checkpoints, resume, shards
from rigidmc.runs.directory.checkpoints import Checkpoints, read_checkpoint, write_checkpoint
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.directory.shards import ShardSink
from tests.runs.test_resume import SIZE, changed
from tests.tools.scenes import FREE as SCENE
from tests.tools.scenes import WITH_HISTOGRAM
from tests.tools.torture import sums

STEPS = 8  # of a call, after each of which blocks are kept


def started(scene, path, block=32, shard=192):
    create(scene.with_run(members=448), path, SIZE)
    changed(path, block=block, shard=shard)
    return path


@pytest.fixture
def often(monkeypatch):
    """Everything is kept whenever it can be."""
    monkeypatch.setattr(checkpoints, "EVERY", 0.0)
    monkeypatch.setattr(checkpoints, "COSTS", 0.0)
    monkeypatch.setattr(program, "CALL", 32 * STEPS)
    monkeypatch.setattr(os, "fsync", lambda file: None)  # no power is lost here


class Made:
    """Counts the member-steps that are made, and keeps what a kill would leave after some calls."""

    def __init__(self, monkeypatch, path, every):
        self.steps, self.calls, self.copies, self.every = 0, 0, [], every
        advance, keep = program.Program.advance, Checkpoints.keep

        def counting(this, block, steps, *more):
            self.steps += block.shape[1] * (steps.last - steps.first)
            return advance(this, block, steps, *more)

        alone = threading.RLock()  # a copy takes a while, in which no other thread may write

        def exclusive(kind, name):
            function = getattr(kind, name)

            def called(*arguments):
                with alone:
                    return function(*arguments)

            monkeypatch.setattr(kind, name, called)

        def copying(this, job):
            keep(this, job)
            self.calls += 1
            if self.every and self.calls % self.every == 0:
                self.copies.append(path.with_name(f"{path.name}{self.calls}"))
                shutil.copytree(path, self.copies[-1], ignore_dangling_symlinks=True)

        monkeypatch.setattr(program.Program, "advance", counting)
        monkeypatch.setattr(Checkpoints, "keep", copying)
        for kind, name in (
            (Checkpoints, "keep"),
            (Checkpoints, "keep_shard"),
            (ShardSink, "_write"),
        ):
            exclusive(kind, name)


KINDS = {
    "saves": {},
    "kept": {
        "save": WITH_HISTOGRAM,
        "keep": {"omega": "thinned", "energy": "final"},
        "thin": 2,
        "turn_limit": 0.051,  # a third of the members is flagged
    },
    "steps of their own": {"turn": 0.05, "dt": None},
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_goes_on_from_where_it_was_cut(kind, tmp_path, monkeypatch, often):
    scene = SCENE.with_run(**KINDS[kind])
    whole = started(scene, tmp_path / "whole")
    made = Made(monkeypatch, whole, 7)
    resume.resume(whole, threads=1)
    all_steps, cuts, made.every = made.steps, made.copies, 0
    assert len(cuts) >= 5 and not (whole / "unfinished").exists()
    for cut in cuts:
        assert len(os.listdir(cut / "unfinished")) >= 1
        done = len(RunDirectory(cut).shards())
        made.steps, seen = 0, list[int]()
        resume.resume(cut, threads=1, progress=lambda *of: seen.append(of))  # noqa: B023
        assert sums(cut) == sums(whole) and not (cut / "unfinished").exists()
        assert seen[-1][0] == seen[-1][1]
        # without checkpoints the steps of all missing shards are made: 192, 192 and 64 members
        assert made.steps <= all_steps * (1.0 - 192 * done / 448) - 32 * STEPS
        shutil.rmtree(cut)


def test_a_checkpoint_that_is_not_whole_or_of_another_run_is_ignored(tmp_path, monkeypatch, often):
    whole = started(SCENE, tmp_path / "whole")
    made = Made(monkeypatch, whole, 12)
    resume.resume(whole, threads=1)
    cut, made.every = made.copies[0], 0
    other = started(SCENE.with_run(seed=5), tmp_path / "other")
    made = Made(monkeypatch, other, 12)
    resume.resume(other, threads=1)
    names = os.listdir(cut / "unfinished")
    assert any("-" in name for name in names)  # and mostly the results of a shard
    spoil = {
        "cut": lambda data: data[: len(data) // 2],
        "a bit": lambda data: data[:300] + bytes([data[300] ^ 1]) + data[301:],
        "the end": lambda data: data[:-1] + bytes([data[-1] ^ 1]),
        "empty": lambda data: b"",
        "longer": lambda data: data + bytes(10**6),
    }
    for word, spoilt in spoil.items():
        path = tmp_path / word
        shutil.copytree(cut, path)
        for name in names:
            data = (path / "unfinished" / name).read_bytes()
            (path / "unfinished" / name).write_bytes(spoilt(data))
        resume.resume(path, threads=2)
        assert sums(path) == sums(whole), word
    shutil.rmtree(cut / "unfinished")
    shutil.copytree(made.copies[0] / "unfinished", cut / "unfinished")
    resume.resume(cut, block=96)
    assert sums(cut) == sums(whole)


def test_a_checkpoint_asks_for_no_more_than_it_has(tmp_path):
    """A sum is no proof of the author: a file from elsewhere may say anything."""
    path, rows = tmp_path / "one", {"x": np.arange(6.0).reshape(2, 3), "n": np.array(4)}
    assert write_checkpoint(path, "a", rows)
    found = read_checkpoint(path, "a", 10**4)
    assert all(np.array_equal(found[name], rows[name]) for name in rows)
    assert read_checkpoint(path, "b", 10**4) is None
    assert read_checkpoint(tmp_path / "none", "a", 10**4) is None
    for about in (
        [["x", "<f8", [10**12]]], [["x", "<f8", [-1, -6]]], [["x", "|O", [1]]], [["x", "<f8"]], 5,
        [["x", "nonsense", [1]]], [["x", "<U9", [1]]], [["x", "<f8", ["a"]]],
        [[[], "<f8", [10**400]]],
    ):  # fmt: skip
        (tmp_path / "bad").write_bytes(b"")
        forged(tmp_path / "bad", {"key": "a", "arrays": about})
        assert read_checkpoint(tmp_path / "bad", "a", 10**4) is None, about
    for header in ([], {"key": "a"}, None, {"arrays": []}):
        forged(tmp_path / "bad", header)
        assert read_checkpoint(tmp_path / "bad", "a", 10**4) is None, header
    os.truncate(path, 10**11)  # sparse
    assert read_checkpoint(path, "a", 10**4) is None
    (tmp_path / "link").symlink_to(path)
    os.mkfifo(tmp_path / "pipe")
    assert read_checkpoint(tmp_path / "pipe", "a", 10**4) is None
    (tmp_path / "file").write_text("")
    assert not write_checkpoint(tmp_path / "file" / "one", "a", rows)


def test_a_state_that_cannot_be_is_not_gone_on_from(tmp_path, monkeypatch, often):
    """Compiled code trusts the numbers of a state: a step before the first would be a place in
    memory before the saves."""
    whole = started(SCENE, tmp_path / "whole")
    made, keyed = Made(monkeypatch, whole, 12), {}
    write = checkpoints.write_checkpoint

    def noting(path, key, arrays):
        keyed[os.path.basename(path)] = key
        return write(path, key, arrays)

    monkeypatch.setattr(checkpoints, "write_checkpoint", noting)
    resume.resume(whole, threads=1)
    made.every = 0
    for cut in made.copies:  # the first with a shard and a block: threads decide which has both
        there = sorted(os.listdir(cut / "unfinished"))
        names = [next((n for n in there if ("-" in n) == is_block), None) for is_block in (0, 1)]
        if None not in names:
            break
    assert None not in names
    shard, block = (read_checkpoint(cut / "unfinished" / n, keyed[n], 10**8) for n in names)
    assert shard is not None and block is not None
    spoilt = [{**shard, "blocks": np.arange(6)}, dict(list(shard.items())[1:])]
    spoilt += [{**block, "done": np.array(x)} for x in (-(10**6), 40, 0.5)]
    spoilt += [{**block, "out": block["out"][:-1]}, {"done": block["done"]}]
    for i, bad in enumerate(spoilt):
        path, name = tmp_path / f"{i}", names["done" in bad]
        shutil.copytree(cut, path)
        write(path / "unfinished" / name, keyed[name], bad)
        resume.resume(path, threads=1)
        assert sums(path) == sums(whole), i


def forged(path, header):
    """A checkpoint with any header, and the sum that belongs to it."""
    data = b"rigidmc checkpoint 1\n" + json.dumps(header).encode() + b"\n" + bytes(48)
    path.write_bytes(data + hashlib.sha256(data).digest())


def test_a_link_in_place_of_the_checkpoints_is_refused(tmp_path):
    path = started(SCENE, tmp_path / "run")
    (tmp_path / "mine").mkdir()
    (path / "unfinished").symlink_to(tmp_path / "mine")
    with pytest.raises(rm.FileError, match=r"unfinished.*is a link"):
        resume.resume(path)


def test_shards_take_so_long_at_most_where_that_is_measured(tmp_path, monkeypatch):
    """By size alone shards are the same on every machine; by time they follow from its rate, and
    the bits of members from neither."""
    scene, rates = SCENE.with_run(members=200_000, t_end=4000.0, every=4000.0), iter(range(10**6))
    monkeypatch.setattr(shards, "cost_per_step", lambda *of: (next(rates), 50.0)[1])

    def made(name, *sizes, **more):
        run, seen = scene.with_run(**more.pop("run", {})), next(rates)
        facts = create(run, tmp_path / name, *sizes, **more).facts
        return facts["block"], facts["shard"], next(rates) - seen > 1

    # 80,000 steps of 50 ns are 4 ms of each member, and 120 s are 30,000 members: 4 blocks
    block, shard, measured = made("plain")
    assert (block, shard, measured) == (4064, 16256, True)
    assert shard * 4e-3 < 120.0 < 2 * shard * 4e-3
    assert made("by size", 64 * 2**20)[1:] == (made("as a task", None, range(1))[1], False)
    assert made("short", run={"t_end": 4.0, "every": 4.0})[1:] == (
        made("also", 64 * 2**20)[1],
        False,
    )
    assert made("brief", limit=1.0)[:2] == (128, 128)  # of 250 members
    assert made("briefer", limit=0.01)[:2] == (32, 32)
    assert made("both", 1e6, limit=1e6)[1] == made("one", 1e6)[1]
    assert made("many", limit=1e-9)[:2] == (32, 32)  # 100,000 shards at most, and these are 6,250
    monkeypatch.setattr(shards, "cost_per_step", lambda *of: 53.0)
    assert made("a little slower")[:2] == (4064, 16256)
    with pytest.raises(rm.OptionError, match="every task of a job array would measure"):
        made("task", None, range(1), limit=1.0)
    for bad in (0.0, -1.0, "soon", float("nan")):
        with pytest.raises(rm.OptionError, match="shard_time"):
            made("bad", limit=bad)


def test_bits_do_not_depend_on_the_shards(tmp_path, monkeypatch):
    whole = rm.simulate(SCENE)
    monkeypatch.setattr(shards, "SLOW", 1.0)
    monkeypatch.setattr(shards, "cost_per_step", lambda *of: 1e6)
    for name, limit in (("few", 4.0), ("many", 20.0)):
        resume.resume(create(SCENE, tmp_path / name, limit=limit))
        made = rm.open(tmp_path / name)
        assert RunDirectory(tmp_path / name).count == {"few": 16, "many": 4}[name]
        for variable in whole.data_vars:
            assert np.array_equal(made[variable].values, whole[variable].values, equal_nan=True)

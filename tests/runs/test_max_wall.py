"""A run, a map or a study that is cut by a time limit keeps what it has and goes on from there."""

import math
import threading

import pytest

from rigidmc.engine import program, threads
from rigidmc.runs import price, segments
from rigidmc.runs.directory import folder as run_directory
from rigidmc.runs.directory import tasks
from tests.tools.commands import invoke
from tests.tools.scenes import FREE as SCENE
from tests.tools.torture import sums


class Clock:
    """A time limit that comes after so many calls of the engine, in place of the clock."""

    def __init__(self, monkeypatch):
        self.limit, self.calls, self.noticed = 10**9, 0, threading.Event()
        self.cuts = True  # blocks, not tasks
        self.rehearses = False  # no limit holds for what a price measures, as long as it likes
        advance, rehearsed = program.Program.advance, price._studied

        def advancing(this, *arguments):
            self.calls += self.cuts and not self.rehearses
            # it is noticed five times a second
            if self.calls > self.limit and self.cuts and not self.rehearses:
                self.noticed.wait(5.0)
            return advance(this, *arguments)

        def rehearsing(*arguments):
            self.rehearses = True
            try:
                return rehearsed(*arguments)
            finally:
                self.rehearses = False

        monkeypatch.setattr(price, "_studied", rehearsing)
        monkeypatch.setattr(program.Program, "advance", advancing)
        monkeypatch.setattr(program, "CALL", 1000)  # a wide block goes a step at a time
        for module in (threads, tasks):
            monkeypatch.setattr(module, "is_late", self.is_late)
        monkeypatch.setattr(segments, "end_of_work", lambda: 0.0 if self.is_late() else math.inf)

    def of_parts(self, monkeypatch):
        """Count the parts of tasks in place of calls, of which their price takes some."""
        self.cuts, moved = False, segments.SegmentedRun.moved

        def moving_on(this, *arguments):
            self.calls += 1
            return moved(this, *arguments)

        monkeypatch.setattr(segments.SegmentedRun, "moved", moving_on)
        monkeypatch.setattr(program, "CALL", 3_000_000)

    def begin(self, limit):
        self.limit, self.calls = limit, 0
        self.noticed.clear()

    def is_late(self):
        if self.calls <= self.limit or self.rehearses:
            return False
        self.noticed.set()
        return True


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("wall") / "scene.toml"
    path.write_text(SCENE.with_run(members=9000).dumps())
    return str(path)


SIDES = ["--x", "start.omega.2=0.9:1.1", "--y", "body.moments.1=1.0:1.5", "--of", "p(flips >= 1)"]
KINDS = {
    "run": ["run", "SCENE", "--shard-size", "0.5"],
    "a run of one shard": ["run", "SCENE"],
    "map": ["map", "SCENE", *SIDES, "--resolution", "60", "--members", "2"],
    "adaptive": ["map", "sleeping_top", "--resolution", "64", "--members", "2", "--adaptive"],
    "section": ["section", "SCENE", "--at", "omega[1] = 0", "--members", "9000"],
    "rare": ["rare", "heavy_top", "--of", "p(nutation_max >= 0.75)", "--repetitions", "4",
             "--set", "run.t_end=2",
             "--set", "start.attitude=[0.0, { normal = [0.4, 0.05] }, 0.0]", "--members", "64"],
}  # fmt: skip


SELDOM = "adaptive", "section"  # 5 and 2 s; what cuts them cuts maps and runs


@pytest.mark.parametrize(
    "kind", [pytest.param(one, marks=pytest.mark.slow) if one in SELDOM else one for one in KINDS]
)
def test_a_time_limit_holds_and_loses_nothing(kind, scene, tmp_path, clock, monkeypatch):
    words = [word.replace("SCENE", scene) for word in KINDS[kind]]
    whole, path = tmp_path / "whole", tmp_path / "run"
    if kind == "rare":
        clock.of_parts(monkeypatch)
    assert invoke(*words, "-o", f"{whole}/").exit_code in (0, 4)
    # a task of a study is not cut but called off, and one of them takes more than a third
    limit = clock.calls * (2 if kind == "rare" else 1) // 3
    clock.begin(limit)
    told = invoke(*words, "-o", f"{path}/", "--max-wall", "1h")
    assert told.exit_code == 5 and "`rigidmc resume` continues" in told.stdout, told.output
    times = 1
    while told.exit_code == 5:
        seen = {name: one for name, one in sums(path).items() if name != "members"}
        assert clock.noticed.is_set() and times < 40
        times += 1
        clock.begin(limit)
        told = invoke("resume", path, "--max-wall", "1h")
        assert seen.items() <= sums(path).items()
    assert told.exit_code in (0, 4) and times > 1 and sums(path) == sums(whole)
    assert not (path / "unfinished").exists()


def test_a_run_that_is_extended_keeps_to_its_time(scene, tmp_path, clock):
    words = ["run", scene, "--shard-size", "0.5", "-o"]
    assert invoke(*words, f"{tmp_path}/whole/").exit_code == 0
    path = tmp_path / "run"
    assert invoke(*words, f"{path}/", "--members", "4064").exit_code == 0
    clock.begin(50)
    assert invoke("extend", path, "--members", "9000", "--max-wall", "1h").exit_code == 5
    assert len(sums(path)) < run_directory.status(path)["shards"]
    clock.begin(10**9)
    assert invoke("resume", path).exit_code == 0 and sums(path) == sums(tmp_path / "whole")

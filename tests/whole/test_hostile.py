"""Whatever a file contains, a command ends with one message and 3 or 74, or has a result.

No traceback, no hang, no gigabyte. 200 files of all readers, and options and expressions; 10,000 in
an hour with `pytest -n 0 -m slow tests/whole/test_hostile.py -s`, which prints how they ended.
`SEED=... pytest -n 0 tests/whole/test_hostile.py -k one` repeats one. Links and pipes that others
planted are in tests/files/test_opening.py.
"""

import collections
import contextlib
import os
import random
import signal
import tempfile
import time
import warnings
from unittest.mock import patch

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import rigidmc as rm
from rigidmc.engine.compiler import machine_code
from rigidmc.runs import prepare
from rigidmc.runs.directory import shards
from rigidmc.studies.accuracy import study as accuracy
from rigidmc.studies.stress import hard_cases, trust
from rigidmc.views import descriptions as estimate
from tests.tools import hostile, hostile_readers
from tests.tools.commands import invoke, words_of
from tests.tools.faulty import LINUX

pytestmark = LINUX

# Seconds of computing until a file is refused: at most 1.2 measured on Zen 4, 2.0 on Zen 3, which
# is a busy machine's half speed. A result may take longer: a picture takes matplotlib 1.3 to 4.5 s.
REFUSED_SECONDS, RESULT_SECONDS = 5.0, 10.0
# memory beyond what this process has: a command of its own begins with 0.25 GB, and 1 GB is the
# limit
BYTES = 7e8
WORK = 100_000  # member-steps that an example may take
ACCESSORS = words_of("energy momentum euler phase drift polhode rerun summary scene")
COMMANDS = {
    kind: text.split()
    for kind, text in {
        "result": "show check run summary plot rerun animate exact accuracy stress body open",
        "scene": "show check run exact accuracy stress body",
        "zarr": "show check summary plot rerun export open",
        "mesh": "body",
        "map": "map show summary open",
        "table": "stress summary open",
        "run": "status verify resume consolidate extend merge summary plot rerun animate show open",
    }.items()
} | {"words": [""]}
PICTURES = words_of(
    "summary trajectory angles phase_portrait effective_potential polhodes poinsot"
    " middle_component drift_histogram gibbs"
)
MAKERS = {
    "result": hostile.hostile_result,
    "scene": hostile.hostile_scene,
    "run": hostile.hostile_run,
    "zarr": hostile_readers.hostile_zarr,
    "mesh": hostile_readers.hostile_mesh,
    "map": hostile_readers.hostile_map,
    "table": hostile_readers.hostile_table,
    "words": lambda some, good, folder: good.at("scene.toml"),
}
LONGEST = 20_000  # letters of all messages, notes included; a screen has 2,000


class Passed(BaseException):
    """The file is good enough to compute with: the rest does not concern files."""


class Hung(BaseException):
    """A command that does not end."""


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    made = hostile.Good(tmp_path_factory.mktemp("good"))
    hostile_readers.add_to(made, hostile.Stored)
    for words in (
        ("rerun --member 3", made.at("scene.nc")),
        ("rerun --member 3", made.at("table.nc")),
        ("animate --member 3 --seconds 0.2 -o", made.at("x.gif"), made.at("scene.nc")),
        ("plot -o", made.at("x.png"), made.at("scene-run")),
    ):
        done = invoke(*words)  # compiles, and imports what takes seconds
        assert done.exit_code == 0, done.output
    return made


@contextlib.contextmanager
def bounded():
    """Compile no kernel that the good files do not need, measure no price, make no long run."""
    address, compute = machine_code.address_of, prepare.compute

    def known(function, signature):
        if machine_code.kernel_entry(function, signature).name not in machine_code._addresses:
            raise Passed
        return address(function, signature)

    def short(run, *given):
        if run.members.size * max(run.plan.mean_steps, run.plan.grid.saves) > WORK:
            raise Passed
        return compute(run, *given)

    def passed(*_, **__):
        raise Passed

    with contextlib.ExitStack() as held:
        for where, name, what in (
            (machine_code, "address_of", known), (prepare, "compute", short),
            (shards, "compute", short),
            (estimate, "cost_per_step", passed),
            (accuracy, "work_precision", passed), (hard_cases, "run_cases", passed),
            (trust, "trust", passed),
        ):  # fmt: skip
            held.enter_context(patch.object(where, name, what))
        yield


def words_on(some, kind, command, path, folder):
    """The words of a command on a file."""
    out = os.path.join(folder, "out")
    return {
        "run": [path, "--members", "8", *some.choice(([], ["-o", f"{out}.nc"], ["-o", f"{out}/"]))],
        "plot": [path, "-o", f"{out}.png", "--picture", some.choice(PICTURES)],
        "rerun": [path, "--member", some.choice(("0", "3", "39", "99999999999"))],
        "animate": [path, "--member", "3", "-o", f"{out}.gif", "--seconds", "0.1"],
        "exact": [path, "--members", "4"],
        "verify": [path, "--spot", "1"],
        "resume": [path, "--max-wall", "1", *some.choice(([], ["--repair"], ["--shards", "0:1"]))],
        "consolidate": [path, "-o", f"{out}.nc"],
        "extend": [path, "--members", some.choice(("50", "120")), "--max-wall", "1"],
        "merge": [f"{out}/", path],
        "export": [path, "-o", f"{out}.csv"],
        "stress": ["--bounds", path] if kind == "table" else [path],
    }.get(command, [path])


def opened(some, path):
    """A method of what one opens in Python; (exit code, its message)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ds = rm.open(path)
            name = some.choice(ACCESSORS)
            first = int(ds.member[0]) if "member" in ds.coords else 0  # a map has no members
            found = getattr(ds.rigid, name)(*([first] if name in ("polhode", "rerun") else []))
            if hasattr(found, "load") and hasattr(found, "sizes"):
                found.load()
            ds.close()
    except ValueError as error:  # a plain ValueError is that of something not saved
        return 3, f"rigidmc: {error}"
    except OSError as error:
        return 74, f"rigidmc: {error}"
    except RuntimeError as error:  # values are read lazily: a damaged chunk is the library's error
        known = "NetCDF" in str(error) or "decompression" in str(error)
        return (74, f"rigidmc: {error}") if known else (1, repr(error))
    return 0, ""


def told(some, good, kind, command, path, folder):
    """(exit code, messages, whether this is allowed) of a command on a hostile file."""

    def hung(*_):
        raise Hung

    previous = signal.signal(signal.SIGALRM, hung)
    signal.setitimer(signal.ITIMER_REAL, 100.0)  # waits, on a machine that has other work too
    try:
        if command == "open":
            return opened(some, path)
        words = words_on(some, kind, command, path, folder)
        if kind == "words":
            command, words = hostile_readers.hostile_words(some, good)
        done = invoke(command, *words)
    except Passed:
        return 0, ""
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
    return done.exit_code, done.stderr


began_with: list[int] = []  # memory [kB]


def peak():
    """The growth of the largest memory since the last call [bytes]."""
    with open("/proc/self/status") as file:
        told = dict(line.split(":", 1) for line in file)
    size = int(told["VmHWM"].split()[0]) - (began_with[-1] if began_with else 0)
    began_with[:] = [int(told["VmRSS"].split()[0])]
    with contextlib.suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    return 1024 * size


def tried(good, seed, ended):
    """One hostile file of a seed, and a command that reads it."""
    some = random.Random(seed)
    kind = some.choice(sorted(COMMANDS))
    command = some.choice(COMMANDS[kind])
    with tempfile.TemporaryDirectory() as folder:
        path = MAKERS[kind](some, good, folder)
        peak()
        began, wall = time.process_time(), time.monotonic()
        with bounded():
            code, text = told(some, good, kind, command, path, folder)
        seconds, size = time.process_time() - began, peak()
        said = (
            f"seed {seed}: {command} of a {kind}: exit {code} in {seconds:.2f} s, "
            f"{time.monotonic() - wall:.2f} s by the clock, {size / 1e9:.2f} GB: {text[-800:]}"
        )
        messages = [
            line
            for line in text.splitlines()
            if line.startswith(("rigidmc: ", "╭─ Error ─")) and not line.startswith("rigidmc: note")
        ]
        assert len(text) < LONGEST, said
        allowed = code in (2, 3, 6, 74) if kind == "words" else code in (3, 74)
        allowed = allowed or (command == "merge" and code == 6)
        assert allowed or code in (0, 4, 5), said
        one = code in (2, 3, 6, 74)
        assert "Traceback" not in text and len(messages) == one, said
        longest = REFUSED_SECONDS if allowed else RESULT_SECONDS
        assert seconds < longest and size < BYTES, said
        ended["refused"] += allowed
        ended["good enough"] += not allowed
        ended[f"{kind}: exit {code}"] += 1
        ended["seconds"], ended["bytes"] = max(ended["seconds"], seconds), max(ended["bytes"], size)


def many(good, count):
    ended = collections.Counter()

    @settings(
        max_examples=count,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate],
        database=None,
    )
    @given(st.integers(0, 2**64))
    def every(seed):
        tried(good, seed, ended)

    every()
    print({k: v if isinstance(v, int) else round(v, 3) for k, v in sorted(ended.items())})
    # otherwise nothing is tested
    assert ended["refused"] > 0.3 * count and ended["good enough"] > 0.01 * count


def test_hostile_files_are_one_message(good):
    many(good, 200)


@pytest.mark.skipif("SEED" not in os.environ, reason="no SEED to repeat")
def test_one(good):
    tried(good, int(os.environ["SEED"]), collections.Counter())


@pytest.mark.slow
def test_ten_thousand_hostile_files_are_one_message_each(good):
    """pytest -n 0 -m slow tests/whole/test_hostile.py -s"""
    many(good, 10_000)

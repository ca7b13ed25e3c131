"""What outputs survive, with closing tables.

python tests/tools/torture.py --kills 200 --faults all --corrupt 500 --lost 6 --outputs all
    --cache 9

--kills N    Start a run, end it by SIGKILL, SIGTERM, SIGINT or SIGHUP at a random moment, resume it
             until it is complete. After the last three, no partial file is left.
             The sha256 of its shards are those of an unbroken run. Unfinished shards are kept 20
             times a second, of one kind a single shard of all members. Some runs have rows of their
             own for each member, from a table, and keep summaries and thinned digits; some are
             maps, adaptive maps, and members of studies, whose study of the run says the same
             in the end. --kinds map,adaptive takes these alone.
--faults N   At every open, fsync, rename, link and unlink and every variable that `run`, `extend`
             and `merge` write (at N of each, or all): a full disk, a broken disk, or a delay.
             Also a limit on the size of files, wherever the C library then is. Exit 74 and one
             message; nothing wrong is visible; resumed or run once more, the output is complete.
--corrupt N  Flip a bit in or cut a shard or run.json of a complete run at a random place. `verify`
             has to find it, and `resume --repair` to undo it.
--outputs N  Every other output (results, consolidated files, maps, studies, bounds, pictures,
             animations): the same faults, and files that appear meanwhile, at N of each call or
             all; and N kills and signals that come twice, or 200. Exit 74 or 6 and one message; no
             file is torn or overwritten, and nothing stays behind. Also every command with streams
             that are closed, full or without a reader.
--cache N    Damage the cached kernels of a run N times; every third time, let no file grow to the
             size of a kernel. The run ends well, to the same bytes, with one line if the cache
             cannot be written.
--lost N     Kill N workers of `--cluster local:2`, one every few seconds. The run ends well, and
             its shards are those of two threads.
"""

import argparse
import contextlib
import functools
import hashlib
import itertools
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

# the folder of this script is tests/tools
sys.path[:0] = [str(Path(__file__).parents[2])]

from tests.tools.commands import COMMAND, attempt, invoke, words_of  # noqa: E402
from tests.tools.faulty import at_call, delay, limited, places  # noqa: E402

WORDS = words_of("run tennis_racket --members 400000 --every 0.5 --save omega --shard-size 4 -o")
SIGNALS = "SIGKILL", "SIGTERM", "SIGINT", "SIGHUP"  # names: Windows lacks some
AT_MOST = 4  # kills of one run, so that all kinds have their share
ONE = words_of("--every 1 --save omega --shard-size 1000 -o")
TABLE = """
[body]
moments = [1.0, 2.0, { table = "rows.csv", column = "third" }]
[start]
omega = [{ normal = [0.0, 0.1] }, { table = "rows.csv", column = "spin" }, 0.0]
[run]
dt = 0.01
t_end = 10.0
every = 0.1
save = ["omega", "energy"]
keep = { omega = "thinned", energy = "summary" }
thin = 20
digits = 6
"""


class Kind(NamedTuple):
    """A kind of run directory.

    words : of the command line; the directory follows
    study : of the command that writes a study of the directory, if there is one: its name and
        options; directory and file are put between and after them
    """

    words: list[str]
    study: tuple[str, ...] = ()


def kinds_of(members, size, table):
    """{name: Kind} of runs of about so many members, in shards of `size` MB; a new kind is one
    entry here.  table : a scene with rows of its own for members / 4
    """
    racket = [*WORDS[:3], str(members), *WORDS[4:-2], str(size), "-o"]
    quarter, side = str(members // 4), ["--shard-size", str(size / 4), "-o"]
    crossed, heard = ("section", "--at", "omega[1] = 0"), ("frequencies", "--of", "omega[1]")
    shares = "sensitivity", "--of", "mean(omega_mean[2])"
    few = ["--members", str(members // 16), "--t-end", "14", "--every", "0.2"]
    ends = "basins", "--of", "p(omega_last[1] >= 0.5)"
    short = ["--t-end", "62.83185307179586", *side]
    seldom = [
        *("--set", "start.attitude=[0.0, { normal = [0.4, 0.05] }, 0.0]"),
        *("--of", "p(nutation_max >= 0.75)", "--repetitions", "16"),
    ]
    noisy = [
        *("--set", "effects.bath={ gamma = 0.2, kT = 1e-5 }", "--set", "start.omega.3=200"),
        *("--integrator", "strang", "--dt", "0.01", "--t-end", "1"),
        *("--until", "mean(omega_final[1]) +- 0.0015"),
    ]
    pixels = ["--members", "4", "--resolution"]
    return {
        "racket": Kind(racket),
        "one shard": Kind(
            ["run", "tennis_racket", "--members", "8000", "--t-end", str(members // 1000), *ONE]
        ),
        "table": Kind(["run", table, "--members", quarter, *side]),
        "map": Kind(["map", "sleeping_top", *pixels, str(int((members / 4) ** 0.5)), *side]),
        "adaptive": Kind(
            ["map", "sleeping_top", *pixels, str(int(members**0.5)), "--adaptive", "-o"]
        ),
        "sensitivity": Kind(
            [*named("tennis_racket", shares), "--families", quarter, *side], shares
        ),
        "section": Kind(
            [*named("tennis_racket", crossed), "--members", quarter, "--every", "0.5", *side],
            crossed,
        ),
        "frequencies": Kind([*named("tennis_racket", heard), *few, *side], heard),
        "basins": Kind(
            [*named("driven_pendulum", ends), "--families", str(members // 128), *side], ends
        ),
        "ftle": Kind(
            [*named("driven_pendulum", ("ftle",)), "--families", str(members // 32), *short],
            ("ftle",),
        ),
        "lyapunov": Kind(
            [*named("heavy_top", ("lyapunov",)), "--members", str(members // 64), "-o"],
            ("lyapunov",),
        ),
        "fit": Kind(
            ["fit", "tennis_racket", "toss", "--free", "body.moments,start.omega", "--trials"]
            + [str(members // 512), "-o"],
            ("fit",),
        ),
        "rare": Kind([*named("heavy_top", ("rare",)), *seldom, "-o"], ("rare",)),
        "multilevel": Kind([*named("heavy_top", ("multilevel",)), *noisy, "-o"], ("multilevel",)),
    }


def named(what, study):
    """The words of a study of a scene or a run."""
    return [study[0], what, *study[1:]]


def told_by(path):
    """sha256 of the arrays and attributes of a netCDF file."""
    import xarray as xr

    with xr.open_dataset(path) as found:
        parts = [(n, v.dims, v.values.tolist(), v.attrs) for n, v in found.variables.items()]
    return hashlib.sha256(repr((parts, found.attrs)).encode()).hexdigest()


def sums(path):
    """{shard: sha256} of a run, and of what tells its members if it has chosen ones."""
    folder = os.path.join(path, "shards")
    found = {}
    if os.path.isfile(chosen := os.path.join(path, "members.i64")):
        with open(chosen, "rb") as file:
            found["members"] = hashlib.sha256(file.read()).hexdigest()
    for name in sorted(os.listdir(folder)) if os.path.isdir(folder) else []:
        with open(os.path.join(folder, name), "rb") as file:
            found[name] = hashlib.sha256(file.read()).hexdigest()
    return found


def partial_files(path):
    """The partial files in a run."""
    return [name for _, _, names in os.walk(path) for name in names if name.startswith(".part-")]


def run(*words, **options):
    return subprocess.run([*COMMAND, *words], capture_output=True, text=True, **options)


def quietly(*words):
    """The command line, in a separate process."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1), os.dup2(nowhere, 2)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    from rigidmc.cli import app
    from rigidmc.runs.directory import checkpoints

    checkpoints.EVERY, checkpoints.COSTS = 0.05, 1.0  # these runs are shorter than half a minute
    app(words)


def kills(count, folder, some, members=400_000, size=4, names=None):
    """Kill runs `count` times in all; {what: how often}. names : of the commands, all by default

    The processes are forked from one that has imported everything, which saves two seconds each in
    which there is nothing to kill.
    """
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(
        ["rigidmc.cli", "rigidmc.studies.stability_map.stored", "dask.array"]
    )

    def process(*words):
        made = server.Process(target=quietly, args=words)
        made.start()
        return made

    def done(*words):
        made = process(*words)
        made.join()
        return made.exitcode

    with open(os.path.join(folder, "rows.csv"), "w") as file:
        file.write(
            "third,spin\n"
            + "".join(
                f"{some.uniform(2.2, 2.8)},{some.gauss(1.0, 0.2)}\n" for _ in range(members // 4)
            )
        )
    with open(os.path.join(folder, "table.toml"), "w") as file:
        file.write(TABLE)
    known, kinds, lengths = kinds_of(members, size, file.name), [], []

    def study_of(kind, path):
        """What the study of a run tells, None if its kind has none."""
        if not kind.study:
            return None
        written = os.path.join(folder, "study.nc")
        assert done(*named(path, kind.study), "-o", written, "--force") == 0
        return told_by(written)

    for name in names or known:
        whole, again = os.path.join(folder, name), os.path.join(folder, f"{name}-again")
        assert done(*known[name].words, whole + "/") == 0  # compiles
        began = time.monotonic()
        assert done(*known[name].words, again + "/") == 0
        lengths.append(time.monotonic() - began)
        # members and two shards or more, of which a kill may leave some; fast machines make few
        assert sums(again) == sums(whole) and len(sums(whole)) > 2 - 2 * (name == "one shard")
        expected = study_of(known[name], whole)
        assert study_of(known[name], again) == expected
        kinds.append((known[name], sums(whole), expected))
    ended = dict.fromkeys(names or known, 0)
    told = dict.fromkeys(("kills", "before any shard", "runs", "runs resumed to the end",
        "sha256 equal", "studies", "studies equal", "torn shards seen", "other exit codes",
        "partial files left"), 0)  # fmt: skip
    for i in range(4 * count + 10):
        if told["kills"] == count:
            break
        path, which = os.path.join(folder, f"run{i}"), i % len(kinds)
        kind, expected, study = kinds[which]
        words, mine = [*kind.words, path + "/"], 0
        while told["kills"] < count and mine < AT_MOST:
            began, child = time.monotonic(), process(*words)
            child.join(some.uniform(0.2, 1.1) * lengths[which])
            if child.exitcode is not None:
                if words[0] != "resume":  # less than on a machine that was busy
                    lengths[which] = min(lengths[which], time.monotonic() - began)
                break
            number = getattr(signal, SIGNALS[told["kills"] % len(SIGNALS)])
            os.kill(child.pid, number)
            child.join()
            code = child.exitcode  # a signal before the command listens ends the process itself
            told["other exit codes"] += code not in (0, 4, 5, -number, 128 + number)
            told["partial files left"] += code > 0 and bool(partial_files(path))
            is_run = os.path.isfile(os.path.join(path, "run.json"))
            told["kills"] += is_run  # before, there is nothing to lose
            mine += 1
            if is_run and told["kills"] % 20 == 0:
                print(f"{told['kills']} kills: {told}", file=sys.stderr, flush=True)
            there = sums(path) if is_run else {}
            told["before any shard"] += not {*there} - {"members"}
            told["torn shards seen"] += sum(
                expected.get(name) != s for name, s in there.items() if name.endswith(".nc")
            )
            if is_run:
                words = ["resume", path]
        if os.path.isfile(os.path.join(path, "run.json")):
            told["runs"] += 1
            told["runs resumed to the end"] += done("resume", path) == 0
            told["sha256 equal"] += sums(path) == expected
            told["studies"] += study is not None
            told["studies equal"] += study is not None and study_of(kind, path) == study
            ended[(*(names or known),)[which]] += 1
        shutil.rmtree(path, ignore_errors=True)
    return {**told, **{f"runs of {name}": number for name, number in ended.items()}}


def lost(count, folder, some, members=2_000_000):
    """Kill `count` workers of a local cluster, one every few seconds; {what: how often}."""
    whole, path = os.path.join(folder, "whole"), os.path.join(folder, "run")
    words = [*WORDS[:3], str(members), *WORDS[4:]]
    assert run(*words, whole + "/").returncode == 0
    told = {"workers killed": 0, "runs": 0, "runs that ended well": 0, "sha256 equal": 0}
    while told["workers killed"] < count and told["runs"] < count:
        child = subprocess.Popen(
            [*COMMAND, *words, path + "/", "--cluster", "local:2"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        while child.poll() is None and not any(
            name.endswith(".nc") for _, _, names in os.walk(path) for name in names
        ):
            time.sleep(0.01)
        while child.poll() is None:
            time.sleep(0.1 if told["workers killed"] == 0 else some.uniform(1.5, 3.0))
            workers = [
                pid for pid in children(child.pid) if b"spawn_main" in told_of(pid, "cmdline")
            ]
            if workers and child.poll() is None and told["workers killed"] < count:
                os.kill(some.choice(workers), signal.SIGKILL)
                told["workers killed"] += 1
        told["runs"] += 1
        told["runs that ended well"] += child.returncode == 0
        told["sha256 equal"] += sums(path) == sums(whole)
        shutil.rmtree(path)
    return told


def children(pid):
    """The processes that a process started."""
    return [
        int(word)
        for task in os.listdir(f"/proc/{pid}/task")
        for word in told_of(pid, f"task/{task}/children").split()
    ]


def told_of(pid, what):
    try:
        with open(f"/proc/{pid}/{what}", "rb") as file:
            return file.read()
    except OSError:
        return b""


def corrupt(count, folder, some, whole=None):
    """Damage a whole run, by default one of 20,000 members, `count` times; {what: how often}."""
    if whole is None:
        whole = os.path.join(folder, "whole")
        words = [*WORDS[:3], "20000", *WORDS[4:]]
        words[words.index("--shard-size") + 1] = "0.3"
        assert run(*words, whole + "/").returncode == 0
    from rigidmc.errors import RigidmcError
    from rigidmc.runs.directory import gather, resume

    expected = sums(whole)
    told = {"damaged": 0, "found": 0, "repaired, sha256 equal": 0, "crashes of verify": 0}
    for _ in range(count):
        files = [*(os.path.join("shards", name) for name in expected), "run.json"]
        path = os.path.join(whole, some.choice(files))
        with open(path, "rb") as file:
            data = file.read()
        bad, at = bytearray(data), some.randrange(len(data))
        if some.random() < 0.3:
            bad = bad[:at]
        else:
            bad[at] ^= 1 << some.randrange(8)
        with open(path, "wb") as file:
            file.write(bad)
        told["damaged"] += 1
        try:
            found = bool(gather.verify(whole, spot=0))
        except RigidmcError:
            found = True
        except Exception as error:
            print(f"{path}: {type(error).__name__}: {error}", file=sys.stderr)
            told["crashes of verify"] += 1
            found = True
        told["found"] += found
        if path.endswith(".nc"):
            gather.repair(whole)
            resume.resume(whole)
        else:
            with open(path, "wb") as file:
                file.write(data)
        told["repaired, sha256 equal"] += sums(whole) == expected
    return told


def faults(most, folder, some, commands=("run", "extend", "merge")):
    """Let each operation of commands fail once; {what: how often}."""
    from rigidmc.runs.directory import folder as run_directory

    whole, path, words = (
        os.path.join(folder, "whole"),
        os.path.join(folder, "run"),
        [*WORDS[:3], "20000", *WORDS[4:]],
    )
    words[words.index("--shard-size") + 1] = "0.1"
    words[-1:-1] = "--t-end", "1"  # five shards, most of whose time is not that of steps
    half, parts = os.path.join(folder, "half"), [os.path.join(folder, f"part{i}") for i in range(2)]
    assert invoke(*words, whole + "/").exit_code == 0
    assert invoke(*words[:3], "10000", *words[4:], half + "/").exit_code == 0
    assert [
        invoke(*words, part + "/", "--shards", given).exit_code
        for part, given in zip(parts, ("0:2", "2:9"), strict=True)
    ] == [0, 0]
    expected = sums(whole)
    kinds = {
        "run": [*words, path + "/"],
        "extend": ["extend", path, "--members", "20000"],
        "merge": ["merge", path, *parts],
    }
    kinds = {name: kinds[name] for name in commands}
    told = dict.fromkeys(("faults", "exit 74, one message", "no harm done, exit 0",
        "wrong shards seen", "completed, sha256 equal"), 0)  # fmt: skip

    def prepared(kind):
        """The files before a command."""
        shutil.rmtree(path, ignore_errors=True)
        if kind == "extend":
            shutil.copytree(half, path)

    def tried(name, kind, failure):
        """A command while something fails, and the commands after it."""
        prepared(kind)
        with failure:
            done = attempt(*kinds[kind])
        told["faults"] += 1
        if done.exit_code == 0:
            told["no harm done, exit 0"] += 1
        elif (
            done.exit_code == 74
            and done.stderr.count("rigidmc:") == 1
            and "Traceback" not in done.output
            and folder in done.stderr
        ):
            told["exit 74, one message"] += 1
        else:
            print(
                f"{name}: exit {done.exit_code}: {done.output[-300:]} {done.exception!r}",
                file=sys.stderr,
            )
        is_run = os.path.isfile(os.path.join(path, "run.json"))
        seen = sums(path) if is_run else {}
        known = expected | (sums(half) if kind == "extend" else {})
        told["wrong shards seen"] += sum(
            known.get(n) != s for n, s in seen.items() if n.endswith(".nc")
        )
        if kind == "extend" and run_directory.status(path)["members"] == 20000:
            told["wrong shards seen"] += any(
                len(sums(half)) - 1 == int(n[:8]) and n not in expected for n in seen
            )
            again = attempt("resume", path)
        else:
            again = attempt(*(("resume", path) if is_run and kind == "run" else kinds[kind]))
        good = again.exit_code == 0 and sums(path) == expected
        told["completed, sha256 equal"] += good
        if not good:
            print(
                f"{name}: afterwards: exit {again.exit_code}: {again.output[-300:]}",
                file=sys.stderr,
            )

    for kind, place in itertools.product(kinds, places()):
        prepared(kind)
        with at_call(folder, *place[1:3]) as seen:
            assert invoke(*kinds[kind]).exit_code == 0
        numbers = range(seen[0]) if most >= seen[0] else sorted(some.sample(range(seen[0]), most))
        for number, act in itertools.product(numbers, (*place[3], delay)):
            tried(f"{kind}: {place[0]} {number}", kind, at_call(folder, *place[1:3], number, act))
    largest = max(os.path.getsize(os.path.join(whole, "shards", shard)) for shard in expected)
    for i in range(min(most, 40)):
        tried(
            f"no file larger than {i}/40 of a shard",
            commands[i % len(commands)],
            limited(i * largest // 40),
        )
    return told


LIMIT = 60_000  # bytes of a file: LLVM code of the loop has 110,000, of other kernels 20,000


def cache(count, folder, some):
    """Damage cached kernels `count` times, or leave no room for them; {what: how often}."""
    kernels, out = os.path.join(folder, "kernels"), os.path.join(folder, "run")
    words = words_of("run tennis_racket --members 100 --save none -o", out + "/")
    told = dict.fromkeys(("caches damaged", "caches without room", "exit 0", "sha256 equal",
        "one line of a cache without room", "kernels kept"), 0)  # fmt: skip

    def made():
        shutil.rmtree(out, ignore_errors=True)
        env = {**os.environ, "RIGIDMC_CACHE_DIR": kernels}
        return run(*words, env=env), sums(out)

    def files():
        return [
            os.path.join(top, name)
            for top, _, names in os.walk(kernels)
            for name in names
            if name.endswith((".bc", ".o"))
        ]

    _, expected = made()
    for i in range(count):
        full = i % 3 == 2
        for path in files():
            with open(path, "rb") as file:
                data = bytearray(file.read())
            data[some.randrange(len(data))] ^= 1 << some.randrange(8)
            with open(path, "wb") as file:
                file.write(data if some.random() < 0.7 else data[: some.randrange(len(data))])
        # the code of the loop over members is larger, and the result is not
        with limited(LIMIT) if full else contextlib.nullcontext():
            done, found = made()
        told["caches without room" if full else "caches damaged"] += 1
        told["exit 0"] += done.returncode == 0
        told["sha256 equal"] += found == expected
        told["one line of a cache without room"] += full and done.stderr.count(kernels) == 1
        told["kernels kept"] += (max(map(os.path.getsize, files())) > LIMIT) != full
        if done.returncode or found != expected:
            print(f"cache {i}: exit {done.returncode}: {done.stderr[-300:]}", file=sys.stderr)
    return told


def main():
    words = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--kills", type=int, default=0)
    words.add_argument(
        "--faults", type=lambda text: 10**6 if text == "all" else int(text), default=0
    )
    words.add_argument("--corrupt", type=int, default=0)
    words.add_argument("--lost", type=int, default=0)
    words.add_argument(
        "--outputs", type=lambda text: 10**6 if text == "all" else int(text), default=0
    )
    words.add_argument("--cache", type=int, default=0)
    words.add_argument("--kinds", type=lambda text: text.split(","))
    words.add_argument("--seed", type=int, default=1)
    given = words.parse_args()
    some = random.Random(given.seed)
    from tests.tools.torture_outputs import outputs

    for name, work, count in (
        ("kills", functools.partial(kills, names=given.kinds), given.kills),
        ("faults", faults, given.faults),
        ("corrupt", corrupt, given.corrupt),
        ("lost", lost, given.lost),
        ("outputs", outputs, given.outputs),
        ("cache", cache, given.cache),
    ):
        if count:
            began = time.monotonic()
            with tempfile.TemporaryDirectory(prefix="rigidmc-torture-") as folder:
                found = work(count, folder, some)
            print(f"{name}, {time.monotonic() - began:.0f} s")
            for what, number in found.items():
                print(f"  {what:36s} {number:6,d}")


if __name__ == "__main__":
    main()

"""Attacks on the outputs that are one file each.

Faults, files that appear meanwhile, kills, signals that come twice, streams that do not work.
"""

import contextlib
import itertools
import multiprocessing
import os
import signal
import sys
import time
import unittest.mock

import netCDF4
import xarray as xr

from tests.tools.commands import attempt, words_of
from tests.tools.faulty import at_call, limited, places
from tests.tools.torture import SIGNALS

OLD = b"precious"
SCENE = "tennis_racket --members 300 --t-end 0.5 --every 0.1 --save omega --threads 1"


def commands(folder, at):
    """{kind: (words, paths that it writes)} of all commands that write files; `made` has put their
    input in the folder.
    """
    whole, run = os.path.join(folder, "whole.nc"), os.path.join(folder, "whole")
    one, two, three = (os.path.join(at, f"out.{suffix}") for suffix in ("nc", "png", "csv"))
    gif = os.path.join(at, "out.gif")
    map_words = "map intermediate_axis --resolution 4 --members 2 -o"
    study = "accuracy nasa_brick --integrators exact,rk4 --members 4 --tolerances 1e-4 -o"
    stress = "stress --group H5 --integrator exact -o"
    return {
        "run": (words_of(f"run {SCENE} -o", one), [one]),
        "rerun": (words_of("rerun --member 3 -o", one, whole), [one]),
        "consolidate": (words_of("consolidate -o", one, run), [one]),
        "map": (words_of(map_words, one, "--plot", two), [one, two]),
        "study": (words_of(study, one, "--plot", two), [one, two]),
        "stress": (words_of(stress, one, "--write-bounds", three), [one, three]),
        "plot": (words_of("plot --picture drift_histogram -o", two, whole), [two]),
        "animate": (words_of("animate --member 0 --seconds 0.1 -o", gif, whole), [gif]),
    }


def made(folder, process):
    """Make the input of commands and run each once, to compile; {path: bytes} of the outputs."""
    for name in ("whole.nc", "whole/"):
        assert process(words_of(f"run {SCENE} -o", os.path.join(folder, name))) == 0
    at = os.path.join(folder, "at")
    os.mkdir(at)
    return at


@contextlib.contextmanager
def computed_once():
    """Compute studies once, then attack their outputs."""
    from rigidmc.runs import frames as again
    from rigidmc.studies.accuracy import study as accuracy
    from rigidmc.studies.stability_map import study as maps
    from rigidmc.studies.stress import hard_cases

    with contextlib.ExitStack() as held:
        for module, name in (
            (accuracy, "work_precision"),
            (hard_cases, "run_cases"),
            (maps, "run_map"),
            (again, "frames"),
        ):
            real, kept = getattr(module, name), {}

            def once(*given, real=real, kept=kept, **named):
                if not kept:
                    kept["it"] = real(*given, **named)
                return kept["it"].copy()

            held.enter_context(unittest.mock.patch.object(module, name, once))
        yield


def empty(at, old=()):
    """Leave in a folder only the old files."""
    for name in os.listdir(at):
        os.unlink(os.path.join(at, name))
    for path in old:
        with open(path, "wb") as file:
            file.write(OLD)


def contents(at):
    """{path: bytes} of a folder."""
    found = {}
    for name in os.listdir(at):
        with open(os.path.join(at, name), "rb") as file:
            found[os.path.join(at, name)] = file.read()
    return found


def same(one, other):
    """Whether two files say the same; the C library writes chunks of netCDF files in any order."""
    if one is None or one == other or not other.startswith(b"\x89HDF"):
        return one == other
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        return read(one).identical(read(other))
    return False


def read(data):
    """The Dataset of the bytes of a netCDF file with every value; it raises if one is missing."""
    with netCDF4.Dataset("of bytes", memory=data) as file:
        return xr.open_dataset(xr.backends.NetCDF4DataStore(file)).load()


def faults(most, folder, some, kinds=None):
    """Let each call of each command (or of some kinds) fail once; {what: how often}.

    Also let the file of the command appear before the call, with and without --force.
    """
    at = made(folder, lambda words: attempt(*words).exit_code)
    told = dict.fromkeys(("faults", "exit 74, one message", "exit 6, one message, NAME.2",
        "no harm done, exit 0", "wrong files", "left behind", "whole in the end"), 0)  # fmt: skip

    def tried(name, words, paths, expected, failure, old=(), appears=None):
        empty(at, old)
        with failure:
            done = attempt(*words)
        told["faults"] += 1
        kept = {path.replace("out.", "out.2."): path for path in paths}  # x.2.nc of x.nc
        one = (
            done.stderr.count("rigidmc:") == 1
            and "Traceback" not in done.output
            and folder in done.stderr
        )
        found = contents(at)
        if done.exit_code == 0:
            told["no harm done, exit 0"] += 1
        elif done.exit_code == 74 and one and appears is None:
            told["exit 74, one message"] += 1
        elif done.exit_code == 6 and one and appears is not None:
            told["exit 6, one message, NAME.2"] += 1
        else:
            told_by = f"{done.output[-300:]} {done.exception!r}"
            print(f"{name}: exit {done.exit_code}: {told_by}", file=sys.stderr)
        for path in paths:
            there = found.get(path)
            right = (
                same(there, expected[path])
                or (there == OLD and (path in old or path == appears))
                or (there is None and path not in old)
            )
            told["wrong files"] += not right
            if not right:
                print(f"{name}: {path}: {'none' if there is None else there[:40]}", file=sys.stderr)
        told["wrong files"] += sum(
            not same(found[path], expected[kept[path]]) for path in found if path in kept
        )
        others = [path for path in found if path not in paths and path not in kept]
        # a file that cannot be deleted stays until the next command
        others = others if "unlink" not in name else []
        told["left behind"] += len(others)
        done = attempt(*words, "--force")
        found = {path: data for path, data in contents(at).items() if path not in kept}
        right = (
            done.exit_code == 0
            and found.keys() == expected.keys()
            and all(same(found[path], expected[path]) for path in expected)
        )
        told["whole in the end"] += right
        if not right or others:
            left = f"{name}: left {others}; then exit {done.exit_code}: {sorted(found)}"
            print(left, done.output[-300:], sep=": ", file=sys.stderr)

    with computed_once():
        for kind, (words, paths) in commands(folder, at).items():
            if kinds is not None and kind not in kinds:
                continue
            empty(at)
            assert attempt(*words).exit_code == 0, kind
            expected = contents(at)
            empty(at)
            assert attempt(*words).exit_code == 0, kind
            assert sorted(expected) == sorted(contents(at)) == sorted(paths)
            assert all(same(data, expected[path]) for path, data in contents(at).items()), kind
            for name, module, attribute, acts in places():
                empty(at)
                with at_call(at, module, attribute) as seen:
                    attempt(*words)
                numbers = sorted(some.sample(range(seen[0]), min(most, seen[0])))
                for number, act in itertools.product(numbers, acts):
                    for more, old in (([], ()), (["--force"], paths)):
                        failure = at_call(at, module, attribute, number, act)
                        what = f"{kind}: {name} {number}{more}"
                        tried(what, [*words, *more], paths, expected, failure, old)
                for number, path in itertools.product(numbers, paths):

                    def appears(real, given, named, path=path):
                        if not os.path.lexists(path):
                            with contextlib.suppress(OSError), open(path, "xb") as file:
                                file.write(OLD)
                        return real(*given, **named)

                    failure = at_call(at, module, attribute, number, appears)
                    what = f"{kind}: {os.path.basename(path)} appears at {name} {number}"
                    tried(what, words, paths, expected, failure, (), path)
            largest = max(map(len, expected.values()))
            for i in range(min(most, 20)):
                failure = limited(i * largest // 20)
                tried(f"{kind}: no file larger than {i}/20", words, paths, expected, failure)
    return told


def child(words, streams=(), unbuffered=False):
    """The command line in a separate process, with standard streams that a shell gave it.

    streams : of (number, "closed", "gone" or "full")
    """
    reader, gone = os.pipe()
    os.close(reader)
    for number, what in streams:
        if what != "closed":
            os.dup2(
                gone
                if what == "gone"
                else os.open("/dev/full" if what == "full" else os.devnull, os.O_RDWR),
                number,
            )
    os.close(gone)
    closed = [number for number, what in streams if what == "closed"]
    for number in closed:
        os.close(number)
    sys.stdin, sys.stdout, sys.stderr = (  # as the interpreter makes them
        None if number in closed else os.fdopen(number, mode, closefd=False)
        for number, mode in enumerate("rww")
    )
    if unbuffered:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.reconfigure(write_through=True)
    sys.argv = ["rigidmc", *words]
    from rigidmc.cli import main

    main()


def server():
    """Start processes that have imported everything already."""
    context = multiprocessing.get_context("forkserver")
    modules = "cli runs.simulate runs.directory.resume views.ensemble views.animation"
    loaded = [f"rigidmc.{name}" for name in words_of(modules)]
    context.set_forkserver_preload([*loaded, "tests.tools.torture_outputs"])

    def process(words, streams=((1, "null"), (2, "null")), unbuffered=False):
        one = context.Process(target=child, args=(words, streams, unbuffered))
        one.start()
        return one

    return process


def done(one):
    one.join()
    return one.exitcode


def kills(count, folder, some):
    """Kill commands at any time, by SIGKILL, or by another signal twice; {what: how often}."""
    process = server()
    at = made(folder, lambda words: done(process(words)))
    told = dict.fromkeys(("kills", "signals that came twice", "torn files",
        "left behind by signals", "left behind by kills", "left behind in the end"), 0)  # fmt: skip
    kinds = {}
    for kind, (words, paths) in commands(folder, at).items():
        empty(at)
        assert done(process(words)) == 0, kind  # compiles
        empty(at)
        began = time.monotonic()
        assert done(process(words)) == 0, kind
        length = time.monotonic() - began
        sizes = {path: len(data) for path, data in contents(at).items()}
        kinds[kind] = words, paths, length, sizes
    for i, kind in zip(range(count), itertools.cycle(kinds)):
        words, paths, length, sizes = kinds[kind]
        empty(at)
        one = process(words)
        if i % 2:
            one.join(some.uniform(0.02, 1.0) * length)
        else:
            watched(at, one, some.randrange(2 * len(paths) + 1))
        if (number := getattr(signal, SIGNALS[i // len(kinds) % len(SIGNALS)])) == signal.SIGKILL:
            one.kill()
            told["kills"] += one.exitcode is None
        else:
            for _ in range(2):
                if one.exitcode is None:
                    os.kill(one.pid, number)
                time.sleep(some.uniform(0.0, 0.02))
            told["signals that came twice"] += 1
        one.join()
        found = contents(at)
        told["torn files"] += sum(
            path in found and not whole(path, found[path], sizes[path]) for path in paths
        )
        left = [path for path in found if path not in paths]
        by = "kills" if number == signal.SIGKILL else "signals"
        told[f"left behind by {by}"] += len(left)
        if left and number != signal.SIGKILL:
            print(f"{kind}: left by {number.name}: {left}", file=sys.stderr)
        assert done(process([*words, "--force"])) == 0, kind
        told["left behind in the end"] += len(set(contents(at)) - set(paths))
    return told


def watched(at, one, count):
    """Wait until a process has begun so many parts; a part exists for a millisecond."""
    seen = set[str]()
    while one.exitcode is None and len(seen) < count:
        seen.update(name for name in os.listdir(at) if name.startswith(".part-"))


def whole(path, data, size):
    """Whether a file is complete, by its end or because it can be read, and about as large as
    others of its kind.
    """
    if path.endswith(".nc"):
        return bool(read(data).sizes)
    ends = {".png": b"IEND\xaeB`\x82", ".gif": b";", ".csv": b"\n"}
    return data.endswith(ends[os.path.splitext(path)[1]]) and 0.8 * size < len(data)


def streams(folder, kinds=None, only=None):
    """Run commands with each stream closed, full or without a reader; {what: how often}."""
    process = server()
    at = made(folder, lambda words: done(process(words)))
    whole, run, bad = (os.path.join(folder, name) for name in ("whole.nc", "whole", "bad"))
    assert done(process(words_of(f"run {SCENE} -o", bad + "/"))) == 0
    with open(os.path.join(bad, "shards", "notes"), "w") as file:
        file.write("a stray")
    writing = {kind: words for kind, (words, _) in commands(folder, at).items()}
    del writing["study"], writing["stress"]
    telling = {
        "status": ["status", run], "verify": ["verify", run], "summary": ["summary", whole],
        "status of bad": ["status", bad], "verify bad": ["verify", bad],
        "refused": words_of(f"run {SCENE} -o", whole), "maps": ["map", "list"],
    }  # fmt: skip
    telling |= {
        " ".join(words): words
        for words in (
            *([name, "nasa_brick"] for name in ("show", "scenes", "check", "body", "exact")),
            *([name] for name in ("scenes", "effects", "integrators", "observables", "doctor")),
            *(["--help"], ["show", "nasa_brik"], ["fly"]),  # neither scene nor command
        )
    }
    ways = {
        "reader gone": ([(1, "gone"), (2, "null")], False),
        "reader gone, unbuffered": ([(1, "gone"), (2, "null")], True),
        "both readers gone": ([(1, "gone"), (2, "gone")], True),
        "stdout closed": ([(1, "closed"), (2, "null")], False),
        "stderr closed": ([(1, "null"), (2, "closed")], False),
        "stdin closed": ([(0, "closed"), (1, "null"), (2, "null")], False),
        "all closed": ([(0, "closed"), (1, "closed"), (2, "closed")], False),
        "full": ([(1, "full"), (2, "null")], False),
        "full, unbuffered": ([(1, "full"), (2, "null")], True),
    }  # fmt: skip
    told = {"commands": 0, "exit as to /dev/null, or 74 where full": 0, "files as to /dev/null": 0}
    for kind, words in {**writing, **telling}.items():
        if kinds is not None and kind not in kinds:
            continue
        empty(at)
        code = done(process(words))
        expected = contents(at)
        for name in only or ways:
            empty(at)
            got = done(process(words, *ways[name]))
            told["commands"] += 1
            right = got == (74 if "full" in name and code in (0, 4, 5) else code)
            told["exit as to /dev/null, or 74 where full"] += right
            found = contents(at)
            pictures = [path for path in found if path.endswith((".png", ".gif"))]
            same = found.keys() == expected.keys()
            same = same and all(len(found[path]) == len(expected[path]) for path in pictures)
            told["files as to /dev/null"] += same
            if not right or not same:
                print(f"{kind}, {name}: exit {got}, not {code}; {sorted(found)}", file=sys.stderr)
    return told


def outputs(most, folder, some):
    """All of it; {what: how often}."""
    told = {}
    for name, part in (
        ("faults", lambda at: faults(most, at, some)),
        ("kills", lambda at: kills(min(most, 200), at, some)),
        ("streams", streams),
    ):
        at = os.path.join(folder, name)
        os.mkdir(at)
        counts = part(at).items()
        told |= {f"{name}: {what}" if what != name else what: count for what, count in counts}
    return told

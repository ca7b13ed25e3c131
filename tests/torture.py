"""What run directories survive, with closing tables: python tests/torture.py --kills 200, --corrupt 500.

--kills N    start a run, kill it with SIGKILL at a random moment, resume it until it is whole; its shards' sha256 are those of an unbroken run
--corrupt N  flip a bit or cut a file of a whole run at a random place; `verify` has to find it, and `resume --repair` to undo it
"""

import argparse
import hashlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time

COMMAND = [sys.executable, "-c", "from rigidmc.cli import main; main()"]
WORDS = ["run", "tennis_racket", "--members", "400000", "--every", "0.5", "--save", "omega", "--shard-size", "4", "-o"]


def sums(path):
    """{shard: sha256} of a run."""
    folder = os.path.join(path, "shards")
    found = {}
    for name in sorted(os.listdir(folder)):
        with open(os.path.join(folder, name), "rb") as file:
            found[name] = hashlib.sha256(file.read()).hexdigest()
    return found


def run(*words):
    return subprocess.run([*COMMAND, *words], capture_output=True, text=True)


def kills(count, folder, some):
    """Kill runs `count` times in all; {what: how often}."""
    whole = os.path.join(folder, "whole")
    began = time.monotonic()
    assert run(*WORDS, whole + "/").returncode == 0
    length, expected = time.monotonic() - began, sums(whole)
    told = {"kills": 0, "before any shard": 0, "runs resumed to the end": 0, "sha256 equal": 0, "torn shards seen": 0}
    while told["kills"] < count:
        path = os.path.join(folder, f"run{told['kills']}")
        words = [*WORDS, path + "/"]
        while told["kills"] < count:
            child = subprocess.Popen([*COMMAND, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            try:
                child.wait(some.uniform(0.3, 1.1) * length)
                break
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
            told["kills"] += 1
            is_run = os.path.isfile(os.path.join(path, "run.json"))
            there = {name: s for name, s in sums(path).items() if name in expected} if is_run else {}
            told["before any shard"] += not there
            told["torn shards seen"] += sum(expected[name] != s for name, s in there.items())
            if is_run:
                words = ["resume", path]
            else:
                shutil.rmtree(path, ignore_errors=True)
        if os.path.isfile(os.path.join(path, "run.json")):
            done = run("resume", path)
            told["runs resumed to the end"] += done.returncode == 0
            told["sha256 equal"] += sums(path) == expected
        shutil.rmtree(path, ignore_errors=True)
    return told


def corrupt(count, folder, some):
    """Damage a whole run `count` times; {what: how often}."""
    whole = os.path.join(folder, "whole")
    words = [*WORDS[:3], "20000", *WORDS[4:]]
    words[words.index("--shard-size") + 1] = "0.3"
    assert run(*words, whole + "/").returncode == 0
    from rigidmc import runs
    from rigidmc.errors import SceneError

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
            found = bool(runs.verify(whole, spot=0))
        except SceneError:
            found = True
        except Exception as error:
            print(f"{path}: {type(error).__name__}: {error}", file=sys.stderr)
            told["crashes of verify"] += 1
            found = True
        told["found"] += found
        if path.endswith(".nc"):
            runs.repair(whole)
            runs.resume(whole)
        else:
            with open(path, "wb") as file:
                file.write(data)
        told["repaired, sha256 equal"] += sums(whole) == expected
    return told


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--kills", type=int, default=0)
    words.add_argument("--corrupt", type=int, default=0)
    words.add_argument("--seed", type=int, default=1)
    given = words.parse_args()
    some = random.Random(given.seed)
    for name, work, count in (("kills", kills, given.kills), ("corrupt", corrupt, given.corrupt)):
        if count:
            began = time.monotonic()
            with tempfile.TemporaryDirectory(prefix="rigidmc-torture-") as folder:
                found = work(count, folder, some)
            print(f"{name}, {time.monotonic() - began:.0f} s")
            for what, number in found.items():
                print(f"  {what:36s} {number:6,d}")


if __name__ == "__main__":
    main()

"""Every effect, every pair and 50 random sets: do they compile, how fast, and are they vectorized?

The time excludes the compile time of the body alone. Noise is left out, because rk4 refuses it.
"""

import itertools
import json
import os
import random
import subprocess
import sys
import time

from bench import harness
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import is_random

RANDOM, SEED, ASKED = 50, 6, 3.0


def sets(quick):
    """Return the sets, as tuples of words."""
    names = [name for name, kind in EFFECTS.items() if not is_random(kind)]
    some = random.Random(SEED)
    drawn = [tuple(some.sample(names, some.randint(3, 8))) for _ in range(4 if quick else RANDOM)]
    pairs = list(itertools.combinations(names, 2))
    return [(name,) for name in names] + (pairs[::12] if quick else pairs) + drawn


def judge(which):
    """Print one line of JSON for each set, in a separate process."""
    from bench.effects import some
    from tests.tools.assembly import case, counted

    def one(effects):
        began = time.perf_counter()
        counts = counted(case("rk4", tuple(some(EFFECTS[name]) for name in effects)))
        return time.perf_counter() - began, counts

    one(())  # compiled once in each process
    alone = min(one(())[0] for _ in range(2))
    for effects in which:
        seconds, counts = one(effects)
        # one scalar sum is the time of a step, which all members share
        fine = (
            counts["scalar"] <= 1
            and counts["calls"] == 0
            and not counts["libm"]
            and counts["widest"]
        )
        print(
            json.dumps(
                {
                    "kind": "set",
                    "effects": effects,
                    "alone": alone,
                    "seconds": seconds - alone,
                    "fine": fine,
                    **counts,
                }
            ),
            flush=True,
        )


def run(quick):
    """Return all rows of the bench, by two processes."""
    todo = sets(quick)
    script = "import json, sys; from bench.sets import judge; judge(json.load(sys.stdin))"
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", script],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": "."},
        )
        for _ in range(2)
    ]
    for i, worker in enumerate(workers):
        assert worker.stdin is not None
        worker.stdin.write(json.dumps(todo[i::2]))
        worker.stdin.close()
    rows = []
    for worker in workers:
        assert worker.stdout is not None
        rows += [json.loads(line) for line in worker.stdout]
        assert worker.wait() == 0
    small = [r["seconds"] for r in rows if len(r["effects"]) <= 2]
    return [
        *rows,
        harness.target(
            "sets that compile and are packed throughout", len(todo), sum(r["fine"] for r in rows)
        ),
        harness.at_most(
            "compile time of one or two effects on top of the body, worst", ASKED, max(small), "s"
        ),
        harness.at_most(
            "compile time of 3 to 8 effects on top of the body, worst",
            ASKED,
            max(r["seconds"] for r in rows if len(r["effects"]) > 2),
            "s",
        ),
    ]


def report(rows):
    sets = harness.of_kind(rows, "set")
    parts = [
        {"word": word, "rows": [r for r in sets if len(r["effects"]) in sizes]}
        for word, sizes in (("one", [1]), ("two", [2]), ("3 to 8", range(3, 9)))
    ]
    alone = harness.median([r["alone"] for r in sets])
    harness.show(
        f"sets of effects; the body alone compiles in {alone:.2f} s",
        parts,
        "effects {word} | sets {count} | packed {fine} | median s {median:.2f}"
        f" | worst s {{worst:.2f}} | over {ASKED:g} s {{late}}",
        count=lambda part: len(part["rows"]),
        fine=lambda part: sum(r["fine"] for r in part["rows"]),
        median=lambda part: harness.median([r["seconds"] for r in part["rows"]]),
        worst=lambda part: max(r["seconds"] for r in part["rows"]),
        late=lambda part: sum(r["seconds"] > ASKED for r in part["rows"]),
    )
    names = {"names": lambda r: ", ".join(r["effects"])}
    slowest = sorted(sets, key=lambda r: -r["seconds"])[:8]
    harness.show("slowest to compile", slowest, "effects {names} | s {seconds:.2f}", **names)
    why = "{scalar} scalar instructions, {calls} calls {libm}"
    if bad := [r for r in sets if not r["fine"]]:
        harness.show("not packed", bad, f"effects {{names}} | why {why}", **names)
    harness.report_targets(rows)

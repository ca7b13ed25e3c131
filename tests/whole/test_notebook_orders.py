"""A notebook whose cells are edited and run in any order: each run gives what a fresh process gives
that runs the same definitions without a compiler.

A kernel of IPython runs cells in random order, each in a random one of its versions. The fresh
process repeats all definitions up to a run, in plain Python, and then this run.
"""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

CELLS = {  # the versions of each cell
    "number": ["K = 1.0", "K = 2.5"],
    "table": ["TABLE = (1.0, 2.0)", "TABLE = (1.5, *TABLE[1:])", "TABLE = (0.75, K)"],
    "helper": [
        "def law(x, by=K):\n    return by * K * x",
        "def law(x):\n    return K * x + 0.25 * x * x",
        "def law(x):\n    return deeper(x)",
    ],
    "deeper": ["def deeper(x):\n    return 0.5 * x", "deeper = lambda x: K * x / (1.0 + x * x)"],
    "closure": [
        "def made(c):\n    return lambda x: c * x\ninner = made(0.5)",
        "inner = made(K)",
        "made = lambda c: lambda x: c + x\ninner = made(2.0)",
    ],
    "njit": [
        "@numba.njit\ndef quick(x):\n    return K * x",
        "@numba.njit\ndef quick(x):\n    return 0.25 + deeper_still(x)",
        "quick(1.0)",  # Numba keeps what it reads now
    ],
    "deeper still": [
        "@numba.njit\ndef deeper_still(x):\n    return 0.5 * x",
        "@numba.njit\ndef deeper_still(x):\n    return K * x * x",
    ],
    "effect": [
        '@effect(units={"size": "N m"}, in_body=())\n'
        "class Push(NamedTuple):\n    size: float\n\n"
        "    def torque(self, q):\n        return (law(self.size) * q[0], inner(q[1]), TABLE[0])",
        '@effect(units={"size": "N m"}, in_body=())\n'
        "class Push(NamedTuple):\n    size: float\n\n"
        "    def torque(self, t, l):\n        return (law(self.size), -quick(l[1]), law(t))",
        "Push.torque = lambda self, q: (law(q[2]), 0.0 * q[0], self.size * K)",
    ],
    "observable": [
        '@observable(units="1", long_name="x", dims=())\n'
        "class Seen(NamedTuple):\n    at: float\n\n"
        "    def value(self, q, l):\n        return (law(self.at) + quick(q[1]) + l[0],)",
        "Seen.value = lambda self, l: (inner(l[0]) * TABLE[1],)",
    ],
    "event": [
        '@event(outputs={"rises": ("1", "rises", ())})\n'
        "class Rises(NamedTuple):\n    over: float\n\n"
        "    def level(self, l):\n        return law(l[0]) - self.over\n\n"
        "    def results(self, record):\n        return {'rises': K * record.count}",
        "Rises.level = lambda self, t: inner(t) - self.over",
    ],
}
START = (
    "import numba\nimport numpy as np\nfrom typing import NamedTuple\nimport rigidmc as rm\n"
    "from rigidmc.protocols import effect, event, observable"
)
RUN = (
    "_scene = rm.Scene(rm.Body((1.0, 2.0, 2.8)), Push(0.5), rm.Start(omega=(0.3, 2.0, 0.2)))\n"
    "_ds = rm.simulate(_scene, 'rk4', members=2, dt=0.05, t_end=0.5, every=0.25, progress=False,\n"
    "    save=['omega', Seen(1.5), Rises(0.1)])\n"
    "_found.append([float(x) for name in ('omega', 'seen', 'rises')\n"
    "    for x in np.ravel(_ds[name].values)])"
)
KERNEL = f"""
import json, sys, warnings
from IPython.core.interactiveshell import InteractiveShell

warnings.simplefilter("ignore")
shell, found = InteractiveShell.instance(), []
shell.user_ns["_found"] = found
for cell in json.load(sys.stdin):
    shell.run_cell({START!r} if cell == "start" else {RUN!r} if cell == "run" else cell, silent=True
        ).raise_error()
print("found", json.dumps(found))
"""
FRESH = f"""
import json, sys, warnings
warnings.simplefilter("ignore")
names = dict(_found=[], __name__="__main__")
for place, cell in enumerate(json.load(sys.stdin)):
    text = {START!r} if cell == "start" else {RUN!r} if cell == "run" else cell
    exec(compile(text, f"cell {{place}}", "exec"), names)
print("found", json.dumps(names["_found"]))
"""


def orders(seed, count):
    """The cells of a notebook: all first versions, then `count` random orders, each with a run."""
    rng = np.random.default_rng(seed)
    cells = ["start", *(versions[0] for versions in CELLS.values()), "run"]
    for _ in range(count):
        for _ in range(rng.integers(1, 5)):
            versions = CELLS[str(rng.choice([*CELLS]))]
            cells.append(str(rng.choice(versions)))
        cells.append("run")
    return cells


def ran(script, cells, **environment):
    """The numbers of each run of some cells, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", script],
        input=json.dumps(cells),
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    return json.loads(done.stdout.rpartition("found ")[2])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_each_run_of_a_notebook_is_that_of_a_fresh_process(seed, tmp_path):
    cells = orders(seed, 10)
    cache = {"RIGIDMC_CACHE_DIR": str(tmp_path)}
    found = np.array(ran(KERNEL, cells, **cache))
    assert len(found) == 11
    assert len({tuple(each) for each in found.tolist()}) > 5  # the cells matter
    worst = 0.0
    for run in range(len(found)):
        ends = [place for place, cell in enumerate(cells) if cell == "run"]
        definitions = [cell for cell in cells[: ends[run]] if cell != "run"]
        (fresh,) = ran(FRESH, [*definitions, "run"], NUMBA_DISABLE_JIT="1")
        worst = max(worst, float(np.abs(found[run] - fresh).max()))
    print(f"worst difference {worst:.1e}")
    assert worst < 1e-12

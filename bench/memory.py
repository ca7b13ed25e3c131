"""Peak memory of a large ensemble, by simulate() and from the shell, for any number of steps."""

import json
import os
import subprocess
import sys
import tempfile

from bench import harness, startup

MEMBERS = 2_000_000
ASKED = 1.5  # GB
GROWTH = 1.02  # for ten times the steps: allocators and page tables vary by one per cent

# A process between this one and the measured one: on Linux a child's ru_maxrss is at least the
# memory of its parent when it started the child: 10 MB here, up to 1 GB otherwise.
WATCH = """
import json, os, subprocess, sys
child = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
words = child.stderr.read()
_, status, usage = os.wait4(child.pid, 0)
code = os.waitstatus_to_exitcode(status)
words = words[-2000:].decode(errors="replace")
print(json.dumps({"code": code, "words": words, "kilobytes": usage.ru_maxrss}))
"""

# free tops with attitude, final state only
SIMULATE = """
import sys
import rigidmc as rm
members, t_end = int(sys.argv[1]), float(sys.argv[2])
spin = rm.Start(omega=(rm.normal(0, 0.01), rm.normal(0, 0.01), 6.28), attitude="uniform")
scene = rm.Scene(rm.Body.from_moments((1.15e-5, 3.97e-5, 2.92e-5)), start=spin)
run = dict(integrator="rk4", dt=0.01, t_end=t_end, members=members, seed=1)
data = rm.simulate(scene, **run, save=("omega", "attitude"))
assert int((data.status != 0).sum()) == 0
"""


def peak(command, folder):
    """Return the peak resident memory of a command [GB]; RuntimeError if it fails."""
    path = os.pathsep.join(filter(None, [os.getcwd(), os.environ.get("PYTHONPATH")]))
    watch = [sys.executable, "-I", "-S", "-c", WATCH, *command]
    done = subprocess.run(
        watch,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    facts = json.loads(done.stdout)
    if facts["code"] != 0:
        raise RuntimeError(
            f"{' '.join(command)[:200]} ended with {facts['code']}: {facts['words']}"
        )
    return facts["kilobytes"] * (1 if sys.platform == "darwin" else 1024) / 1e9


def run(quick):
    members, t_end = (200_000, 1.0) if quick else (MEMBERS, 10.0)
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:

        def simulated(t_end, _):
            return peak([sys.executable, "-c", SIMULATE, str(members), str(t_end)], folder)

        def commanded(t_end, name):
            text = f"run dzhanibekov --members {members} --t-end {t_end} --every {t_end}"
            return peak(startup.command(f"{text} --save omega,attitude -o", name), folder)

        rows = []
        for name, measure in (("simulate()", simulated), ("rigidmc run -o FILE", commanded)):
            first = measure(t_end / 10, "first.nc")  # compiles, which takes 50 MB
            short, long = measure(t_end / 10, "short.nc"), measure(t_end, "long.nc")
            known = {"name": name, "members": members}
            what = f"{name}, {members:,} members, final state"
            rows += [
                harness.row("peak", **known, what="first run", t_end=t_end / 10, gigabytes=first),
                harness.row("peak", **known, what="short", t_end=t_end / 10, gigabytes=short),
                harness.row("peak", **known, what="long", t_end=t_end, gigabytes=long),
                harness.at_most(what, ASKED, max(first, long), "GB"),
                harness.at_most(f"{name}, ten times the steps", GROWTH, long / short, "x"),
            ]
    return rows


def report(rows):
    harness.report_targets(rows)

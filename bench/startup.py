"""Wall-clock seconds until something runs, from the shell and by the first `simulate()`.

Each first `simulate()` uses another capability, in a fresh process with an empty disk cache;
`python -m bench calls` has calls of compiled code.
"""

import itertools
import os
import subprocess
import sys
import tempfile
import time

from bench import harness

README = (
    "run dzhanibekov --members 100000 -o dzhanibekov.nc --plot dzhanibekov.png"  # its first command
)
TOUCH = "import rigidmc as rm; rm.Scene, rm.Body, rm.Start, rm.simulate, rm.prepare"
SECOND = "import rigidmc as rm; rm.simulate('dzhanibekov', members=1000)"
SCRIPTS = {  # name: (what a process runs with kernels in the cache, target in seconds)
    "import rigidmc and touch its API": (TOUCH, 0.5),
    "second process of a day": (SECOND, 0.7),
}
RUN = "run dzhanibekov --members 1000 -o"
COMMANDS = {  # name: (words, whether the cache is empty, target in seconds)
    "--help": ("--help", False, 0.2),
    "scenes": ("scenes", False, 0.2),
    "first run ever of 1,000 tops": (f"{RUN} first.nc --force", True, 12.0),
    "second run": (f"{RUN} second.nc --force", False, 2.5),
    "README's first command": (f"{README} --force", True, 6.0),
    "accuracy heavy_top": ("accuracy heavy_top", True, 35.0),
}
HEAVY, WATCHED = ("gravity",), ("omega", "attitude")
# name: ([(integrator, effects, save) of each call], timing the last; target in seconds)
CALLS = {
    "rk4 free": ([("rk4", (), WATCHED)], 2.0),
    "rk4 gravity": ([("rk4", HEAVY, WATCHED)], 3.0),
    "rk8": ([("rk8", HEAVY, WATCHED)], 2.5),
    **{name: ([(name, HEAVY, WATCHED)], 5.0) for name in ("strang", "srkn11", "midpoint")},
    "exact": ([("exact", (), WATCHED)], 5.0),
    "events": ([("rk4", (), ("omega", "flips"))], 3.5),
    "statistics": ([("rk4", HEAVY, ("omega", "omega_max", "energy_mean", "energy_variance"))], 5.0),
    "noise": ([("strang", ("bath",), WATCHED)], 5.0),
    "MEGNO": ([("rk4", HEAVY, ("omega", "megno"))], 5.0),
    "all built-in effects but the random one": ([("cf4", None, WATCHED)], 10.0),
    "another save": ([("rk4", HEAVY, WATCHED), ("rk4", HEAVY, (*WATCHED, "energy"))], 1.0),
    "another event": (
        [("rk4", HEAVY, (*WATCHED, "flips")), ("rk4", HEAVY, (*WATCHED, "passage"))],
        1.0,
    ),
}


def command(text="", *more):
    """Return the words that start rigidmc, and those of a text: the script next to this Python, or
    the entry point if rigidmc is not installed.
    """
    script = os.path.join(os.path.dirname(sys.executable), "rigidmc")
    entry = [sys.executable, "-c", "from rigidmc.cli import main; main()"]
    return [*([script] if os.path.exists(script) else entry), *text.split(), *map(str, more)]


def silently(text, *more):
    """Run a command of rigidmc, which must succeed, without its words."""
    words = command(text, *more)
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def ran(words, folder, cache):
    """Return (wall seconds, output) of one process in a folder, with kernels cached in `cache`.

    RuntimeError with the end of its output if it fails.
    """
    # finds the package even if it is not installed, although the run has another folder
    path = os.pathsep.join(filter(None, [os.getcwd(), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "RIGIDMC_CACHE_DIR": cache, "PYTHONPATH": path}
    began = time.perf_counter()
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    took = time.perf_counter() - began
    if done.returncode != 0:
        raise RuntimeError(
            f"{' '.join(words)} ended with {done.returncode}: "
            f"{(done.stderr or done.stdout)[-2000:]}"
        )
    return took, done.stdout


def call(name):
    """Print, in a separate process, the seconds of the last of some calls of `simulate`."""
    import rigidmc as rm
    from rigidmc.physics.effects import EFFECTS
    from rigidmc.physics.effects.protocol import from_numbers, is_random, user_parameters

    body = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
    start = rm.Start(omega=(0.5, 0.7, rm.normal(0.5, 0.1)), attitude=(1.0, 0.0, 0.0, 0.0))
    for integrator, names, save in CALLS[name][0]:
        wanted = (
            [
                # a body on an orbit has no centre off its fixed point
                word
                for word, kind in EFFECTS.items()
                if not is_random(kind) and word != "gravity_gradient"
            ]
            if names is None
            else names
        )
        effects = tuple(
            EFFECTS[word](
                *from_numbers(EFFECTS[word], itertools.repeat(0.1))[
                    : len(user_parameters(EFFECTS[word]))
                ]
            )
            for word in wanted
        )
        events = {"flips": rm.Flips(2), "passage": rm.Passage(3, 0.5)}
        scene = rm.Scene(body, effects, start)
        began = time.perf_counter()
        rm.simulate(
            scene,
            integrator=integrator,
            dt=0.01,
            t_end=0.1,
            members=64,
            save=tuple(events.get(word, word) for word in save),
        )
        taken = time.perf_counter() - began
    print(taken)


def run(quick):
    times: dict[str, list[float]] = {what: [] for what in (*COMMANDS, *SCRIPTS, *CALLS)}
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
        caches = (os.path.join(folder, f"cache{i}") for i in itertools.count())
        known = next(caches)
        ran(command(f"{RUN} known.nc"), folder, known)
        for _ in range(1 if quick else 3):
            for what, (words, empty, _) in COMMANDS.items():
                cache = next(caches) if empty else known
                times[what].append(ran(command(words), folder, cache)[0])
            for what, (script, _) in SCRIPTS.items():
                words = [sys.executable, "-c", script]
                times[what].append(ran(words, folder, known)[0])
            for what in CALLS:
                words = [sys.executable, "-c", f"from bench.startup import call; call({what!r})"]
                times[what].append(float(ran(words, folder, next(caches))[1]))
    asked = {what: given[-1] for what, given in {**COMMANDS, **SCRIPTS, **CALLS}.items()}
    rows = [{"kind": "seconds", "name": what, "seconds": taken} for what, taken in times.items()]
    return rows + [
        harness.at_most(
            what,
            asked[what],
            harness.median(taken),
            "s",
            note=f"{len(taken)} times, {min(taken):.4g} to {max(taken):.4g} s",
        )
        for what, taken in times.items()
    ]


def report(rows):
    harness.report_targets(rows)

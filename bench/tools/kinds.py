"""Define the items of `bench.fingerprints`: functions that give (item, text), by kind.

Not included: bits over integrators and CPUs (`python -m bench bits`), integrator = "auto" and the
cheapest candidates of `accuracy`, which depend on measured times, GPUs, clusters, animations,
progress, and docstrings.
"""

import functools
import glob
import json
import os
import re
import shutil
import warnings

import numpy as np
import xarray as xr

from bench.tools import mistakes
from bench.tools.texts import (
    commands,
    done_well,
    each,
    fields,
    masked,
    pixels,
    read,
    sha,
    side_by_side,
    signature,
    stored,
    told,
    whole,
)

HERE = os.path.dirname(os.path.abspath(__file__))
MEMBERS, SAVES = 40, 16  # of a scene: two blocks or shards, the second of which is not full
WIDTHS = (1, 4)  # vector widths in members, besides the 8 or 16 that suit the CPU
SHARDS = ("--shard-time", 1e-9)  # as short as possible: 32 members
KINDS = {}  # {kind: function of a number of threads}


def kind(function):
    """Register a kind by the name of its function."""
    KINDS[function.__name__.replace("_", " ")] = function
    return function


@functools.cache
def names(of):
    """Return the names that a command lists: the first words of its lines without indent."""
    lines = done_well(*of.split()).splitlines()[:-1]
    return tuple(found[0] for line in lines if (found := re.match(r"[a-z]\w*(?= )", line)))


def shipped():
    """Return (name, scene with few members and saves) of all shipped scenes."""
    import rigidmc as rm

    for name in names("scenes"):
        scene = rm.Scene.load(name)
        yield name, scene.with_run(members=MEMBERS, t_end=SAVES * scene.run.every)


def written(path, scene):
    """Write a scene to a file and return its text."""
    text = scene.dumps()
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    return text


# Scenes


@kind
def scenes(threads, only=None):
    """Run all shipped scenes by their names."""
    import rigidmc as rm

    for name, few in shipped():
        if only is None or name in only:
            run = {"members": MEMBERS, "t_end": few.run.t_end}
            yield from each(name, rm.simulate(name, threads=threads, **run))


@kind
def scene_files(threads):
    """Run them from files, and read their results from files."""
    import rigidmc as rm

    for name, few in shipped():
        yield f"{name}: text", written(f"{name}.toml", few)
        yield f"{name}: from a file", whole(rm.simulate(f"{name}.toml", threads=threads))
        # with several threads, blocks come in the file in the order in which they finish
        rm.simulate(few, threads=1, output=f"{name}.nc").close()
        with rm.open(f"{name}.nc") as ds:
            yield f"{name}: opened", whole(ds)
        yield f"{name}: stored", stored(f"{name}.nc")
        with open(f"{name}.nc", "rb") as file:
            yield f"{name}: bytes", sha(file.read())
        yield f"{name}: scene of the result", rm.Scene.load(f"{name}.nc").dumps()


@kind
def run_directories(threads):
    """Run them as run directories of two shards: their files, and the Datasets they open as."""
    import rigidmc as rm

    for name, few in shipped():
        written(f"{name}.toml", few)
        run = ("run", f"{name}.toml", "-o", f"{name}/", *SHARDS, "--threads", threads)
        yield f"{name}: printed", done_well(*run)
        facts = json.loads(read(f"{name}/run.json"))
        for moving in ("versions", "machine", "check"):
            facts.pop(moving)
        yield f"{name}: run.json", masked(json.dumps(facts, indent=1))
        yield f"{name}: scene.toml", read(f"{name}/scene.toml")
        shards = sorted(glob.glob(f"{name}/shards/*.nc"))
        # the name of a shard ends in the hash of its bytes
        yield f"{name}: shards, bytes", "\n".join(map(os.path.basename, shards))
        yield f"{name}: shards, values", "".join(map(stored, shards))
        with rm.open(f"{name}/") as ds:
            yield f"{name}: opened", whole(ds)


@kind
def long_runs(threads):
    """Return the texts that commands of run directories print and write."""
    import rigidmc as rm

    few = ("--members", 100, "--t-end", 0.8, *SHARDS, "--max-wall", 1e-9)
    some = ("--threads", threads, "--shards")
    commands_of = (
        ("run", "tennis_racket", *few, "--threads", threads, "-o", "a/"), ("status", "a"),
        ("copy", "a", "b"), ("resume", "a", *some, "0:2"), ("status", "a"),
        ("summary", "a"), ("verify", "a"), ("resume", "b", *some, "2:4"),
        ("merge", "c", "a", "b"), ("status", "c"), ("verify", "c"), ("summary", "c"),
        ("resume", "a", "--threads", threads),
        ("extend", "a", "--members", 150, "--threads", threads), ("verify", "a"),
        ("consolidate", "a", "-o", "a.nc"),
    )  # fmt: skip
    for i, words in enumerate(commands_of, 1):
        if words[0] == "copy":
            shutil.copytree(*words[1:])
            continue
        yield f"{i}. {' '.join(words[:2])}", done_well(*words, codes=(0, 4, 5))
    for path in ("a/", "b/", "c/", "a.nc"):
        with rm.open(path) as ds:
            yield f"open {path}", whole(ds)


@kind
def widths(threads):
    """Run them by name, with other vector widths."""
    import rigidmc as rm

    for name, few in shipped():
        for width in WIDTHS:
            again = rm.Scene.loads(few.dumps(), name)
            with side_by_side(width):
                yield f"{name} x{width}", whole(rm.simulate(again, threads=threads))


def _settings():
    """Return {name: settings of a run} of the heavy top."""
    import rigidmc as rm

    state = "omega", "momentum", "attitude", "energy", "l2", "energy_drift", "l2_drift"
    last = "omega_mean", "energy_variance", "attitude_last", "l2_max", "omega_min"
    parts = (
        rm.Flips(2), rm.Passage(3, 0.45, "leaves"), rm.PointingAngle(1, (1.0, 0.0, 0.0)),
        rm.Histogram("energy", low=0.0, high=3.0, bins=8),
    )  # fmt: skip
    return {
        "float32": {"dtype": "float32"},
        "compensated": {"compensated": True},
        "steps of their own": {"turn": 0.1},
        "works and a tangent": {"save": (*state, "work", "megno")},
        "watched": {"save": ("nutation", "precession", *last, *parts)},
        "thinned": {"keep": "thinned", "thin": 4},
        "summary": {"keep": "summary"},
        "final": {"keep": "final"},
        "none": {"keep": "none"},
        "Sobol points": {"points": "sobol", "members": 64},
        "Latin hypercube": {"points": "latin_hypercube"},
        "antithetic pairs": {"points": "antithetic"},
        "shorter last interval": {"t_end": 0.1},
        "reduced step": {"dt": 0.0007},
        "flagged": {"energy_limit": 1e-9, "keep": "final"},
        "no checks": {"checks": False},
        "range of members": {"members": range(100, 140)},
        "chosen members": {"members": [3, 5, 1000]},
        "another seed": {"seed": 7},
        "compressed": {"compress": True},
        "digits": {"digits": 4},
    }


@kind
def settings(threads):
    """Run a heavy top with other settings: notes, result and file."""
    import rigidmc as rm

    for name, given in _settings().items():
        run = {"members": MEMBERS, "t_end": 0.128, "threads": threads, **given}
        with warnings.catch_warnings(record=True) as notes:
            warnings.simplefilter("always", rm.SceneWarning)
            yield name, whole(rm.simulate("heavy_top", **run))
        yield f"{name}: notes", masked("\n".join(str(note.message) for note in notes))
        rm.simulate("heavy_top", output=f"{name}.nc", **run).close()
        yield f"{name}: stored", stored(f"{name}.nc")


@kind
def own_parts(threads):
    """Run the examples of docs/how_to/own_parts.md from a file that a scene file names."""
    import rigidmc as rm

    page = read(os.path.join(HERE, "..", "..", "docs", "how_to", "own_parts.md"))
    parts = page.partition("## From a script")[0]
    for file, text, word in (("mine.py", parts, "python"), ("own.toml", page, "toml")):
        blocks = re.findall(rf"(?ms)^```{word}\n(.*?)^```$", text)
        with open(file, "w", encoding="utf-8") as made:
            made.write("\n".join(blocks))
    yield "result", whole(rm.simulate(rm.Scene.load("own.toml", allow_code=True), threads=threads))
    yield "show", done_well("show", "own.toml", "--allow-code", "--threads", 2)
    out = ("-o", "own.nc", "--threads", threads)
    yield "run", done_well("run", "own.toml", "--allow-code", *out)
    yield "stored", stored("own.nc")
    yield "rerun", whole(rm.rerun("own.nc", 3, allow_code=True))
    yield "integrators", done_well("integrators", "--scene", "own.toml", "--allow-code")


# Maps, studies, results


@kind
def maps(threads):
    """Compute all maps of the package at 8 x 8, and others, as functions, commands and
    directories."""
    import rigidmc as rm

    few = ("--resolution", 8, "--members", 2, "--threads", threads)
    for name in names("map list"):
        out = ("-o", f"{name}.nc", "--plot", f"{name}.png")
        yield f"{name}: printed", done_well("map", name, *few, *out)
        yield f"{name}: picture", pixels(f"{name}.png")
        yield from each(name, rm.open(f"{name}.nc"))
    yield "directory: printed", done_well("map", "growth", *few, *SHARDS, "-o", "growth/")
    yield "directory", whole(rm.open("growth/"))
    ds = rm.open("growth.nc")
    part = [tuple(ds[side].values[[2, 5]].tolist()) for side in ("x", "y")]
    yield "part", whole(rm.zoom_map("growth.nc", *part, threads=threads))
    sides = ("body.moments.1", 2e-6, 2e-5), ("start.omega.1", 0.01, 0.1, True)
    of, run = ("p(flips >= 1)", "mean(omega_max[1])"), {"t_end": 4.0, "threads": threads}
    third = {"z": ("start.omega.3", 0.0, 0.2), "layers": 3}
    yield from each("stack", rm.stability_map("dzhanibekov", *sides, of, 4, 2, **third, **run))
    found = rm.stability_map("dzhanibekov", *sides, of[0], 24, 2, adaptive=True, **run)
    yield from each("adaptive", found)


# {study: (scene, its request, its own parameters, settings)}
STUDIES = {
    "ftle": ("dzhanibekov", {}, {"families": 12}, {"t_end": 6.0}),
    "basins": (
        "damped_dzhanibekov", {"of": "p(omega_last[1] >= 0)"}, {"families": 16}, {"t_end": 20.0},
    ),
    "frequencies": ("dzhanibekov", {"of": "omega[1]"}, {}, {"members": 6, "t_end": 80.0}),
    "section": ("kovalevskaya", {"at": "omega[1] = 0"}, {}, {"members": 6, "t_end": 2.0}),
    "sensitivity": (
        "dzhanibekov", {"of": "mean(omega_max[1])"}, {"families": 16}, {"t_end": 4.0},
    ),
    "rare": (
        "dzhanibekov", {},
        {"of": "p(omega_max[1] >= 0.05)", "members": 64, "repetitions": 3, "target": 1e-6},
        {"t_end": 0.2},
    ),
    "multilevel": (
        "brownian_rotor", {}, {"until": "mean(energy_final) +- 10 %"}, {"t_end": 1e-4},
    ),
    "gradient": (
        "dzhanibekov", {"of": "mean(omega_last[1])"}, {"wrt": "start.omega.1,start.omega.2"},
        {"members": 40, "t_end": 2.0},
    ),
    "lyapunov": ("heavy_top", {}, {}, {"members": 4, "t_end": 2.0}),
}  # fmt: skip
# of studies without run directories: {command: (function, scene, its own parameters, settings)}
DIRECT = {
    "covariance": (
        "propagate", "dzhanibekov", {"of": "omega", "members": 40}, {"t_end": 2.0, "every": 1.0},
    ),
    "linearise": ("linearise", "dzhanibekov", {"starts": 8}, {}),
}  # fmt: skip


def options_of(*given):
    """Convert keywords to options of a command."""
    pairs = (pair for one in given for pair in one.items())
    return tuple(word for key, value in pairs for word in (f"--{key.replace('_', '-')}", value))


@kind
def studies(threads):
    """Run each study as a function, a command, a run directory and a picture, and growing
    ensembles."""
    import rigidmc as rm

    codes = (0, 4, 5)
    for name, (scene, asked, own, run) in STUDIES.items():
        ds = getattr(rm, name)(scene, **asked, **own, **run, threads=threads)
        yield from each(name, ds)
        words = (name, scene, *options_of(asked, own, run), "--threads", threads)
        yield f"{name}: printed", done_well(*words, "-o", f"{name}.nc", codes=codes)
        yield f"{name}: file", stored(f"{name}.nc")
        done_well(*words, "-o", f"{name}/", "--plot", f"{name}.png", codes=codes)
        yield f"{name}: picture", pixels(f"{name}.png")
        again = (name, f"{name}/", *options_of(asked), "-o", f"{name}-2.nc")
        yield f"{name}: directory, printed", done_well(*again, codes=codes)
        yield f"{name}: directory", stored(f"{name}-2.nc")
    for name, (function, scene, own, run) in DIRECT.items():
        yield from each(name, getattr(rm, function)(scene, **own, **run, threads=threads))
        out = ("-o", f"{name}.nc", "--plot", f"{name}.png", "--threads", threads)
        yield f"{name}: printed", done_well(name, scene, *options_of(own, run), *out)
        yield f"{name}: file", stored(f"{name}.nc")
        yield f"{name}: picture", pixels(f"{name}.png")
    noisy = {"members": 40, "repetitions": 2, "t_end": 1e-4, "threads": threads}
    yield from each("rare, noise", rm.rare("brownian_rotor", "p(energy_max >= 3e-20)", **noisy))
    found = rm.accuracy("dzhanibekov", ["rk4"], (1e-4, 1e-8), members=8, threads=threads)
    yield from each("accuracy", found)
    goal = {"dt": 0.025, "t_end": 2.5, "threads": threads}
    ds, interval = rm.simulate_until("dzhanibekov", "p(flips >= 1) +- 0.02", **goal)
    yield "simulate_until: interval", repr(tuple(interval))
    yield "simulate_until", whole(ds)
    points = {"points": "sobol", "members": 64, "randomisations": 4}
    yield (
        "randomised",
        repr(tuple(rm.estimate_rqmc("dzhanibekov", "p(flips >= 1)", **points, **goal))),
    )
    for scene in ("dzhanibekov", "heavy_top"):
        yield f"stress {scene}", told("stress", scene, "--quick")


@kind
def results(threads):
    """Use results: summary, measures, rerun, export, pictures, pages."""
    import rigidmc as rm

    run = {"members": MEMBERS, "threads": threads}
    save = ("omega", "attitude", "flips")
    rm.simulate("dzhanibekov", t_end=8.0, output="a.nc", save=save, **run).close()
    rm.simulate("heavy_top", t_end=0.4, output="b.nc", save=("attitude",), **run).close()
    for file in ("a.nc", "b.nc"):
        yield f"summary {file}", done_well("summary", file)
        yield f"run {file}", done_well("run", file, "--threads", threads)
        yield f"rerun {file}", whole(rm.rerun(file, 3))
        some = {"every": 0.1, "save": ("energy", "momentum")}
        yield f"rerun {file}, some", whole(rm.rerun(file, range(2, 5), **some))
        yield f"rerun {file}, printed", done_well("rerun", file, "--member", 1)
        yield f"view {file}", done_well("view", file, "-o", f"{file}.html")
        yield f"view {file}, page", sha(masked(read(f"{file}.html")))
        for ending in ("csv", "zarr", "parquet"):
            made = f"{file[0]}.{ending}"
            yield f"export {made}, printed", done_well("export", file, "-o", made)
            yield f"export {made}", _exported(made)
        for picture in ("summary", "trajectory", "angles", "phase_portrait", "effective_potential",
                        "polhodes", "poinsot", "middle_component", "start_and_end",
                        "drift_histogram", "gibbs"):  # fmt: skip
            made = f"{file[0]}-{picture}.png"
            text = told("plot", file, "-o", made, "--picture", picture)
            yield f"plot {made}", text + (pixels(made) if os.path.exists(made) else "")
    for of in ("p(flips >= 1)", "mean(flip_wait)", "median(flip_first)", "quantile(flips, 0.9)"):
        yield f"summary of {of}", done_well("summary", "a.nc", "--of", of)
        with rm.open("a.nc") as ds:
            yield f"measure {of}", repr(ds.rigid.measure(of))


def _exported(path):
    """Read a table or a zarr store as a text."""
    if path.endswith(".zarr"):
        import rigidmc as rm

        with rm.open(path) as ds:
            return whole(ds)
    if path.endswith(".parquet"):
        import pyarrow.parquet

        return json.dumps(pyarrow.parquet.read_table(path).to_pydict())
    return read(path)


@kind
def hard_cases(threads):
    """Run `rigidmc stress --quick`: an item for each case, a line for each integrator."""
    done_well("stress", "--quick", "--threads", threads, "-o", "stress.nc")
    with xr.open_dataset("stress.nc") as ds:
        rows = ds.load()
    for i, case in enumerate(rows.case.values):
        one = rows.isel(case=i)
        lines = [f"{one.group.item()}: {one.why.item()} ({one.truth.item()})"]
        for j, name in enumerate(rows.integrator.values):
            here = {key: one[key].values[j] for key in ("verdict", "error", "bound", "reason")}
            lines.append(f"{name}: {', '.join(f'{key} {value}' for key, value in here.items())}")
        yield str(case), masked("\n".join(lines))


# (moments, momentum): asymmetric, symmetric, near the separatrix, at rest, in another order, a ball
FREE = (
    ((1.0, 2.0, 3.0), (0.0, 1.0, 0.5)), ((1.0, 1.0, 2.0), (0.3, 0.4, 1.0)),
    ((1.0, 2.0, 3.0), (1e-7, 1.0, 1e-7)), ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0)),
    ((3.0, 1.0, 2.0), (1.0, 0.2, -0.3)), ((1.0, 1.0, 1.0), (0.1, 0.2, 0.3)),
)  # fmt: skip
# (weight, momentum, tilt): falling, sleeping, hanging, fast, nearly upright
HEAVY = (
    (1.0, (0.0, 0.0, 2.0), 0.4), (1.0, (0.0, 0.0, 3.0), 0.0), (1.0, (0.1, 0.2, 0.0), 3.0),
    (1.0, (0.3, 0.0, 50.0), 1.0), (2.0, (0.0, 0.0, 1.0), 1e-3),
)  # fmt: skip


@kind
def closed_forms(threads):
    """Solve free and heavy tops at any time, and run `rigidmc exact`."""
    import rigidmc as rm

    times = np.array([0.0, 0.1, 1.0, 37.0, 1e6])
    for i, (moments, momentum) in enumerate(FREE, 1):
        top = moments, momentum
        yield f"free top {i}", fields(rm.solve_free_top(*top, (1.0, 0.0, 0.0, 0.0), times))
        yield f"free motion {i}", fields(rm.analyse_free_top(*top))
    for i, (weight, momentum, tilt) in enumerate(HEAVY, 1):
        q = (np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0)
        top = (1.0, 1.0, 0.5), weight, momentum, q
        yield f"heavy top {i}", fields(rm.solve_lagrange_top(*top, times))
        yield f"heavy motion {i}", fields(rm.analyse_lagrange_top(*top))
    for name in names("scenes"):
        yield f"exact {name}", told("exact", name, "--members", 3)


# Words


@kind
def help_pages(threads):
    """Print `--help` of all commands."""
    import typer.main

    yield "rigidmc", done_well("--help")
    for name in typer.main.get_command(commands()).commands:
        yield name, done_well(name, "--help")


@kind
def show(threads):
    """Print `rigidmc show` of all scenes, for two threads."""
    for name in names("scenes"):
        yield name, done_well("show", name, "--threads", 2)


@kind
def check(threads):
    """Print `rigidmc check` and `rigidmc body` of all scenes."""
    for name in names("scenes"):
        yield f"check {name}", done_well("check", name)
        yield f"body {name}", done_well("body", name)
        yield f"body {name}, JSON", done_well("body", name, "--json")


@kind
def lists(threads):
    """Print everything that can be listed and explained, new scene files, and public names with
    their parameters."""
    import rigidmc as rm

    for of in ("effects", "observables", "integrators"):
        yield of, done_well(of)
        for name in names(of):
            if (text := told(of, name)).endswith("exit code 0\n"):  # else a word of a heading
                yield f"{of} {name}", text
    for words in (("scenes",), ("map", "list"), ("integrators", "--scene", "heavy_top")):
        yield " ".join(words), done_well(*words)
    for name in names("map list"):
        yield f"map list {name}", done_well("map", "list", name)
    for words in (
        (), ("--solid", "cone"), ("--solid", "box", "--gravity", "none", "--members", "1e4"),
        ("--moments", "1,2,2.5", "--spin", "1,2,3", "--lean", "20deg"),
    ):  # fmt: skip
        item = " ".join(("new", *words))
        done_well("new", "new.toml", "--force", *words)
        yield item, read("new.toml")
    for name in sorted(rm.__all__):
        yield f"rigidmc.{name}", signature(getattr(rm, name))


@kind
def errors(threads):
    """Return the text and the exit code of each mistake."""
    mistakes.prepare(done_well)
    for name, words in mistakes.commands():
        text = told(*words)
        if text.endswith("exit code 0\n") and "note" not in text:
            raise RuntimeError(f"{name} is not a mistake: {text}")
        yield name, text
    for name, call in mistakes.CALLS.items():
        yield f"Python: {name}", masked(mistakes.error_of(call))

"""One result wherever it is computed, for random scenes.

In memory, in a file, in a run directory, consolidated, on a cluster, by any threads and blocks. 5
scenes of as many kinds; 305 of 35 kinds, and two processes of a cluster, with `pytest -m slow
tests/whole/test_same_result_everywhere.py` (12 minutes).
"""

import warnings

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.runs.directory import gather, resume
from rigidmc.runs.directory.create import create
from tests.tools import random_scenes
from tests.tools.random_scenes import QUICK

MEMBERS = 193  # not a multiple of the lanes, and several blocks


def quiet(made, *words, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)
        return made(*words, **options)


def unlike(one, other, ignored=()):
    """Names of variables and attributes of two results that are not equal to the bit."""
    names = [name for name in (*one.variables, *other.variables) if name not in ("quat", "effect")]
    wrong = [
        name
        for name in names
        if name not in one or name not in other or not alike(one[name], other[name])
    ]
    keys = {key for key in (one.attrs | other.attrs) if key not in ignored}
    return wrong + [
        key
        for key in keys
        if key not in one.attrs
        or key not in other.attrs
        or not np.array_equal(one.attrs[key], other.attrs[key])
    ]


def alike(one, other):
    same = one.attrs.keys() == other.attrs.keys() and all(
        np.array_equal(v, other.attrs[k]) for k, v in one.attrs.items()
    )
    return (
        same
        and one.dims == other.dims
        and one.dtype == other.dtype
        and np.array_equal(one.values, other.values, equal_nan=True)
    )


def everywhere(scene, folder, cluster=None):
    """{where: what differs from the result in memory}, and that result."""
    scene = scene.with_run(
        members=MEMBERS, save=("omega", "attitude", "energy"), every=scene.run.t_end / 2
    )
    memory = quiet(rm.simulate, scene, threads=2)
    found = {
        f"{threads} threads, blocks of {block}": unlike(
            memory, quiet(rm.simulate, scene, threads=threads, block=block)
        )
        for threads, block in ((1, 32), (3, 96))
    }
    with quiet(rm.simulate, scene, output=folder / "one.nc", block=64) as file:
        found["file"] = unlike(memory, file)
    path = folder / "run"
    quiet(create, scene, path, 1e3)
    quiet(resume.resume, path, threads=2, cluster=cluster)
    with (
        quiet(rm.open, path) as directory,
        quiet(gather.consolidate, path, folder / "all.nc") as whole,
    ):
        found |= {"run directory": unlike(memory, directory), "consolidated": unlike(memory, whole)}
    return found, memory


def not_what_was_used(scene, memory):
    """Names of stored inputs that are not those of the members: of the state at t = 0, and of
    members that are integrated again.
    """
    # omega is L/I of L = I omega: 4e-16
    at_rest = [("start_attitude", "attitude", 0.0), ("start_omega", "omega", 1e-14)]
    wrong = [
        stored
        for stored, name, most in at_rest
        if stored in memory
        and np.nanmax(
            np.abs(memory[stored] - memory[name].isel(time=0)) / (1.0 + np.abs(memory[stored]))
        )
        > most
    ]
    one = quiet(memory.rigid.rerun, MEMBERS // 2)
    return wrong + ["rerun"] * (not one.attrs["rerun"].startswith("equal"))


def checked(kind, seed, folder, cluster=None):
    scene = random_scenes.scene(kind, seed, MEMBERS)
    if kind.integrator == "closed" and not random_scenes.covered(scene):
        return {}
    found, memory = everywhere(scene, folder, cluster)
    return {
        where: names
        for where, names in (found | {"inputs": not_what_was_used(scene, memory)}).items()
        if names
    }


# What compiles elsewhere, and float32; the others take 2 to 6 s each to compile.
KEPT = 0, 2, 4, 8, 9
SOME = [i if i in KEPT else pytest.param(i, marks=pytest.mark.slow) for i in range(len(QUICK))]


@pytest.mark.parametrize("i", SOME)
def test_one_result(i, tmp_path):
    assert checked(QUICK[i], 20 + i, tmp_path) == {}


@pytest.mark.slow
@pytest.mark.parametrize("i", range(30))
def test_one_result_of_many_scenes(i, tmp_path):
    (kind,) = random_scenes.kinds(1, seed=1000 + i)
    for seed in range(10):
        folder = tmp_path / str(seed)
        folder.mkdir()
        assert checked(kind, seed, folder, "local:2" if seed == 0 and i % 10 == 0 else None) == {}


def test_a_law_is_each_members_own():
    """Plain numbers of a law are shared, and drawn numbers are not. Before, the start of one member
    stood for all, a different one in each run.
    """
    for start in (
        rm.Start(momentum=rm.Sphere(2.0)),
        rm.Start(omega=rm.Sphere(2.0)),
        rm.Start(momentum=rm.GibbsMomentum(1.0)),
    ):
        scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.8)), start=start)
        ds = rm.simulate(scene, dt=0.01, t_end=0.02, members=100, save=("momentum",))
        momentum = ds.start_momentum if "start_momentum" in ds else ds.start_omega * ds.moments
        assert np.abs(momentum - ds.momentum.isel(time=0)).max() < 1e-15  # measured 0
        assert np.unique(ds.momentum.isel(time=0).values[0]).size == 100

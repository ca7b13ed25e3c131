"""Listed saves, and saves chosen to plot: the same bits as in a run that saves every step."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.dataset import open_run
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.directory.resume import resume
from tests.tools.commands import invoke

TIMES = (0.05, 0.3, 0.31, 1.2)
BODY = rm.Body.from_moments((1.0, 1.4, 2.0))
SCENE = rm.Scene(BODY, start=rm.Start(omega=(rm.normal(0.1, 0.05), 3.0, 0.1))).with_run(
    members=70, t_end=1.5, dt=0.01
)


def at_times(result, times=TIMES):
    return result.omega.sel(time=[0.0, *times, 1.5], method="nearest").values


@pytest.fixture(scope="module")
def dense():
    return rm.simulate(SCENE, every=0.01)


def test_listed_saves_have_the_bits_of_dense_ones(dense, tmp_path):
    listed = SCENE.with_run(every=np.array(TIMES))
    result = rm.simulate(listed, threads=2, block=32)
    assert result.time.values == pytest.approx([0.0, *TIMES, 1.5], rel=1e-14)
    assert np.array_equal(result.omega, at_times(dense))
    assert rm.Scene.loads(result.attrs["scene"]).run.every == TIMES

    some = rm.simulate(listed, members=[3, 40, 69])
    assert np.array_equal(some.omega, result.omega.sel(member=[3, 40, 69]))
    again = rm.rerun(result, 40)
    assert again.attrs["rerun"] == "equal to the bit at 6 times in omega"
    finer = rm.rerun(dense, 40, every=TIMES)
    assert np.array_equal(finer.omega, result.omega.sel(member=[40]))
    with pytest.raises(rm.SceneError, match="nearest of which ends at 0"):
        rm.rerun(dense, 40, every=[0.1234567891, 0.7654321987])

    path = str(tmp_path / "run")
    resume(create(listed, path, 1e3), threads=1)
    assert np.array_equal(open_run(path).omega, result.omega)
    assert RunDirectory(path).facts["members"] == 70


def test_own_steps_and_derivatives_at_listed_times():
    own = rm.simulate(SCENE, turn=0.2, every=TIMES)
    truth = rm.simulate(SCENE, integrator="closed", every=TIMES)
    off = np.abs(own.omega - truth.omega).max()
    assert 1e-12 < off < 3e-10  # measured 7.1e-11: rk4 with steps of up to 0.2 rad

    wrt = SCENE.with_run(members=2, wrt=("start.omega.2",))
    dense = rm.simulate(wrt, every=0.01)
    listed = rm.simulate(wrt, every=TIMES)
    assert np.array_equal(
        listed.d_omega, dense.d_omega.sel(time=[0.0, *TIMES, 1.5], method="nearest")
    )


def test_few_members_have_the_last_bits_of_many(dense):
    many, few = rm.simulate(SCENE), rm.simulate(SCENE, members=3)
    assert (many.sizes["time"], few.sizes["time"]) == (2, 151)
    assert np.array_equal(few.omega, dense.omega[..., :3])
    assert np.array_equal(few.omega[-1], many.omega[-1, :, :3])
    part = rm.simulate(SCENE, members=range(60, 70))  # saves as the whole
    assert np.array_equal(part.omega, many.omega[..., 60:])
    again = rm.rerun(many, 2)  # saves as in the result
    assert again.attrs["rerun"] == "equal to the bit at 2 times in omega"
    assert again.sizes["time"] == 2


def test_commands_take_save_times(tmp_path):
    (tmp_path / "top.toml").write_text(SCENE.dumps())

    def run(*words):
        return invoke("run", tmp_path / "top.toml", *words)

    for every, count in (("0.05,0.3,1.2", 5), ("20/turn", 6), (None, 151)):
        file = str(tmp_path / f"{count}.nc")
        words = [] if every is None else ["--every", every]
        found = run("--members", "1", *words, "-o", file)
        assert found.exit_code == 0, found.output
        with rm.open(file) as result:
            assert result.sizes["time"] == count
    wrong = run("--every", "50/trun")
    assert wrong.exit_code == 3 and "did you mean '50/turn'" in " ".join(wrong.output.split())

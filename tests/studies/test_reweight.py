"""Weights of a finished ensemble: closed forms, runs of the other distributions, refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import rigidmc as rm
from rigidmc.errors import FileError, OptionError, SceneError
from rigidmc.scene import distributions
from rigidmc.studies.reweight import reweight, table
from tests.tools.commands import invoke

BODY = rm.Body.from_moments((1.0, 1.5, 2.0))
RUN = {"integrator": "exact", "dt": 0.1, "t_end": 0.1}
SPIN = "omega_final[3]"


def scene(omega=(0.0, 0.0, 1.0), body=BODY, effects=(), **start):
    spin = {} if "momentum" in start else {"omega": omega}
    return rm.Scene(body, effects, rm.Start(**spin, **start))


def spun(law, members=2000, seed=0):
    """The result of members that spin about axis 3."""
    return rm.simulate(scene((0.0, 0.0, law)), members=members, seed=seed, **RUN)


def row(study, measure, which="new"):
    found = study.sel(measure=measure, distribution=which)
    return float(found.estimate), float(found.standard_error)


def test_a_shifted_normal_has_the_closed_form():
    n, shift = 20_000, 1.0
    ds = spun(rm.normal(1.0, 0.1), n)
    study = reweight(ds, scene((0.0, 0.0, rm.normal(1.1, 0.1))), f"mean({SPIN})")
    mean, error = row(study, f"mean({SPIN})")
    assert abs(mean - 1.1) < 3.0 * error and error < 0.003  # measured 1.1007, error .0017
    weight, x = study.weight.values, ds.start_omega.values[2]
    assert weight.sum() == pytest.approx(1.0, abs=1e-12)
    assert np.allclose(np.log(weight / weight[0]), 10.0 * (x - x[0]), rtol=1e-9, atol=1e-9)
    variance = weight @ (x - weight @ x) ** 2
    assert abs(variance / 0.01 - 1.0) < 0.1  # measured 0.03
    effective = study.attrs["effective_size"]
    assert abs(effective / (n * math.exp(-(shift**2))) - 1.0) < 0.06  # measured 0.018
    assert row(study, f"mean({SPIN})", "old")[0] == pytest.approx(float(x.mean()), rel=1e-12)
    # no member is drawn anew: a result without its starts has the same weights, to the bit
    some = [3, 5, 9, 900, 901, 15_000, *range(16_000, 19_000)]
    part = reweight(ds.isel(member=some), scene((0.0, 0.0, rm.normal(1.1, 0.1))), f"mean({SPIN})")
    assert np.allclose(part.weight, weight[some] / weight[some].sum(), rtol=1e-12)
    bare = reweight(
        ds.drop_vars(["start_omega", "moments"]), scene((0.0, 0.0, rm.normal(1.1, 0.1)))
    )
    assert np.array_equal(bare.weight.values, weight)


@pytest.mark.parametrize("shift", [0.5, 1.5])
def test_the_effective_size_falls_as_the_distribution_moves(shift):
    study = reweight(
        spun(rm.normal(1.0, 0.1), 20_000), scene((0.0, 0.0, rm.normal(1.0 + 0.1 * shift, 0.1)))
    )
    assert study.attrs["effective_size"] / (20_000 * math.exp(-(shift**2))) == pytest.approx(
        1.0, abs=0.05
    )
    assert (study.attrs["tail"] > 0.5) == (shift > 1.0) == ("few members decide" in table(study)[1])


def pulls(shift, of, truth, size=1000, seeds=200):
    """(estimate - truth)/error of ensembles of `size` members, by the seed of each."""
    ds = spun(rm.normal(1.0, 0.1), size * seeds)
    new = scene((0.0, 0.0, rm.normal(1.0 + 0.1 * shift, 0.1)))
    found = []
    for i in range(seeds):
        part = ds.isel(member=slice(i * size, (i + 1) * size))
        value, error = row(reweight(part, new, of), of)
        found.append((value - truth) / error)
    return np.array(found)


@pytest.mark.parametrize(
    ("of", "shift", "truth"),
    [
        (f"mean({SPIN})", 0.5, 1.05),
        (f"p({SPIN} >= 1.1)", 0.5, stats.norm.sf(0.5)),
        (f"median({SPIN})", 0.8, 1.08),
    ],
)
def test_errors_are_those_of_200_ensembles(of, shift, truth):
    pull = pulls(shift, of, truth)
    # the variance of 200 numbers has the standard deviation .1: measured .92 to .97
    assert abs(pull.var() - 1.0) < 0.3 and abs(pull.mean()) < 0.22  # measured .03 at most
    assert abs(np.mean(np.abs(pull) < 1.96) - 0.95) < 0.05  # measured .945 to .965


@pytest.mark.slow
def test_intervals_that_cover_less_are_told():
    """What the constant TAIL says of the coverage at 1 and at 1.5 standard deviations."""
    for shift, size, covers in ((1.0, 1000, 0.93), (1.5, 5000, 0.88)):
        pull = pulls(shift, f"mean({SPIN})", 1.0 + 0.1 * shift, size, 500)
        assert np.mean(np.abs(pull) < 1.96) == pytest.approx(covers, abs=0.03)


SECOND = rm.SecondMoments((rm.normal(1.0, 0.1), rm.normal(1.5, 0.1), rm.normal(0.8, 0.1)))
TRIPLE = (rm.normal(1.0, 0.2), rm.normal(0.5, 0.2), rm.normal(-0.5, 0.2))


def drawn(mean):
    return rm.Body.from_moments((1.0, 1.5, rm.normal(mean, 0.1)))


def together(moment, spin):
    """A moment and a spin with numbers in common, as a fit writes them."""
    return scene((0, 0, rm.common(*spin)), rm.Body.from_moments((1.0, 1.5, rm.common(*moment))))


FITTED = rm.Correlated((1.05, 0.4, -0.5), np.diag((0.02, 0.03, 0.02)) + 0.005)


def moved(by):
    return rm.Correlated((1.05 + by, 0.4, -0.5), FITTED.covariance)


TURNED = rm.Body.from_tensor([[2.0, 0.3, 0.0], [0.3, 2.5, 0.1], [0.0, 0.1, 3.0]])
BENT = rm.mixture((3.0, rm.normal(1.0, 0.1)), (1.0, rm.uniform(0.0, 2.0)))
CASES = {
    "narrower": ((scene((0, 0, rm.normal(1.0, 0.2))), scene((0, 0, rm.normal(0.9, 0.1)))), SPIN),
    "truncated": (
        (scene((0, 0, rm.normal(1.0, 0.2))), scene((0, 0, rm.normal(1.0, 0.2).between(1.1, 1.5)))),
        SPIN,
    ),
    "mixture": ((scene((0, 0, BENT)), scene((0, 0, rm.normal(1.2, 0.1)))), SPIN),
    "scipy": (
        (
            scene((0, 0, rm.distribution("gamma", a=4.0, scale=0.2))),
            scene((0, 0, rm.distribution("gamma", a=5.0, scale=0.2))),
        ),
        SPIN,
    ),
    "two of three": (
        (scene(TRIPLE), scene((rm.normal(1.1, 0.2), *TRIPLE[1:2], rm.normal(-0.6, 0.2)))),
        SPIN,
    ),
    "a fitted scene": ((scene(TRIPLE), scene(FITTED)), "omega_final[2]"),
    "fitted twice": ((scene(FITTED), scene(TRIPLE)), "omega_final[2]"),
    "fitted, in described axes": ((scene(TRIPLE, TURNED), scene(FITTED, TURNED)), "omega_final[2]"),
    "cone": (
        (
            scene(rm.Cone(3, rm.normal(1.0, 0.1), rm.uniform(0.0, 1.0))),
            scene(rm.Cone(3, rm.normal(1.1, 0.1), rm.uniform(0.2, 0.8))),
        ),
        SPIN,
    ),
    "sphere": (
        (scene(rm.Sphere(rm.uniform(0.0, 2.0))), scene(rm.Sphere(rm.uniform(1.0, 2.0)))),
        "energy_final",
    ),
    "equilibrium": (
        (scene(momentum=rm.GibbsMomentum(1.0)), scene(momentum=rm.GibbsMomentum(0.8))),
        "energy_final",
    ),
    "shell": (
        (
            scene(momentum=rm.Shell(rm.uniform(1.0, 3.0))),
            scene(momentum=rm.Shell(rm.uniform(1.0, 2.0))),
        ),
        "energy_final",
    ),
    "temperature": (
        (
            scene(momentum=rm.GibbsMomentum(rm.uniform(1.0, 2.0)), attitude="ensemble"),
            scene(momentum=rm.GibbsMomentum(rm.uniform(1.0, 1.5)), attitude="ensemble"),
        ),
        "energy_final",
    ),
    "second moments": (
        (
            scene(TRIPLE, rm.Body.from_moments(SECOND)),
            scene(
                TRIPLE,
                rm.Body.from_moments(rm.SecondMoments((*SECOND.values[:2], rm.normal(0.9, 0.1)))),
            ),
        ),
        "moments[1]",
    ),
    "in common": (
        (together((2.0, 0.1), (1.0, 0.0, 0.2)), together((2.1, 0.1), (1.1, 0.05, 0.15))),
        SPIN,
    ),
    "from common to own": (
        (together((2.0, 0.1), (1.0, 0.0, 0.2)), scene((0, 0, rm.normal(1.1, 0.15)), drawn(2.0))),
        SPIN,
    ),
    "from own to common": (
        (scene((0, 0, rm.normal(1.0, 0.2)), drawn(2.0)), together((2.0, 0.1), (1.1, 0.1, 0.1))),
        SPIN,
    ),
    "fisher": (
        (scene(attitude="uniform"), scene(attitude=rm.Fisher((1.0, 0.2, 0.0, 0.0), 1.0))),
        "nutation_max",
    ),
    "pointing": (
        (
            scene(attitude=rm.Fisher((1.0, 0.2, 0.0, 0.0), 0.5)),
            scene(attitude=rm.Pointing((0.0, 0.3, 1.0), 1.0)),
        ),
        "nutation_max",
    ),
    "euler angles": (
        (
            scene(attitude=(0.0, rm.uniform(0.0, 1.0), 0.0)),
            scene(attitude=(0.0, rm.uniform(0.2, 0.6), 0.0)),
        ),
        "nutation_max",
    ),
    "effect": (
        (
            scene(effects=rm.ViscousDamping(rm.uniform(0.0, 2.0))),
            scene(effects=rm.ViscousDamping(rm.normal(1.5, 0.1).between(1.0, 2.0))),
        ),
        "energy_final",
    ),
    "two vectors": (
        (
            scene(FITTED, effects=rm.BodyTorque(FITTED)),
            scene(moved(0.1), effects=rm.BodyTorque(moved(0.2))),
        ),
        "body_torque_size[1]",
    ),
    "mass": (
        (
            scene(
                body=rm.Body((1.0, 1.5, 2.0), rm.normal(2.0, 0.1), (0.0, 0.1, 0.2)),
                effects=rm.Gravity(9.81),
            ),
            scene(
                body=rm.Body((1.0, 1.5, 2.0), rm.normal(2.1, 0.1), (0.0, 0.1, 0.2)),
                effects=rm.Gravity(9.81),
            ),
        ),
        "energy_final",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_weights_agree_with_a_run_of_the_other_distributions(name):
    (old, new), of = CASES[name]
    way = {"integrator": "rk4", "dt": 0.01, "t_end": 0.05, "members": 10_000}
    way |= {"save": "omega,energy,nutation"}
    ds = rm.simulate(old, **way)
    truth = rm.simulate(new, seed=7, **way)
    text = f"mean({of})"
    study = reweight(ds, new, text)
    value, error = row(study, text)
    direct, other = row(reweight(truth, new, text), text)
    apart = (value - direct) / math.hypot(error, other)
    before = (row(study, text, "old")[0] - direct) / math.hypot(error, other)
    assert abs(apart) < 3.5  # measured 1.9 at most in 20 cases
    assert abs(before) > 5.0  # the old mean is another: measured 13 and more


def test_a_number_in_common_counts_even_if_it_alone_stays():
    """The spin becomes correlated with a moment whose own distribution is the same."""
    old = together((2.0, 0.1), (1.0, 0.0, 0.2))
    new = together((2.0, 0.1), (1.0, 0.1, math.sqrt(0.03)))
    text = f"mean({SPIN} | moments[3] >= 2.1)"
    mean = 1.0 + 0.1 * stats.norm.pdf(1.0) / stats.norm.sf(1.0)
    value, error = row(reweight(rm.simulate(old, members=20_000, **RUN), new, text), text)
    assert abs(value - mean) < 3.0 * error < 0.02  # measured .4 errors
    assert mean > 1.15  # and 1 without the moment


FLIPS = "p(flips >= 1)", "median(flip_first)", "p(flip_first <= 2.7)", "quantile(flip_first, 0.9)"


def handle(tilt, **run):
    thrown = rm.Start(omega=(rm.normal(0.0, tilt), 6.0, rm.normal(0.0, tilt)))
    run = {
        "integrator": "exact",
        "t_end": 4.0,
        "dt": 0.01,
        "save": "flips",
        "members": 20_000,
        **run,
    }
    return rm.Scene(BODY, start=thrown).with_run(**run)


def test_events_of_a_run_that_was_not_made():
    """A steadier hand: flips come later, and seldom in the time of the run."""
    ds = rm.simulate(handle(0.05))
    new = handle(0.03)
    other = rm.simulate(new, seed=5)
    found, direct = reweight(ds, new, FLIPS), reweight(other, new, FLIPS)
    for text in FLIPS:
        # members without the event count, as they do in measures
        alone = row(direct, text)[0], direct.estimate_low.sel(measure=text, distribution="new")
        assert alone == pytest.approx(other.rigid.measure(text)[:2], rel=1e-3)
        (value, error), (truth, more) = row(found, text), row(direct, text)
        assert abs(value - truth) < 3.0 * math.hypot(error, more)  # measured 1.6 at most
        assert abs(row(found, text, "old")[0] - truth) > 7.0 * math.hypot(error, more)


def test_default_measures_are_of_all_results_and_last_states(tmp_path):
    ds = rm.simulate(handle(0.05, members=2000, save="flips,omega"))
    study = reweight(ds, handle(0.04, save="omega"))
    found = set(study.measure.values)
    assert {"mean(flips)", "median(flips)", "median(flip_first)", "mean(omega_final[1])"} <= found
    # not inputs, nor the mean of a time that has no end in some members
    assert not any("start" in text or "moments" in text for text in found)
    assert "mean(flip_first)" not in found
    assert list(study.unit.sel(measure=["median(flips)", "median(omega_final[1])"])) == [
        "1",
        "rad s-1",
    ]
    lines = table(study)
    assert len(lines) == 1 + study.sizes["measure"] and "as good as" in lines[0]
    assert any("median(omega_final[2])" in line and line.endswith("rad/s") for line in lines)


def test_flagged_members_have_weights_and_no_estimate():
    def made(mean):  # impossible above 2.5
        law = rm.Correlated((1.0, 1.5, mean), np.diag((1e-8, 1e-8, 0.04)))
        return scene(body=rm.Body.from_moments(law))

    with pytest.warns(rm.SceneWarning, match="cannot exist"):
        ds = rm.simulate(made(2.0), members=5000, **RUN)
    study = reweight(ds, made(2.2), "mean(moments[3])")
    share = study.share.sel(status="invalid_input").values
    low, high = stats.norm.sf((0.5 / 0.2, 0.3 / 0.2))
    assert abs(share[0] - low) < 0.004 and abs(share[1] - high) < 0.02  # measured .001, .004
    inside = stats.truncnorm(-1.7 / 0.2, 0.3 / 0.2, 2.2, 0.2)
    value, error = row(study, "mean(moments[3])")
    assert abs(value - inside.mean()) < 3.0 * error
    good = study.weight.values[ds.status.values == 0]
    assert study.attrs["effective_size"] == pytest.approx(good.sum() ** 2 / (good @ good))
    assert "members flagged invalid_input" in table(study)[-1]


def test_points_that_are_not_independent_have_no_interval():
    ds = rm.simulate(scene((0.0, 0.0, rm.normal(1.0, 0.1))), members=1024, points="sobol", **RUN)
    study = reweight(ds, scene((0.0, 0.0, rm.normal(1.05, 0.1))), f"mean({SPIN})")
    assert abs(row(study, f"mean({SPIN})")[0] - 1.05) < 1e-3  # measured 2e-4
    assert np.isnan(study.standard_error).all() and np.isnan(study.estimate_low).all()
    assert "sobol points" in table(study)[-1]


def normals(**more):
    return scene((0.0, 0.0, rm.normal(1.0, 0.1)), **more)


def uncertain(largest, axes="described"):
    tensor = rm.UncertainInertia(np.diag((2.0, 2.5, largest)), 0.01 * np.eye(6))
    return rm.Body.from_tensor(tensor, axes=axes)


def orbiting(law):
    circle = rm.GravityGradient(0.01, 1.0, 0.0, 0.0)
    return scene(law, effects=circle, relative_to_orbit="omega")


G, OFF = rm.Gravity(9.81), rm.Body((1.0, 1.5, 2.0), 1.0, (0.0, 0.0, 0.1))
GRID, ROWS = rm.grid(0.5, 1.5, 10), np.linspace(0.5, 1.5, 500)
REFUSED = {
    "a fixed number": (normals(), scene((0.0, 0.1, rm.normal(1.0, 0.1))), "start.omega"),
    "no longer drawn": (normals(), scene((0.0, 0.0, 1.0)), "start.omega"),
    "newly drawn": (scene((0.0, 0.0, 1.0)), normals(), "start.omega"),
    "another body": (normals(), normals(body=rm.Body((1.0, 1.5, 2.1))), "body.moments"),
    "other axes": (
        normals(body=TURNED), normals(body=replace(TURNED, frame="principal")), "body.frame",
    ),
    "an effect": (normals(), normals(effects=rm.Gravity(9.81)), "effects.gravity.g"),
    "its number": (
        normals(effects=G, body=OFF), normals(effects=rm.Gravity(9.8), body=OFF),
        "effects.gravity.g",
    ),
    "momentum": (normals(), scene(momentum=(0.0, 0.0, rm.normal(2.0, 0.1))), "start"),
    "sequence": (
        normals(attitude=(0.0, 0.1, 0.2)), normals(attitude=(0.0, 0.1, 0.2), sequence="321"),
        "start.sequence",
    ),
    "quaternion for angles": (
        normals(attitude=(0.0, rm.uniform(0.0, 1.0), 0.2)),
        normals(attitude=(rm.uniform(0.0, 1.0), 0.0, 0.2, 0.1)), "start.attitude",
    ),
    "grid": (scene((0.0, GRID, 1.0)), scene((0.0, rm.grid(0.5, 1.6, 10), 1.0)), "start.omega"),
    "table": (scene((0.0, ROWS, 1.0)), scene((0.0, 2.0 * ROWS, 1.0)), "start.omega"),
    "no density": (
        scene(rm.Cone(3, 1.0, rm.uniform(0.0, 0.1))), scene(rm.Cone(3, 1.1, rm.uniform(0.0, 0.1))),
        "start.omega",
    ),
    "shells": (
        scene(momentum=rm.Shell(1.0)), scene(momentum=rm.Shell(1.1)), "start.momentum",
    ),
    "rejected attitudes": (
        scene(momentum=rm.GibbsMomentum(1.0), attitude="ensemble"),
        scene(momentum=rm.GibbsMomentum(1.1), attitude="ensemble"), "start.momentum",
    ),
    "tensor": (
        normals(body=uncertain(3.0)), normals(body=uncertain(3.1)), "body.tensor",
    ),
    "sphere to vector": (scene(rm.Sphere(rm.uniform(0.0, 4.0))), scene(FITTED), "start.omega"),
    "singular": (
        together((2.0, 0.1), (1.0, 0.0, 0.2)), together((2.0, 0.1), (1.0, 0.2)), "common",
    ),
    "principal axes": (
        scene(TRIPLE, uncertain(3.0, "principal")), scene(FITTED, uncertain(3.0, "principal")), "",
    ),
    "orbit": (
        orbiting(rm.Correlated((0.0, 0.1, 0.0), 0.01 * np.eye(3))),
        orbiting(rm.Correlated((0.0, 0.2, 0.0), 0.01 * np.eye(3))), "start.omega",
    ),
    "turned momenta": (
        scene(momentum=rm.GibbsMomentum(1.0), body=TURNED),
        scene(momentum=rm.GibbsMomentum(1.1), body=TURNED), "start.momentum",
    ),
    "attitudes of an ensemble": (
        scene(momentum=rm.GibbsMomentum(1.0), attitude="ensemble"),
        scene(momentum=rm.GibbsMomentum(1.0), attitude="uniform"), "start.attitude",
    ),
    "wider uniform": (
        scene((0.0, 0.0, rm.uniform(0.9, 1.1))), scene((0.0, 0.0, rm.uniform(0.9, 1.2))),
        "start.omega",
    ),
    "tail of a normal": (scene((0.0, 0.0, rm.uniform(0.5, 1.5))), normals(), "start.omega"),
    "gap of a mixture": (
        scene((0.0, 0.0, rm.mixture((1.0, rm.uniform(0.0, 0.9)), (1.0, rm.uniform(1.0, 2.0))))),
        scene((0.0, 0.0, rm.uniform(0.8, 1.1))), "start.omega",
    ),
    "corner of a box": (scene((rm.uniform(0.0, 2.0),) * 3), scene(FITTED), "start.omega"),
    "t_end": (normals(), normals().with_run(t_end=0.2), "run.t_end"),
    "integrator": (normals(), normals().with_run(integrator="rk4"), "run.integrator"),
    "dt": (normals(), normals().with_run(dt=0.05), "run.dt"),
    "dtype": (normals(), normals().with_run(dtype="float32"), "run.dtype"),
    "too far": (normals(), scene((0.0, 0.0, rm.normal(1.3, 0.1))), "scene"),
    "nothing left": (normals(), scene((0.0, 0.0, rm.normal(9.0, 0.1))), "scene"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_other_scenes_are_refused_by_name(name):
    old, new, at = REFUSED[name]
    way = {**RUN, "integrator": "rk4"} if old.effects else RUN
    ds = rm.simulate(old, members=500, **way)
    with pytest.raises(SceneError) as told:
        reweight(ds, new, "mean(omega_final[3])")
    assert told.value.at.startswith(at)
    rule = told.value.rule
    assert "run a new ensemble" in rule or "is only in" in rule or at in ("common", "body.frame")
    assert reweight(ds, old, "mean(omega_final[3])").attrs["effective_size"] == 500.0


def test_settings_that_a_scene_does_not_state_are_those_of_the_result():
    ds = spun(rm.normal(1.0, 0.1), 500)
    for more in ({}, {"seed": 9, "members": 7, "save": "energy"}, {"tolerance": 1e-6}):
        assert reweight(ds, normals().with_run(**more), f"mean({SPIN})").sizes["member"] == 500


def test_a_step_that_a_run_shortened_is_the_same():
    way = {"integrator": "exact", "dt": 0.03, "t_end": 0.1, "every": 0.1}
    with pytest.warns(rm.SceneWarning, match="dt reduced"):
        ds = rm.simulate(normals(), members=500, **way)
    assert ds.attrs["dt"] == pytest.approx(0.025)
    reweight(ds, normals().with_run(dt=0.03), f"mean({SPIN})")
    with pytest.raises(SceneError, match="run"):
        reweight(ds, normals().with_run(dt=0.02), f"mean({SPIN})")


def test_other_mistakes_are_told():
    ds = spun(rm.normal(1.0, 0.1), 500)
    with pytest.raises(OptionError, match="correlation"):
        reweight(ds, normals(), "correlation(omega_final[3], omega_final[1])")
    with pytest.raises(OptionError, match="no such variable"):
        reweight(ds, normals(), "mean(flips)")
    with pytest.raises(OptionError, match="stores none"):
        reweight(xr.Dataset({"x": 1.0}), normals())
    both = xr.concat(
        [
            ds.isel(member=slice(0, 250)),
            spun(rm.normal(1.0, 0.1), 500, 1).isel(member=slice(250, 500)),
        ],
        "member",
        data_vars="minimal",
    )
    with pytest.raises(FileError, match="do not follow from this scene and seed"):
        reweight(both.assign_attrs(ds.attrs), normals())


def test_a_wrong_density_is_seen(monkeypatch):
    ds = spun(rm.normal(1.0, 0.1), 5000)
    new = scene((0.0, 0.0, rm.normal(1.1, 0.1)))
    right = distributions.Distribution.log_density
    monkeypatch.setattr(
        distributions.Distribution, "log_density", lambda law, x: 0.5 * right(law, x)
    )
    mean, error = row(reweight(ds, new, f"mean({SPIN})"), f"mean({SPIN})")
    assert abs(mean - 1.1) > 10.0 * error  # measured 24


def test_files_and_the_command_give_the_same(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    old, text = normals().with_run(**RUN), f"mean({SPIN})"
    new = scene((0.0, 0.0, rm.normal(1.05, 0.1)))
    (tmp_path / "new.toml").write_text(new.dumps())
    wanted = reweight(rm.simulate(old, members=3000), new, text)
    (tmp_path / "old.toml").write_text(old.dumps())
    for output in ("r.nc", "r.zarr"):
        rm.simulate(old, members=3000, output=output)
    assert (
        invoke("run", "old.toml", "--members", 3000, "--shard-size", 1000, "-o", "run/").exit_code
        == 0
    )
    for path in ("r.nc", "r.zarr", "run"):
        xr.testing.assert_identical(rm.reweight(path, new, text), wanted)
    change = "start.omega=[0, 0, {normal = [1.05, 0.1]}]"
    for words in (
        (
            "new.toml",
            "--set",
            "run.t_end=0.1",
            "--set",
            "run.dt=0.1",
            "--set",
            "run.integrator=exact",
        ),
        ("old.toml", "--set", change),
    ):
        done = invoke("reweight", "r.nc", *words, "--of", text, "-o", "study.nc", "--force")
        assert done.exit_code == 0, done.output
        assert done.output.splitlines()[:-1] == table(wanted)
        with xr.open_dataset("study.nc") as study:
            assert np.array_equal(study.weight, wanted.weight)
    assert invoke("reweight", "r.nc", "new.toml").exit_code == 3  # its t_end is another

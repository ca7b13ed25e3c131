"""The numbers of a member depend on scene, seed and index, not on what else is saved.

What is saved decides what is compiled, and whether the attitude is integrated at all. Each quick
test compares a run that saves little with one that saves all. Every observable alone beside all
together is `pytest -m slow tests/whole/test_independence_of_saves.py` (12 minutes).
"""

from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.observables import bare_observables, monitors, statistics
from rigidmc.physics.observables.protocol import observable
from tests.tools.plans import carries_attitude

HEAVY = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
TIPS, FLIPS = rm.Passage(3, 0.5), rm.Flips(2)
STATISTICS = statistics()


def free(**run):
    start = rm.Start(omega=rm.Cone(2, 1.0, rm.uniform(0.01, 1.0)), attitude="uniform")
    return rm.Scene(
        rm.Body.from_moments((1.0, 2.0, 3.0)),
        start=start,
        run=rm.Run(**run),
        observables=(TIPS, FLIPS),
    )


def acted(*effects, momentum=None, **run):
    start = rm.Start(
        omega=rm.Sphere(1.0) if momentum is None else None, momentum=momentum, attitude="uniform"
    )
    return rm.Scene(HEAVY, effects, start, rm.Run(**run), observables=(TIPS, FLIPS))


SCENES = {
    "free, by the exact motion": free(
        integrator="exact", dt=0.5, t_end=60.0
    ),  # 4 panels of the phase per step
    "free, steps of its own": free(integrator="rk4", turn=0.1, t_end=30.0),
    "heavy and damped, by Runge-Kutta": acted(
        rm.Gravity(1.0), rm.ViscousDamping(0.01), integrator="rk4", dt=0.05, t_end=10.0
    ),
    "heavy": acted(rm.Gravity(1.0), integrator="srkn11", dt=0.1, t_end=10.0),
    "damped": acted(
        rm.EnergyDissipation(0.1), rm.ViscousDamping(0.01), integrator="strang", dt=0.05, t_end=10.0
    ),
    "in a bath": acted(
        rm.Bath(0.1, 1.0), momentum=rm.GibbsMomentum(1.0), integrator="strang", dt=0.05, t_end=10.0
    ),
}
# minus the work if that is saved: then another quantity
DRIFTS = ("energy_drift", "energy_drift_max")


def able(scene, name):
    if name == "noise_score":
        return any(isinstance(effect, rm.Bath) for effect in scene.effects)
    return name != "work" or bool(scene.effects)


def saved(scene, *names):
    return rm.simulate(scene, members=64, every=scene.run.t_end / 4, save=names)


def differing(some, every, booked):
    """Names of the variables of both that are not equal to the bit."""
    names = [v for v in some.data_vars if v in every and not (v in DRIFTS and booked)]
    return [
        v
        for v in names
        if not np.array_equal(
            some[v].values, every[v].transpose(*some[v].dims).values, equal_nan=True
        )
    ]


def test_saving_little_and_saving_all():
    """Of one scene, whose kernels take 10 s; the slow test has all."""
    scene = SCENES["heavy"]
    names = ("omega", "attitude", "energy", "work", "nutation", "megno", "omega_mean")
    bare = rm.Scene(scene.body, scene.effects, scene.start, scene.run)
    assert differing(saved(bare, "omega"), saved(scene, *names), True) == []


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # long steps
@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_every_observable_alone_and_together(name):
    scene = SCENES[name]
    names = [
        n
        for n in (*bare_observables(), *monitors(), *STATISTICS)
        if n != "histogram" and able(scene, n)
    ]
    together = saved(scene, *(n for n in names if n not in STATISTICS or n.startswith("omega")))
    for n in names:
        if (
            n in STATISTICS and n.endswith("_min") and not n.startswith("omega")
        ):  # the statistics of one observable at a time
            together = saved(
                scene,
                "attitude",
                "flips",
                "nutation",
                *(m for m in STATISTICS if m.rpartition("_")[0] == n[:-4]),
            )
        alone = saved(scene, n)
        assert n in STATISTICS or set(alone.data_vars) <= set(together.data_vars)
        assert differing(alone, together, "work" in together and n != "work") == [], n


def test_the_tangent_of_a_free_body():
    """Its length is that of attitude and momentum, whether or not the attitude is saved. Before:
    1.9133 alone and 1.9486 beside it.
    """
    scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=rm.Start(omega=(1.0, 0.4, 0.3)))
    alone, beside = (
        rm.simulate(scene, "rk8", dt=0.05, t_end=60.0, members=1, save=save).megno.item()
        for save in (("megno",), ("megno", "attitude"))
    )
    assert alone == beside


@observable(units="1", long_name="cosine of the tilt", dims=())
class Tilt(NamedTuple):
    """Cosine of the angle between axis 3 and the vertical: a user's own observable."""

    def value(self, q):
        return (1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]),)


def test_an_observable_that_names_the_attitude_gets_it():
    """Before, it was 1, that of the identity, if nothing else needed the attitude."""
    scene = rm.Scene(HEAVY, start=rm.Start(omega=rm.Sphere(1.0), attitude="uniform"))
    alone, beside = (
        rm.simulate(scene, "rk4", dt=0.05, t_end=5.0, members=32, save=save)
        for save in ((Tilt(),), (Tilt(), "attitude"))
    )
    assert np.array_equal(alone.tilt.values, beside.tilt.values)
    x, y = beside.attitude.transpose("quat", "time", "member").values[1:3]
    assert np.abs(alone.tilt.values - (1.0 - 2.0 * (x * x + y * y))).max() < 1e-15  # measured 2e-16


def test_observables_that_need_the_attitude():
    bare = rm.Scene(HEAVY, start=rm.Start(omega=(0.0, 1.0, 0.0)))
    needed = {
        name
        for name in (*bare_observables(), *monitors(), *STATISTICS)
        if name not in ("histogram", "passage", "noise_score")
        and carries_attitude(bare.with_run(save=(name,)))
    }
    assert needed == {
        "attitude",
        "nutation",
        "precession",
        "megno",
        *(f"attitude_{word}" for word in ("min", "max", "mean", "variance", "last")),
    }
    assert carries_attitude(bare.with_run(save=(rm.Passage(3, 0.5),)))
    assert not carries_attitude(bare.with_run(save=(rm.Passage(3, 0.5, about="momentum"),)))
    assert not carries_attitude(bare.with_run(save=(rm.Histogram("energy", 0.0, 1.0),)))
    assert carries_attitude(bare.with_run(save=(rm.Histogram("attitude[1]", 0.0, 1.0),)))
    assert carries_attitude(
        rm.Scene(
            HEAVY, (rm.Gravity(1.0),), bare.start, bare.run.model_copy(update={"save": ("energy",)})
        )
    )

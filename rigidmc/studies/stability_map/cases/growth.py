"""The intermediate axis: the growth rate of a disturbance, timed between two angles."""

import math

import numpy as np
import xarray as xr

from rigidmc.physics.observables.passage import Passage
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Cone
from rigidmc.studies.stability_map.case import Derived, MapCase
from rigidmc.studies.stability_map.cases.intermediate_axis import RATES, RATIOS, X, Y, growth_rate

# Angles from the middle axis [rad]: at the start, and at the start and end of the timed growth. The
# decaying part adds (TILT/FROM)^2 to the rate, the nonlinear part TO^2/6.
TILT, FROM, TO = 1e-5, 5e-3, 7e-2


def growth() -> MapCase:
    scene = Scene(
        Body.from_moments((0.5, 1.0, 1.5)),
        (),
        Start(omega=Cone(2, 1.0, TILT)),
        observables=(Passage(2, FROM, about="momentum"), Passage(2, TO, about="momentum")),
    )
    return MapCase(
        title="The intermediate axis: growth rate of a disturbance",
        scene=scene,
        x=X,
        y=Y,
        of=("mean(passage_first)", "mean(passage_first_2)"),
        members=4,
        derived=_derived,
        shown="growth",
        contours=("theory", RATES, "theory"),
        labels=RATIOS,
        settings={"integrator": "rk8", "dt": 0.5, "t_end": 400.0},
        source="sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega, Goldstein (5.36)",
    )


def _derived(ds: xr.Dataset) -> Derived:
    theory, attrs = growth_rate(ds)
    passed = ds["mean(passage_first_2)"].values - ds["mean(passage_first)"].values
    rate = math.log(TO / FROM) / passed
    measured = "measured growth rate of a disturbance of the middle axis"
    error = {"units": "1", "long_name": "relative error of the growth rate"}
    return {
        "growth": (rate, {"units": "s-1", "long_name": measured}),
        "theory": (theory, attrs),
        "error": (np.abs(rate / theory - 1.0), error),
    }

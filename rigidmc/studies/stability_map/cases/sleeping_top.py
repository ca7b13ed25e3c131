"""The sleeping top: the spins that keep it upright."""

import math

import numpy as np
import xarray as xr

from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.observables.passage import Passage
from rigidmc.scene.body import Body
from rigidmc.scene.distributions import uniform
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stability_map.case import Derived, MapCase


def sleeping_top() -> MapCase:
    # the body is possible for m h^2 <= 0.75 kg m2; on the map m h^2 <= 0.5 kg m2
    body = Body.from_moments((1.0, 1.0, 0.5), mass=0.5, centre=(0.0, 0.0, 0.5))
    phi, psi = uniform(0.0, 2.0 * math.pi), uniform(0.0, 2.0 * math.pi)
    start = Start(omega=(0.0, 0.0, 2.0), attitude=(phi, 1e-4, psi))
    return MapCase(
        title="The sleeping top: spins n and heights h of the centre at which it falls over",
        scene=Scene(body, (Gravity(2.0),), start, observables=(Passage(3, 0.1),)),
        x=("start.omega.3", 0.0, 5.0),
        y=("body.centre.3", 0.0, 1.0),
        of=("p(passages >= 1)", "mean(passage_first)"),
        members=4,
        derived=_derived,
        shown="p(passages>=1)",
        contours=("theory", (0.0,), "C² n² = 4 A m g h"),
        labels=(
            "spin n",
            "height h of the centre of mass",
            "fraction of the tops that fall over",
        ),
        settings={"integrator": "rk8", "dt": 0.1, "t_end": 300.0},
        source="C^2 n^2 > 4 A k, TdC (3.77)",
    )


def _derived(ds: xr.Dataset) -> Derived:
    spin, height = np.meshgrid(ds.x.values, ds.y.values)
    attrs = {"units": "J kg m2", "long_name": "C^2 n^2 - 4 A m g h: above 0 the top sleeps"}
    return {"theory": (0.25 * spin**2 - 4.0 * height, attrs)}

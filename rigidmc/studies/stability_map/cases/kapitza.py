"""Kapitza's pendulum: the vibrations of the pivot that keep a body upside down."""

import numpy as np
import xarray as xr

from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.pivot import MovingPivot
from rigidmc.physics.observables.passage import Passage
from rigidmc.scene.body import Body
from rigidmc.scene.distributions import normal
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stability_map.case import Derived, MapCase


def kapitza() -> MapCase:
    scene = Scene(
        Body.from_moments((1.0, 1.0, 0.5), mass=2.0, centre=(0.0, 0.0, 0.5)),
        (Gravity(1.0), MovingPivot((0.0, 0.0, 0.1), 20.0)),
        Start(omega=(0.0, 0.0, 0.0), attitude=(0.0, normal(0.0, 1e-5), 0.0)),
        observables=(Passage(3, 0.1),),
    )
    return MapCase(
        title="Kapitza's pendulum: where a vibrating pivot keeps a body upside down",
        scene=scene,
        x=("effects.moving_pivot.swing.3", 0.0, 0.6),
        y=("effects.moving_pivot.frequency", 3.0, 30.0),
        of=("p(passages >= 1)", "mean(passage_first)"),
        members=1,
        derived=_derived,
        shown="p(passages>=1)",
        contours=("theory", (0.0,), "bounds of Mathieu's equation"),
        labels=(
            "swing of the pivot",
            "frequency of the pivot",
            "fraction that falls over",
        ),
        settings={"integrator": "rk8", "dt": 0.04, "t_end": 200.0},
        source="stable between a0(q) and b1(q); swing frequency > sqrt(2 g l) for small swings"
        " (Kapitza 1951)",
    )


def _derived(ds: xr.Dataset) -> Derived:
    from scipy.special import mathieu_a, mathieu_b

    swing, frequency = np.meshgrid(ds.x.values, ds.y.values)
    # x'' + (a - 2 q cos 2 tau) x = 0 for a small angle x, with l = 1 m and g = 1 m/s2
    a, q = -4.0 / frequency**2, 2.0 * swing
    inside = np.minimum(a - mathieu_a(0, q), mathieu_b(1, q) - a)
    name = "distance to the bounds a0(q), b1(q) of Mathieu's equation: stable above 0"
    return {"theory": (inside, {"units": "1", "long_name": name})}

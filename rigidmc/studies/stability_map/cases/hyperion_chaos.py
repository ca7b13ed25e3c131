"""How much of Hyperion's rotation is chaotic, by its spin and the lean of its long axis."""

import math

import numpy as np
import xarray as xr

from rigidmc.physics.effects.gravity_gradient import GravityGradient
from rigidmc.scene.body import Body
from rigidmc.scene.distributions import uniform
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.stability_map.case import Derived, MapCase

MU, DISTANCE = 3.7931e16, 1.4813e9  # G M of Saturn [m3/s2], and the semi-major axis [m]
RATE = math.sqrt(MU / DISTANCE**3)  # mean motion


def hyperion_chaos() -> MapCase:
    # axis 3 is the long one; 360 x 266 x 205 km and 5.6e18 kg, of which only the ratios matter
    body = Body.solid("ellipsoid", mass=5.6e18, semiaxes=(102500.0, 133000.0, 180000.0))
    around = uniform(0.0, 2.0 * math.pi)
    start = Start(omega=(0.0, 0.0, 4.2 * RATE), attitude=(around, 0.8, around))
    return MapCase(
        title="Hyperion, which spins about its long axis: how much is chaotic",
        scene=Scene(body, (GravityGradient(MU, DISTANCE, 0.115),), start),
        x=("start.attitude.theta", 0.0, 0.5 * math.pi),
        y=("start.omega.3", 0.0, 6.0 * RATE),
        of=("p(megno > 4)", "mean(lyapunov)"),
        members=4,
        derived=_derived,
        shown="p(megno>4)",
        contours=("spin_ratio", (4.2, 4.5), "spins seen by Voyager 2 and Cassini"),
        labels=(
            "lean of the long axis from the normal of the orbit",
            "spin about the long axis",
            "chaotic fraction of the starts (MEGNO > 4)",
        ),
        # 300 orbits: MEGNO exceeds 4 if changes grow by e in 35 orbits or fewer
        settings={"integrator": "rk8", "dt": 10800.0, "t_end": 300.0 * 2.0 * math.pi / RATE},
        source="not chaotic, near a nutation-orbit resonance: Goldberg & Batygin (2024)",
    )


def _derived(ds: xr.Dataset) -> Derived:
    ratio = np.meshgrid(ds.x.values, ds.y.values)[1] / RATE
    return {"spin_ratio": (ratio, {"units": "1", "long_name": "spin / mean motion"})}

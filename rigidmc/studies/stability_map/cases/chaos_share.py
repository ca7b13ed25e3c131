"""The chaotic fraction of the energy surface of a heavy top, between two integrable tops."""

import numpy as np
import xarray as xr

from rigidmc.physics.effects.gravity import Gravity
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Shell
from rigidmc.studies.stability_map.case import Derived, MapCase


def chaos_share() -> MapCase:
    # m g c = 1 J; with this large mass, bodies are possible from I2 = 1.00125 kg m2 on
    body = Body.from_moments((2.0, 1.5, 1.0), mass=100.0, centre=(0.0025, 0.0, 0.0))
    start = Start(momentum=Shell(1.0), attitude="ensemble")
    return MapCase(
        title="Chaos from Lagrange's top (left) to Kovalevskaya's (right): moments 2, I2, 1, centre"
        " of mass on axis 1",
        scene=Scene(body, (Gravity(4.0),), start),
        x=("body.moments.2", 1.0, 2.0),
        y=("start.momentum.energy", -1.0, 9.0),
        of=("p(megno > 4)", "mean(megno)", "mean(lyapunov)"),
        members=16,
        derived=_derived,
        shown="p(megno>4)",
        contours=("theory", (1.0,), "energy of the upright top at rest"),
        labels=(
            "middle moment I₂",
            "energy; -1: hanging at rest",
            "chaotic fraction of the energy surface (MEGNO > 4)",
        ),
        settings={"integrator": "rk8", "dt": 0.2, "t_end": 1000.0},
        source="integrable at both sides and nowhere in between: Ziglin (1983)",
    )


def _derived(ds: xr.Dataset) -> Derived:
    energy = np.meshgrid(ds.x.values, ds.y.values)[1]
    words = "energy / energy of the upright top at rest"
    return {"theory": (energy, {"units": "1", "long_name": words})}

"""Chaos of a heavy top near Kovalevskaya's, measured by its MEGNO; and Kovalevskaya's top itself in
the same plane, which is integrable and so regular everywhere.
"""

import math

from rigidmc.physics.effects.gravity import Gravity
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Shell
from rigidmc.studies.stability_map.case import MapCase

Vector = tuple[float, float, float]


def heavy_chaos(moments: Vector = (2.0, 2.2, 1.0), centre: Vector = (1.0, 0.0, 0.0)) -> MapCase:
    scene = Scene(
        Body.from_moments(moments, mass=0.25, centre=centre),
        (Gravity(4.0),),
        Start(momentum=Shell(1.0, (1.0, 1.0, 1.0)), attitude=(0.0, 1.0, 0.7)),
    )
    return MapCase(
        title="Chaos of a heavy top: Kovalevskaya's, but B = 1.1 A",
        scene=scene,
        x=("start.attitude.theta", 0.0, math.pi),
        y=("start.momentum.energy", 0.0, 5.0),
        of=("mean(megno)", "mean(lyapunov)"),
        members=1,
        shown="mean(megno)",
        labels=(
            "angle of axis 3 from the vertical at the start",
            "energy",
            "MEGNO: 2 regular, more chaotic",
        ),
        settings={"integrator": "rk8", "dt": 0.25, "t_end": 1400.0},
    )


def kovalevskaya() -> MapCase:
    """Return the map of the top with A = B = 2 C and the centre of mass in the plane of A and B."""
    title = "Kovalevskaya's top, A = B = 2 C: regular everywhere"
    return heavy_chaos((2.0, 2.0, 1.0), (1.0, 0.0, 0.0))._replace(title=title)

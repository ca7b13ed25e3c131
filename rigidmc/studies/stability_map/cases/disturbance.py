"""The time to the first flip of a body spun about its middle axis, against the disturbance.

A disturbance ten times smaller adds ln 10/lambda to the first wait and 2 ln 10/lambda to each wait
between flips: between flips it decays and then grows for equal times.
"""

import math

import numpy as np
import xarray as xr

from rigidmc.mechanics.free_top import analyse_free_top
from rigidmc.physics.observables.flips import Flips
from rigidmc.results.labels import with_units
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Cone
from rigidmc.studies.stability_map.case import Derived, MapCase

MOMENTS = (1.0, 2.0, 3.0)


def disturbance() -> MapCase:
    scene = Scene(
        Body.from_moments(MOMENTS),
        (),
        Start(omega=Cone(2, 1.0, 1e-3, 0.0)),
        observables=(Flips(2, 0.5 * math.pi),),
    )
    times = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
    return MapCase(
        title="Smaller disturbances flip later: time to the first flip of a body (1, 2, 3) spun"
        " about its middle axis",
        scene=scene,
        x=("start.omega.azimuth", 0.0, 2.0 * math.pi),
        y=("start.omega.angle", 1e-6, 1.0, True),
        of=("mean(flip_first)", "mean(flip_wait)", "mean(flips)"),
        members=1,
        derived=_derived,
        shown="mean(flip_first)",
        contours=(
            "theory",
            times,
            with_units("theory: (1/2 - phase) 4 K/λ", "s"),
        ),
        labels=(
            "direction of the disturbance, from axis 3 to axis 1",
            "size of the disturbance",
            "time of the first flip",
        ),
        settings={"integrator": "exact", "dt": 0.5, "t_end": 400.0},
        source="(1/2 - phase modulo 1/2) 4 K(m)/lambda",
    )


def _derived(ds: xr.Dataset) -> Derived:
    azimuth, angle = np.meshgrid(ds.x.values, ds.y.values)
    omega = np.stack(
        [np.sin(angle) * np.sin(azimuth), np.cos(angle), np.sin(angle) * np.cos(azimuth)], axis=-1
    )
    motion = analyse_free_top(MOMENTS, omega * [1.0, 2.0, 3.0])
    interval = motion.flip_interval
    # the component along the middle axis is 0 at the phases 0 and 1/2
    first = (0.5 - motion.phase % 0.5) * motion.period
    waits = {"theory": ds["mean(flip_first)"].values, "interval": ds["mean(flip_wait)"].values}
    words = "error of the {}, relative to the time between flips"
    return {
        "theory": (first, {"units": "s", "long_name": "time of the first flip in theory"}),
        "interval": (interval, {"units": "s", "long_name": "time between flips, 2 K(m)/lambda"}),
        "error": (
            np.abs(waits["interval"] - interval) / interval,
            {"units": "1", "long_name": words.format("mean time between flips")},
        ),
        "error_first": (
            np.abs(waits["theory"] - first) / interval,
            {"units": "1", "long_name": words.format("time of the first flip")},
        ),
    }

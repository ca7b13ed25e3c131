"""The end of the major axis about which a body with internal dissipation settles."""

import math

import numpy as np
import xarray as xr

from rigidmc.physics.effects.dissipation import EnergyDissipation
from rigidmc.physics.observables.passage import Passage
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Cone
from rigidmc.studies.stability_map.case import Derived, MapCase

SHARES = "p(passages >= 1)", "p(passages_2 >= 1)"


def damped_axis() -> MapCase:
    # 256 pixels resolve the rings up to 0.05 rad from axis 1
    scene = Scene(
        Body.from_moments((1.0, 2.0, 3.0)),
        (EnergyDissipation(0.1),),
        Start(momentum=Cone(3, 1.0, 0.5, 0.0)),
        observables=tuple(Passage(axis, 0.2, "reaches", "momentum") for axis in (3, -3)),
    )
    return MapCase(
        title="The end of the major axis about which a body (1, 2, 3) with dissipation settles",
        scene=scene,
        x=("start.momentum.azimuth", 0.0, 2.0 * math.pi),
        y=("start.momentum.angle", 0.0, math.pi),
        of=(*SHARES, "mean(passage_first)"),
        members=1,
        derived=_derived,
        shown="end",
        ticks={-1: "-3", 0: "none", 1: "+3"},
        borders=tuple((share, (0.5,)) for share in SHARES),
        contours=("theory", (1.0,), "separatrices 2 T I₂ = L²"),
        labels=(
            "azimuth of L at the start",
            "angle of L from axis 3 at the start",
            "end of axis 3 reached",
        ),
        settings={"integrator": "strang", "dt": 0.2, "t_end": 400.0},
        source="Bloch, Krishnaprasad, Marsden & Ratiu (1996): all motions end about axis 3, except"
        " on the other axes and their separatrices",
    )


def _derived(ds: xr.Dataset) -> Derived:
    azimuth, angle = np.meshgrid(ds.x.values, ds.y.values)
    l = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    up, down = ds["p(passages>=1)"].values, ds["p(passages_2>=1)"].values
    end = np.where(ds.good.values > 0, up - down, np.nan)
    reached = "end of axis 3 reached: 1 or -1, 0 if neither"
    energy = (l * l / [[[1.0]], [[2.0]], [[3.0]]]).sum(0) * 2.0
    return {
        "end": (end, {"units": "1", "long_name": reached}),
        "theory": (energy, {"units": "1", "long_name": "2 T I2/L^2: 1 on the separatrices"}),
    }

"""The intermediate axis: the flip rate of a body with moments I1 < I2 < I3."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.physics.observables.flips import Flips
from rigidmc.results.labels import with_units
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Cone
from rigidmc.studies.stability_map.case import Derived, MapCase

TILT = 1e-2  # rad: angle of omega from the middle axis at the start

# the plane of all bodies with I2 = 1 kg m2; other maps share it
X, Y = ("body.moments.1", 0.0, 1.0), ("body.moments.3", 1.0, 2.0)
RATIOS = "I₁, with I₂ = 1", "I₃, with I₂ = 1"
RATES = (0.1, 0.2, 0.3, 0.5, 0.7, 0.9)  # 1/s: the contours of growth_rate


def growth_rate(ds: xr.Dataset) -> tuple[NDArray[np.float64], dict[str, str]]:
    """Return sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega at each pixel of the plane X, Y, for
    omega = 1 rad/s; nan for an impossible body."""
    i1, i3 = np.meshgrid(ds.x.values, ds.y.values)
    with np.errstate(all="ignore"):
        rate = np.sqrt((1.0 - i1) * (i3 - 1.0) / (i1 * i3))
        rate = np.where(ds.none.values == 0, rate, np.nan)
    return rate, {
        "units": "s-1",
        "long_name": "growth rate of a disturbance, sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega",
    }


def intermediate_axis() -> MapCase:
    start = Start(omega=Cone(2, 1.0, TILT))
    return MapCase(
        title="The intermediate axis: flip rate of a body that spins about it",
        scene=Scene(Body.from_moments((0.5, 1.0, 1.5)), (), start, observables=(Flips(2),)),
        x=X,
        y=Y,
        of=("mean(flips)", "mean(flip_wait)"),
        members=16,
        derived=_derived,
        shown="rate",
        contours=("theory", RATES, with_units("growth rate of a disturbance in theory", "s-1")),
        labels=RATIOS,
        settings={"integrator": "rk8", "dt": 1.2, "t_end": 840.0},
        source="sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega, Goldstein (5.36); flips every 2 K/lambda",
    )


def _derived(ds: xr.Dataset) -> Derived:
    attrs = {
        "units": "s-1",
        "long_name": "flips per second of a body spun at 1 rad/s, 0.01 rad from its middle axis",
    }
    return {
        "rate": (ds["mean(flips)"].values / ds.attrs["t_end"], attrs),
        "theory": growth_rate(ds),
    }

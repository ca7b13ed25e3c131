"""The maps that come with the package: what each varies, asks, and what theory says of it."""

import math
from typing import Any, NamedTuple

import numpy as np

from rigidmc.effects import EnergyDissipation, Gravity, MovingPivot
from rigidmc.errors import OptionError, unknown
from rigidmc.mechanics.free_top import free_motion
from rigidmc.observables import Flips, Passage
from rigidmc.scene.body import Body
from rigidmc.scene.laws import Cone, Shell
from rigidmc.scene.quantities import normal, uniform
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.studies.maps.stability_map import stability_map

TILT = 1e-2  # rad: of the start from the middle axis
# Growth is timed from FROM to TO after a start at LITTLE: what still shrinks then is (LITTLE/FROM)^2, what is not linear TO^2/6.
LITTLE, FROM, TO = 1e-5, 5e-3, 7e-2


class MapCase(NamedTuple):
    """A map: its scene and settings, x and y as (parameter, low, high[, log]), questions, and what theory says.

    derived : from the Dataset of the map to more of its variables {name: (values, attributes)}: theory, and what follows from several measures
    shown, contours : the variable that is drawn, and the one whose lines are drawn over it at some levels, with their words
    labels : of x and y, and of colours where the result's own name is too long
    """

    title: str
    scene: Any
    x: tuple
    y: tuple
    of: tuple
    members: int
    derived: Any
    shown: str
    contours: tuple
    labels: tuple
    settings: dict[str, Any]
    source: str


def growth_rate(ds):
    """sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega of the pixels of a map of I1 and I3, I2 = 1 kg m2, omega = 1 rad/s; nan where there is no body."""
    one, three = np.meshgrid(ds.x.values, ds.y.values)
    with np.errstate(all="ignore"):
        rate = np.where(
            ds.none.values == 0, np.sqrt((1.0 - one) * (three - 1.0) / (one * three)), np.nan
        )
    return rate, {
        "units": "s-1",
        "long_name": "growth rate of a disturbance, sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega",
    }


RATES = (0.1, 0.2, 0.3, 0.5, 0.7, 0.9)
SHAPES = ("body.moments.1", 0.0, 1.0), ("body.moments.3", 1.0, 2.0)
RATIOS = "I$_1$/I$_2$", "I$_3$/I$_2$"


def intermediate_axis():
    scene = Scene(
        Body.from_moments((0.5, 1.0, 1.5)),
        (),
        Start(omega=Cone(2, 1.0, TILT)),
        observables=(Flips(2),),
    )

    def derived(ds):
        words = {
            "units": "s-1",
            "long_name": "flips a second of a body spun at 1 rad/s, 0.01 rad from its middle axis",
        }
        return {
            "rate": (ds["mean(flips)"].values / ds.attrs["t_end"], words),
            "theory": growth_rate(ds),
        }

    return MapCase(
        "The intermediate axis: how often a body flips that is spun about it", scene, *SHAPES, ("mean(flips)", "mean(flip_wait)"), 16,
        derived, "rate", ("theory", RATES, "growth rate of a disturbance in theory [1/s]"), RATIOS,
        {"integrator": "rk8", "dt": 1.2, "t_end": 840.0}, "sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega, Goldstein (5.36); flips every 2 K/lambda",
    )  # fmt: skip


def growth():
    scene = Scene(
        Body.from_moments((0.5, 1.0, 1.5)), (), Start(omega=Cone(2, 1.0, LITTLE)),
        observables=(Passage(2, FROM, about="momentum"), Passage(2, TO, about="momentum")),
    )  # fmt: skip

    def derived(ds):
        theory, words = growth_rate(ds)
        rate = math.log(TO / FROM) / (
            ds["mean(passage_first_2)"].values - ds["mean(passage_first)"].values
        )
        off = np.abs(rate / theory - 1.0)
        return {
            "growth": (
                rate,
                {
                    "units": "s-1",
                    "long_name": "growth rate of a disturbance of the middle axis, measured",
                },
            ),
            "theory": (theory, words),
            "error": (off, {"units": "1", "long_name": "relative error of the growth rate"}),
        }

    return MapCase(
        "The intermediate axis: how fast a disturbance grows", scene, *SHAPES, ("mean(passage_first)", "mean(passage_first_2)"), 4,
        derived, "growth", ("theory", RATES, "in theory"), RATIOS, {"integrator": "rk8", "dt": 0.5, "t_end": 400.0},
        "sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega, Goldstein (5.36)",
    )  # fmt: skip


def disturbance():
    scene = Scene(
        Body.from_moments((1.0, 2.0, 3.0)),
        (),
        Start(omega=Cone(2, 1.0, 1e-3, 0.0)),
        observables=(Flips(2, 0.5 * math.pi),),
    )

    def derived(ds):
        azimuth, angle = np.meshgrid(ds.x.values, ds.y.values)
        w = np.stack(
            [np.sin(angle) * np.sin(azimuth), np.cos(angle), np.sin(angle) * np.cos(azimuth)],
            axis=-1,
        )
        interval = free_motion((1.0, 2.0, 3.0), w * [1.0, 2.0, 3.0]).flip_interval
        wait = ds["mean(flip_wait)"].values
        return {
            "theory": (interval, {"units": "s", "long_name": "2 K(m)/lambda"}),
            "error": (
                np.abs(wait - interval) / interval,
                {"units": "1", "long_name": "relative error of the mean time between flips"},
            ),
        }

    return MapCase(
        "A small disturbance waits long: time to the first flip of a body (1, 2, 3) spun about its middle axis", scene,
        ("start.omega.azimuth", 0.0, 2.0 * math.pi), ("start.omega.angle", 1e-6, 1.0, True), ("mean(flip_first)", "mean(flip_wait)", "mean(flips)"), 1,
        derived, "mean(flip_first)", ("theory", (10.0, 20.0, 30.0, 40.0, 50.0, 60.0), "time between flips, 2 K/$\\lambda$ [s]"),
        ("direction of the disturbance, from axis 3 to axis 1 [rad]", "its size [rad]", "time of the first flip [s]"),
        {"integrator": "exact", "dt": 0.5, "t_end": 400.0}, "2 K(m)/lambda",
    )  # fmt: skip


def damped_axis():
    scene = Scene(
        Body.from_moments((1.0, 2.0, 3.0)), (EnergyDissipation(0.03),), Start(momentum=Cone(3, 1.0, 0.5, 0.0)),
        observables=(Passage(3, 0.2, "reaches", "momentum"), Passage(-3, 0.2, "reaches", "momentum")),
    )  # fmt: skip

    def derived(ds):
        azimuth, angle = np.meshgrid(ds.x.values, ds.y.values)
        l = np.stack(
            [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]
        )
        up, down = ds["p(passages>=1)"].values, ds["p(passages_2>=1)"].values
        return {
            "end": (
                np.where(ds.good.values > 0, up - down, np.nan),
                {
                    "units": "1",
                    "long_name": "the end of axis 3 that is reached: 1 or -1, 0 where none is",
                },
            ),
            "theory": (
                (l * l / [[[1.0]], [[2.0]], [[3.0]]]).sum(0) * 2.0,
                {"units": "1", "long_name": "2 T I2/L^2: 1 on the separatrices"},
            ),
        }

    return MapCase(
        "Which end of the major axis a body (1, 2, 3) ends up about that loses energy inside", scene,
        ("start.momentum.azimuth", 0.0, 2.0 * math.pi), ("start.momentum.angle", 0.0, math.pi), ("p(passages >= 1)", "p(passages_2 >= 1)", "mean(passage_first)"), 1,
        derived, "end", ("theory", (1.0,), "separatrices 2 T I$_2$ = L$^2$"), ("azimuth of L at the start [rad]", "angle of L from axis 3 at the start [rad]", "end of axis 3 that is reached"), {"integrator": "strang", "dt": 0.2, "t_end": 1500.0},
        "Bloch, Krishnaprasad, Marsden & Ratiu (1996): all but the other axes and their separatrices end about axis 3",
    )  # fmt: skip


def sleeping_top():
    body = Body.from_moments(
        (1.0, 1.0, 0.5), mass=0.5, centre=(0.0, 0.0, 0.5)
    )  # m h^2 <= 0.75 kg m2: there is such a body for all h
    start = Start(
        omega=(0.0, 0.0, 2.0),
        attitude=(uniform(0.0, 2.0 * math.pi), 1e-4, uniform(0.0, 2.0 * math.pi)),
    )
    scene = Scene(body, (Gravity(2.0),), start, observables=(Passage(3, 0.1),))

    def derived(ds):
        spin, height = np.meshgrid(ds.x.values, ds.y.values)
        return {
            "theory": (
                0.25 * spin**2 - 4.0 * height,
                {"units": "J kg m2", "long_name": "C^2 n^2 - 4 A m g h: above 0 the top sleeps"},
            )
        }

    return MapCase(
        "The sleeping top: which fall over, of spin n and height h of the centre", scene,
        ("start.omega.3", 0.0, 5.0), ("body.centre.3", 0.0, 1.0), ("p(passages >= 1)", "mean(passage_first)"), 4,
        derived, "p(passages>=1)", ("theory", (0.0,), "C$^2$n$^2$ = 4 A m g h"), ("spin n [rad/s]", "height h of the centre of mass [m]", "share of the tops that fall over"), {"integrator": "rk8", "dt": 0.1, "t_end": 300.0},
        "C^2 n^2 > 4 A k, TdC (3.77)",
    )  # fmt: skip


def heavy_chaos(moments=(2.0, 2.2, 1.0), centre=(1.0, 0.0, 0.0)):
    scene = Scene(
        Body.from_moments(moments, mass=0.25, centre=centre), (Gravity(4.0),),
        Start(momentum=Shell(1.0, (1.0, 1.0, 1.0)), attitude=(0.0, 1.0, 0.7)),
    )  # fmt: skip

    def derived(ds):
        return {}

    return MapCase(
        "Chaos of a heavy top: Kovalevskaya's, but B = 1.1 A", scene,
        ("start.attitude.theta", 0.0, math.pi), ("start.momentum.energy", 0.0, 5.0), ("mean(megno)", "mean(lyapunov)"), 1,
        derived, "mean(megno)", (), ("angle of axis 3 from the vertical at the start [rad]", "energy [J]", "MEGNO: 2 regular, more chaotic"), {"integrator": "srkn11", "dt": 0.25, "t_end": 1400.0}, "",
    )  # fmt: skip


def kovalevskaya():
    """The same plane for Kovalevskaya's top, which is integrable: A = B = 2 C, the centre in the plane of A and B."""
    return heavy_chaos((2.0, 2.0, 1.0), (1.0, 0.0, 0.0))._replace(
        title="Kovalevskaya's top, A = B = 2 C: regular everywhere"
    )


def kapitza():
    body = Body.from_moments((1.0, 1.0, 0.5), mass=2.0, centre=(0.0, 0.0, 0.5))
    start = Start(omega=(0.0, 0.0, 0.0), attitude=(0.0, normal(0.0, 1e-5), 0.0))
    scene = Scene(
        body,
        (Gravity(1.0), MovingPivot((0.0, 0.0, 0.1), 20.0)),
        start,
        observables=(Passage(3, 0.1),),
    )

    def derived(ds):
        from scipy.special import mathieu_a, mathieu_b

        swing, frequency = np.meshgrid(ds.x.values, ds.y.values)
        a, q = (
            -4.0 / frequency**2,
            2.0 * swing,
        )  # x'' + (a - 2 q cos 2 tau) x = 0 of a lean x, l = 1 m, g = 1 m/s2
        inside = np.minimum(a - mathieu_a(0, q), mathieu_b(1, q) - a)
        return {
            "theory": (
                inside,
                {
                    "units": "1",
                    "long_name": "distance to the bounds a0(q), b1(q) of Mathieu's equation: above 0 it stands",
                },
            )
        }

    return MapCase(
        "Kapitza's pendulum: where a body stands on its head whose pivot is shaken", scene,
        ("effects.moving_pivot.swing.3", 0.0, 0.6), ("effects.moving_pivot.frequency", 3.0, 30.0), ("p(passages >= 1)", "mean(passage_first)"), 1,
        derived, "p(passages>=1)", ("theory", (0.0,), "bounds of Mathieu's equation"), ("swing of the pivot [m]", "its frequency [rad/s]", "share that falls over"), {"integrator": "rk8", "dt": 0.04, "t_end": 200.0},
        "between a0(q) and b1(q); swing frequency > sqrt(2 g l) for small swings (Kapitza 1951)",
    )  # fmt: skip


MAPS: dict[str, Any] = {
    "intermediate_axis": intermediate_axis,
    "growth": growth,
    "disturbance": disturbance,
    "damped_axis": damped_axis,
    "sleeping_top": sleeping_top,
    "heavy_chaos": heavy_chaos,
    "kovalevskaya": kovalevskaya,
    "kapitza": kapitza,
}


def case_map(name, resolution=256, members=None, threads=None, progress=None, **settings):
    """The Dataset of one of MAPS, theory and what else follows among its variables; settings : in place of the map's own, where not None."""
    if name not in MAPS:
        raise unknown("", "map", name, "map", MAPS, OptionError)
    case = MAPS[name]()
    asked = {key: value for key, value in settings.items() if value is not None}
    kept = {
        key: value for key, value in case.settings.items() if not (key == "dt" and "turn" in asked)
    }
    members = case.members if members is None else members
    ds = stability_map(
        case.scene, case.x, case.y, case.of, resolution, members, threads, progress, **kept | asked
    )
    for key, (values, attrs) in case.derived(ds).items():
        ds[key] = (("y", "x"), values, attrs)
    ds.attrs |= {"title": case.title, "map": name, "theory": case.source}
    return ds

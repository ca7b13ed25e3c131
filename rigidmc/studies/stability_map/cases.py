"""The shipped maps. A map is a function that returns a `MapCase`, and an entry of MAPS at the end
of the file."""

import math
from collections.abc import Callable

import numpy as np
import xarray as xr

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.free_top import analyse_free_top
from rigidmc.physics.effects.dissipation import EnergyDissipation
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.gravity_gradient import GravityGradient
from rigidmc.physics.effects.pivot import MovingPivot
from rigidmc.physics.observables.flips import Flips
from rigidmc.physics.observables.passage import Passage
from rigidmc.results.labels import with_units
from rigidmc.scene.body import Body
from rigidmc.scene.distributions import normal, uniform
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from rigidmc.scene.vector_distributions import Cone, Shell
from rigidmc.studies.stability_map.question import MapCase, MapTheory

Vector = tuple[float, float, float]

# Bodies that spin about their intermediate axis: the plane of all bodies with I2 = 1 kg m2
X, Y = ("body.moments.1", 0.0, 1.0), ("body.moments.3", 1.0, 2.0)
RATIOS = "I₁, with I₂ = 1", "I₃, with I₂ = 1"
RATES = (0.1, 0.2, 0.3, 0.5, 0.7, 0.9)  # 1/s: the contours of growth_rate
TILT = 1e-2  # rad: angle of omega from the middle axis at the start of intermediate_axis
# Angles from the middle axis [rad] at the start and end of the timed growth: the decaying part of a
# start at 1e-5 adds (1e-5/FROM)^2 to the rate, the nonlinear part TO^2/6
FROM, TO = 5e-3, 7e-2


def growth_rate(ds: xr.Dataset, i1: Array, i3: Array) -> Array:
    """Return sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega at each pixel of the plane X, Y, for
    omega = 1 rad/s; nan for an impossible body."""
    with np.errstate(all="ignore"):
        rate = np.sqrt((1.0 - i1) * (i3 - 1.0) / (i1 * i3))
    return np.where(ds.none.values == 0, rate, np.nan)


GROWTH_RATE = MapTheory(
    "s-1", "growth rate of a disturbance, sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega", growth_rate
)


def intermediate_axis() -> MapCase:
    """Return the map of the flip rate of a body with moments I1 < I2 < I3."""
    start = Start(omega=Cone(2, 1.0, TILT))
    return MapCase(
        title="The intermediate axis: flip rate of a body that spins about it",
        scene=Scene(Body.from_moments((0.5, 1.0, 1.5)), (), start, observables=(Flips(2),)),
        x=X,
        y=Y,
        of=("mean(flips)", "mean(flip_wait)"),
        members=16,
        derived={
            "rate": MapTheory(
                "s-1",
                "flips per second of a body spun at 1 rad/s, 0.01 rad from its middle axis",
                lambda ds, x, y: ds["mean(flips)"].values / ds.attrs["t_end"],
            ),
            "theory": GROWTH_RATE,
        },
        shown="rate",
        contours=("theory", RATES, with_units("growth rate of a disturbance in theory", "s-1")),
        labels=RATIOS,
        settings={"integrator": "rk8", "dt": 1.2, "t_end": 840.0},
        source="sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega, Goldstein (5.36); flips every 2 K/lambda",
    )


def growth() -> MapCase:
    """Return the map of the growth rate of a disturbance, timed between two angles."""
    passages = tuple(Passage(2, angle, about="momentum") for angle in (FROM, TO))
    start = Start(omega=Cone(2, 1.0, 1e-5))

    def rate(ds: xr.Dataset, x: Array, y: Array) -> Array:
        passed = ds["mean(passage_first_2)"].values - ds["mean(passage_first)"].values
        return np.asarray(math.log(TO / FROM) / passed)

    return MapCase(
        title="The intermediate axis: growth rate of a disturbance",
        scene=Scene(Body.from_moments((0.5, 1.0, 1.5)), (), start, observables=passages),
        x=X,
        y=Y,
        of=("mean(passage_first)", "mean(passage_first_2)"),
        members=4,
        derived={
            "growth": MapTheory(
                "s-1", "measured growth rate of a disturbance of the middle axis", rate
            ),
            "theory": GROWTH_RATE,
            "error": MapTheory(
                "1",
                "relative error of the growth rate",
                lambda ds, x, y: np.abs(rate(ds, x, y) / growth_rate(ds, x, y) - 1.0),
            ),
        },
        shown="growth",
        contours=("theory", RATES, "theory"),
        labels=RATIOS,
        settings={"integrator": "rk8", "dt": 0.5, "t_end": 400.0},
        source="sqrt((I2 - I1)(I3 - I2)/(I1 I3)) omega, Goldstein (5.36)",
    )


def disturbance() -> MapCase:
    """Return the map of the time to the first flip of a body spun about its middle axis.

    A disturbance ten times smaller adds ln 10/lambda to the first wait and 2 ln 10/lambda to each
    wait between flips: between flips it decays and then grows for equal times.
    """
    moments = (1.0, 2.0, 3.0)
    start = Start(omega=Cone(2, 1.0, 1e-3, 0.0))
    flips = (Flips(2, 0.5 * math.pi),)

    def times(ds: xr.Dataset, azimuth: Array, angle: Array) -> tuple[Array, Array]:
        """Return (time of the first flip, time between flips) in theory."""
        across, along = np.sin(angle), np.cos(angle)
        omega = np.stack([across * np.sin(azimuth), along, across * np.cos(azimuth)], axis=-1)
        motion = analyse_free_top(moments, omega * moments)
        # the component along the middle axis is 0 at the phases 0 and 1/2
        return (0.5 - motion.phase % 0.5) * motion.period, motion.flip_interval

    def error(name: str, which: int, ds: xr.Dataset, x: Array, y: Array) -> Array:
        truth = times(ds, x, y)
        return np.asarray(np.abs(ds[name].values - truth[which]) / truth[1])

    words = "error of the {}, relative to the time between flips"
    return MapCase(
        title="Smaller disturbances flip later: time to the first flip of a body (1, 2, 3) spun"
        " about its middle axis",
        scene=Scene(Body.from_moments(moments), (), start, observables=flips),
        x=("start.omega.azimuth", 0.0, 2.0 * math.pi),
        y=("start.omega.angle", 1e-6, 1.0, True),
        of=("mean(flip_first)", "mean(flip_wait)", "mean(flips)"),
        members=1,
        derived={
            "theory": MapTheory("s", "time of the first flip in theory", lambda *at: times(*at)[0]),
            "interval": MapTheory(
                "s", "time between flips, 2 K(m)/lambda", lambda *at: times(*at)[1]
            ),
            "error": MapTheory(
                "1",
                words.format("mean time between flips"),
                lambda *at: error("mean(flip_wait)", 1, *at),
            ),
            "error_first": MapTheory(
                "1",
                words.format("time of the first flip"),
                lambda *at: error("mean(flip_first)", 0, *at),
            ),
        },
        shown="mean(flip_first)",
        contours=(
            "theory",
            (10.0, 20.0, 30.0, 40.0, 50.0, 60.0),
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


SHARES = "p(passages >= 1)", "p(passages_2 >= 1)"


def damped_axis() -> MapCase:
    """Return the map of the end of the major axis about which a body with dissipation settles."""
    start = Start(momentum=Cone(3, 1.0, 0.5, 0.0))
    ends = tuple(Passage(axis, 0.2, "reaches", "momentum") for axis in (3, -3))

    def end(ds: xr.Dataset, x: Array, y: Array) -> Array:
        up, down = ds["p(passages>=1)"].values, ds["p(passages_2>=1)"].values
        return np.where(ds.good.values > 0, up - down, np.nan)

    def energy(ds: xr.Dataset, azimuth: Array, angle: Array) -> Array:
        across = np.sin(angle)
        l = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.cos(angle)])
        return np.asarray((l * l / [[[1.0]], [[2.0]], [[3.0]]]).sum(0) * 2.0)

    # 256 pixels resolve the rings up to 0.05 rad from axis 1
    return MapCase(
        title="The end of the major axis about which a body (1, 2, 3) with dissipation settles",
        scene=Scene(
            Body.from_moments((1.0, 2.0, 3.0)), (EnergyDissipation(0.1),), start, observables=ends
        ),
        x=("start.momentum.azimuth", 0.0, 2.0 * math.pi),
        y=("start.momentum.angle", 0.0, math.pi),
        of=(*SHARES, "mean(passage_first)"),
        members=1,
        derived={
            "end": MapTheory("1", "end of axis 3 reached: 1 or -1, 0 if neither", end),
            "theory": MapTheory("1", "2 T I2/L^2: 1 on the separatrices", energy),
        },
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


def sleeping_top() -> MapCase:
    """Return the map of the spins that keep a top upright."""
    # the body is possible for m h^2 <= 0.75 kg m2; on the map m h^2 <= 0.5 kg m2
    body = Body.from_moments((1.0, 1.0, 0.5), mass=0.5, centre=(0.0, 0.0, 0.5))
    around = uniform(0.0, 2.0 * math.pi)
    start = Start(omega=(0.0, 0.0, 2.0), attitude=(around, 1e-4, around))
    return MapCase(
        title="The sleeping top: spins n and heights h of the centre at which it falls over",
        scene=Scene(body, (Gravity(2.0),), start, observables=(Passage(3, 0.1),)),
        x=("start.omega.3", 0.0, 5.0),
        y=("body.centre.3", 0.0, 1.0),
        of=("p(passages >= 1)", "mean(passage_first)"),
        members=4,
        derived={
            "theory": MapTheory(
                "J kg m2",
                "I3^2 n^2 - 4 I1 m g h: above 0 the top sleeps",
                lambda ds, spin, height: 0.25 * spin**2 - 4.0 * height,
            )
        },
        shown="p(passages>=1)",
        contours=("theory", (0.0,), "I₃² n² = 4 I₁ m g h"),
        labels=("spin n", "height h of the centre of mass", "fraction of the tops that fall over"),
        settings={"integrator": "rk8", "dt": 0.1, "t_end": 300.0},
        source="I3^2 n^2 > 4 I1 m g h, TdC (3.77)",
    )


def heavy_chaos(moments: Vector = (2.0, 2.2, 1.0)) -> MapCase:
    """Return the map of the chaos of a heavy top near Kovalevskaya's, measured by its MEGNO."""
    body = Body.from_moments(moments, mass=0.25, centre=(1.0, 0.0, 0.0))
    start = Start(momentum=Shell(1.0, (1.0, 1.0, 1.0)), attitude=(0.0, 1.0, 0.7))
    return MapCase(
        title="Chaos of a heavy top: Kovalevskaya's, but B = 1.1 A",
        scene=Scene(body, (Gravity(4.0),), start),
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
    """Return the map of the top with A = B = 2 C and the centre of mass in the plane of A and B: it
    is integrable, and so regular everywhere."""
    title = "Kovalevskaya's top, A = B = 2 C: regular everywhere"
    return heavy_chaos((2.0, 2.0, 1.0))._replace(title=title)


def chaos_share() -> MapCase:
    """Return the map of the chaotic fraction of the energy surface of a heavy top, between two
    integrable tops."""
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
        derived={
            "theory": MapTheory(
                "1", "energy / energy of the upright top at rest", lambda ds, x, energy: energy
            )
        },
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


def kapitza() -> MapCase:
    """Return the map of the vibrations of the pivot that keep a body upside down."""

    def inside(ds: xr.Dataset, swing: Array, frequency: Array) -> Array:
        from scipy.special import mathieu_a, mathieu_b

        # x'' + (a - 2 q cos 2 tau) x = 0 for a small angle x, with l = 1 m and g = 1 m/s2
        a, q = -4.0 / frequency**2, 2.0 * swing
        return np.asarray(np.minimum(a - mathieu_a(0, q), mathieu_b(1, q) - a))

    name = "distance to the bounds a0(q), b1(q) of Mathieu's equation: stable above 0"
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
        derived={"theory": MapTheory("1", name, inside)},
        shown="p(passages>=1)",
        contours=("theory", (0.0,), "bounds of Mathieu's equation"),
        labels=("swing of the pivot", "frequency of the pivot", "fraction that falls over"),
        settings={"integrator": "rk8", "dt": 0.04, "t_end": 200.0},
        source="stable between a0(q) and b1(q); swing frequency > sqrt(2 g l) for small swings"
        " (Kapitza 1951)",
    )


MU, DISTANCE = 3.7931e16, 1.4813e9  # G M of Saturn [m3/s2], and the semi-major axis [m]
RATE = math.sqrt(MU / DISTANCE**3)  # mean motion


def hyperion_chaos() -> MapCase:
    """Return the map of how much of Hyperion's rotation is chaotic, by its spin and the lean of its
    long axis."""
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
        derived={
            "spin_ratio": MapTheory("1", "spin / mean motion", lambda ds, x, spin: spin / RATE)
        },
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


MAPS: dict[str, Callable[[], MapCase]] = {
    "intermediate_axis": intermediate_axis,
    "growth": growth,
    "disturbance": disturbance,
    "damped_axis": damped_axis,
    "sleeping_top": sleeping_top,
    "heavy_chaos": heavy_chaos,
    "chaos_share": chaos_share,
    "kovalevskaya": kovalevskaya,
    "kapitza": kapitza,
    "hyperion_chaos": hyperion_chaos,
}

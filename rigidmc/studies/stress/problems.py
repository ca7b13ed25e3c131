"""Named bodies and starts with published facts about their motion, each number with its source.

The hard cases, the tests and the benchmarks use them. Units are SI unless an entry gives others;
the motion of a free body does not depend on the unit of its moments.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects.gravity import Gravity

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class Problem:
    """A body with a fixed point, its start, and its published end.

    moments, static_moment : principal moments [kg m^2], mass times centre of mass [kg m]
    gravity : g [m/s^2], 0 for a free body
    momentum, attitude : at the start, body components and quaternion (w, x, y, z)
    time : of the end [s];  end_momentum, end_attitude : the state there, None if not published
    more : other data of the source
    """

    moments: Vector
    momentum: Vector
    source: str
    static_moment: Vector = (0.0, 0.0, 0.0)
    gravity: float = 0.0
    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    time: float = 0.0
    end_momentum: Vector | None = None
    end_attitude: Quaternion | None = None
    more: dict[str, Any] = field(default_factory=dict)

    @property
    def body(self) -> MassProperties:
        moments = tuple(map(float, self.moments))
        body: MassProperties = MassProperties.of(moments, self.static_moment)
        return body

    @property
    def effects(self) -> tuple[Gravity, ...]:
        return (Gravity(self.gravity),) if self.gravity else ()

    @property
    def omega(self) -> tuple[float, ...]:
        return tuple(l / i for l, i in zip(self.momentum, self.moments, strict=True))


def _spinning(moments: Vector, omega: Vector, source: str, **rest: Any) -> Problem:
    """Return a Problem given by its angular velocity."""
    l1, l2, l3 = (i * w for i, w in zip(moments, omega, strict=True))
    return Problem(moments, (l1, l2, l3), source, **rest)


_TAYLOR = "end from 34-digit Taylor series"
_NASA = (
    "NASA TM-2015-218675, check-case 2, tumbling brick; moments in slug ft^2."
    " Rates from the exact solution"
)
_HAIRER_VILMART = f"Hairer & Vilmart, J. Phys. A 39 (2006) 13225, body; {_TAYLOR}"
_CARDONA = f"Bruels & Cardona, J. Comput. Nonlinear Dyn. 5 (2010) 031002, heavy top; {_TAYLOR}"
_TOMS = "Celledoni & Zanna, ACM TOMS 37 (2010), Algorithm 903, test output"
_ELLIPTIC = "flips every 2 K(m)/lambda, Jacobi's solution at 34 digits"

PROBLEMS: dict[str, Problem] = {
    "nasa_brick": _spinning(
        (0.001894220, 0.006211019, 0.007194665),
        (math.radians(10.0), math.radians(20.0), math.radians(30.0)),
        _NASA,
        time=30.0,
        end_attitude=(
            -0.88114718531042352,
            0.47018252776669253,
            0.0117282523248711814,
            0.0486875394720837703,
        ),
        more={
            "rates": {  # body rates [deg/s] at times [s]
                5.0: (-16.93948514944125, 9.631939377415166, 33.40662807944626),
                10.0: (-2.418902221692877, -23.5525695195605, 28.12859263004144),
                15.0: (18.43725431360672, 2.386880299125055, 34.31070561161573),
                20.0: (-5.422734680068388, 22.71593057645249, 28.60828174731663),
                25.0: (-15.1840887010873, -13.61779950061295, 32.41679619837892),
                30.0: (12.61839077591422, -17.39747476161139, 31.11958888694434),
            }
        },
    ),
    "cardona_top": _spinning(
        (15.234375, 0.46875, 15.234375),
        (0.0, 150.0, -4.61538),
        _CARDONA,
        static_moment=(0.0, 15.0, 0.0),
        gravity=9.81,
        time=2.0,
        end_attitude=(
            0.1229471350415334671,
            -0.4910798925500270147,
            0.35043003034362096184,
            -0.78798688755048566932,
        ),
        more={
            "energy": 5435.696790865546875,
            "spatial_lz": -70.3124296875,
            "omega_space": (-27.6585155258232691, -106.163804143124448, -102.462463805326103),
            "centre": (-0.15041682274564175981, -0.72416559163689565075, -0.67302226956044409605),
            # w_y(2) of the Lie-group RK4 of EXUDYN, by number of steps
            "exudyn": {
                1000: -105.89196163228372,
                2000: -106.16651966442134,
                4000: -106.16459373617013,
                8000: -106.16387282138162,
            },
        },
    ),
    "toms903_step": Problem(
        (1.0, 1.6487857827119290, 1.9720127096641928),
        (-0.709894965287627, -0.685144717153487, 0.163174308075589),
        _TOMS,
        time=0.1,
        end_momentum=(-0.7088447919224319, -0.6905148054187735, 0.1439734852739128),
        end_attitude=(
            0.9991459727846651,
            -0.035456085277494165,
            -0.020857297061205097,
            0.0038941294638131442,
        ),
    ),
    "toms903_run": Problem(
        (1.0, 1.012686988782515, 3.306237422473038),
        (-0.609860759302936, 0.761660947972381, 0.218957654801698),
        _TOMS,
        time=10.0,
        end_momentum=(-0.7243786338874610, -0.6515663606923394, 0.2252484681001733),
    ),
    "hairer_free": Problem(
        (0.6, 0.8, 1.0),
        (1.8, 0.4, -0.9),
        _HAIRER_VILMART,
        time=10.0,
        end_momentum=(
            1.76596250851820753572715,
            -0.6954641970330891194994928,
            0.7795549814818710861007418,
        ),
        end_attitude=(
            -0.7360613641607939361612411,
            -0.5707869512403507332546212,
            -0.2993885718307900937437669,
            -0.2068390861046731924831171,
        ),
    ),
    "hairer_heavy": Problem(
        (0.6, 0.8, 1.0),
        (1.8, 0.4, -0.9),
        _HAIRER_VILMART,
        static_moment=(0.0, 0.0, 1.0),
        gravity=1.0,
        time=10.0,
        end_momentum=(
            1.922573381663007509018555,
            0.7720232344670846457487008,
            -0.2011054792035473313288932,
        ),
        end_attitude=(
            0.9257399890934634917875326,
            -0.3514906679727553121760867,
            0.1021838760186524964441628,
            -0.09496440597984612018244037,
        ),
        more={"energy": 4.205},
    ),
    "hairer_lubich_wanner": Problem(
        (2.0, 1.0, 2.0 / 3.0),
        (math.cos(1.1), 0.0, math.sin(1.1)),
        f"Hairer, Lubich & Wanner, Geometric Numerical Integration (2006), VII.5; {_TAYLOR}",
        time=10.0,
        end_momentum=(0.407066136588040811, 0.283007426812844076, 0.868449167661561644),
    ),
    "simo_wong_top": _spinning(
        (5.0, 5.0, 1.0),
        (0.0, 0.0, 50.0),
        f"Simo & Wong, Int. J. Numer. Methods Eng. 31 (1991) 19, fast top; {_TAYLOR}",
        static_moment=(0.0, 0.0, 20.0),
        gravity=1.0,
        attitude=(math.cos(0.025), math.sin(0.025), 0.0, 0.0),
        time=10.0,
        more={
            "energy": 1269.97500520789932,
            "axis": (-0.0471322314419818762, 0.0267486863587098849, 0.998530450480796716),
        },
    ),
    "exudyn_step": _spinning(
        (5.2988, 1.1775, 4.3568),
        (2.0, 4.0, 6.0),
        "EXUDYN test suite, one step of RKMK4 from the rotation vector (1, 2, 3)",
        attitude=(
            math.cos(math.sqrt(14.0) / 2.0),
            *(math.sin(math.sqrt(14.0) / 2.0) / math.sqrt(14.0) * x for x in (1.0, 2.0, 3.0)),
        ),
        time=1e-3,
        more={
            "rotation_vector": (1.002014565846977, 2.003988840119048, 3.006000763507420),
            "omega": (1.985608117600764, 3.990428541317109, 6.007531319827856),
        },
    ),
    "flip_1e-2": _spinning(
        (1.0, 2.0, 3.0), (1e-2, 1.0, 0.0), _ELLIPTIC, more={"flip": 20.754609764669243823940}
    ),
    "flip_1e-4": _spinning(
        (1.0, 2.0, 3.0), (1e-4, 1.0, 0.0), _ELLIPTIC, more={"flip": 36.707819410833642463}
    ),
    "flip_1e-8": _spinning(
        (1.0, 2.0, 3.0), (1e-8, 1.0, 0.0), _ELLIPTIC, more={"flip": 68.613374452474097064}
    ),
    "flip_fast": _spinning(
        (0.3, 0.35, 0.4), (0.1, 15.0, 0.1), _ELLIPTIC, more={"flip": 6.167472904669551}
    ),
    "tennis_racket": _spinning(
        (0.00121, 0.01638, 0.01748),
        (0.01, 6.0, 0.01),
        _ELLIPTIC + "; moments: Ashbaugh, Chicone & Cushman, J. Dyn. Differ. Equ. 3 (1991) 67",
        more={"flip": 3.4759014616413309},
    ),
}

# {name: (moments, momentum)} of free bodies at the limits of formulas: a step of any length must be
# right to rounding
HARD: dict[str, tuple[Vector, Vector]] = {
    "generic": ((1.0, 1.3, 2.0), (0.3, 0.9, 0.7)),
    "separatrix": ((1.0, 2.0, 3.0), (1.0, 1.0, math.sqrt(3.0))),
    "separatrix_below": ((1.0, 2.0, 3.0), (1.0 - 1e-9, 1.0, math.sqrt(3.0))),
    "separatrix_above": ((1.0, 2.0, 3.0), (1.0 + 1e-9, 1.0, math.sqrt(3.0))),
    "near_middle_axis": ((1.0, 2.0, 3.0), (1e-9, 1.0, 0.0)),
    "near_middle_axis_13": ((1.0, 2.0, 3.0), (1e-13, 1.0, 1e-13)),
    "near_first_axis": ((1.0, 2.0, 3.0), (1.0, 1e-8, 1e-12)),
    "near_third_axis": ((1.0, 2.0, 3.0), (1e-12, 1e-8, -1.0)),
    "sphere": ((1.0, 1.0, 1.0), (0.3, 0.2, 0.1)),
    "oblate": ((1.0, 1.0, 2.0), (0.3, 0.2, 0.1)),
    "prolate": ((1.0, 2.0, 2.0), (0.3, 0.2, 0.1)),
    "flat_plate": ((1.0, 2.0, 3.0), (0.5, -0.8, 0.3)),
    "flat_disc": ((1.0, 1.0, 2.0), (-0.1, 0.2, 1.0)),
    "needle": ((1e-6, 1.0, 1.0000005), (1e-7, 0.1, 0.1)),
    "needle_on_edge": ((1e-6, 1.0, 1.0000005), (1e-7, 1e-3, 0.1)),
    "rod": ((1e-9, 1.0, 1.0), (1e-10, 0.3, -0.2)),
}

"""Named bodies and starts with published ends of their motion, each number with its source.

Units are SI unless an entry gives others; the motion of a free body does not depend on the unit of
its moments.
"""

import math
from dataclasses import dataclass
from typing import Any

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

    @property
    def effects(self) -> tuple[Gravity, ...]:
        return (Gravity(self.gravity),) if self.gravity else ()


def spinning(moments: Vector, omega: Vector, source: str, **rest: Any) -> Problem:
    """Return a Problem given by its angular velocity."""
    l1, l2, l3 = (i * w for i, w in zip(moments, omega, strict=True))
    return Problem(moments, (l1, l2, l3), source, **rest)


TAYLOR = "end from 34-digit Taylor series"
_NASA = (
    "NASA TM-2015-218675, check-case 2, tumbling brick; moments in slug ft^2."
    " Rates from the exact solution"
)
_HAIRER_VILMART = f"Hairer & Vilmart, J. Phys. A 39 (2006) 13225, body; {TAYLOR}"
_CARDONA = f"Bruels & Cardona, J. Comput. Nonlinear Dyn. 5 (2010) 031002, heavy top; {TAYLOR}"
TOMS = "Celledoni & Zanna, ACM TOMS 37 (2010), Algorithm 903, test output"

PROBLEMS: dict[str, Problem] = {
    "nasa_brick": spinning(
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
    ),
    "cardona_top": spinning(
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
    ),
    "toms903_step": Problem(
        (1.0, 1.6487857827119290, 1.9720127096641928),
        (-0.709894965287627, -0.685144717153487, 0.163174308075589),
        TOMS,
        time=0.1,
        end_momentum=(-0.7088447919224319, -0.6905148054187735, 0.1439734852739128),
        end_attitude=(
            0.9991459727846651,
            -0.035456085277494165,
            -0.020857297061205097,
            0.0038941294638131442,
        ),
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
    ),
}

# {name: (moments, momentum)} of free bodies at the limits of formulas: a step of any length must be
# right to rounding
HARD: dict[str, tuple[Vector, Vector]] = {
    "separatrix": ((1.0, 2.0, 3.0), (1.0, 1.0, math.sqrt(3.0))),
    "separatrix_below": ((1.0, 2.0, 3.0), (1.0 - 1e-9, 1.0, math.sqrt(3.0))),
    "separatrix_above": ((1.0, 2.0, 3.0), (1.0 + 1e-9, 1.0, math.sqrt(3.0))),
    "near_middle_axis_13": ((1.0, 2.0, 3.0), (1e-13, 1.0, 1e-13)),
    "flat_plate": ((1.0, 2.0, 3.0), (0.5, -0.8, 0.3)),
    "flat_disc": ((1.0, 1.0, 2.0), (-0.1, 0.2, 1.0)),
    "needle": ((1e-6, 1.0, 1.0000005), (1e-7, 0.1, 0.1)),
    "needle_on_edge": ((1e-6, 1.0, 1.0000005), (1e-7, 1e-3, 0.1)),
    "rod": ((1e-9, 1.0, 1.0), (1e-10, 0.3, -0.2)),
}

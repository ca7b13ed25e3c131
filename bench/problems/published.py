"""Published facts about the motion of named bodies, each number with its source: those of the hard
cases, with more facts, and others."""

import math
from dataclasses import dataclass, field
from typing import Any

from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.studies.stress import problems
from rigidmc.studies.stress.problems import TAYLOR, TOMS, Problem


@dataclass(frozen=True)
class Published(Problem):
    """A body with a fixed point, its start, and what is published about its motion.

    more : data of the source besides the end
    """

    more: dict[str, Any] = field(default_factory=dict)

    @property
    def body(self):
        return MassProperties.of(tuple(map(float, self.moments)), self.static_moment)

    @property
    def omega(self):
        return tuple(l / i for l, i in zip(self.momentum, self.moments, strict=True))


def spinning(moments, omega, source, **rest):
    """Return a problem given by its angular velocity."""
    momentum = tuple(i * w for i, w in zip(moments, omega, strict=True))
    return Published(moments, momentum, source, **rest)


ELLIPTIC = "flips every 2 K(m)/lambda, Jacobi's solution at 34 digits"
MORE = {  # about problems of the hard cases
    "nasa_brick": {
        "rates": {  # body rates [deg/s] at times [s]
            5.0: (-16.93948514944125, 9.631939377415166, 33.40662807944626),
            10.0: (-2.418902221692877, -23.5525695195605, 28.12859263004144),
            15.0: (18.43725431360672, 2.386880299125055, 34.31070561161573),
            20.0: (-5.422734680068388, 22.71593057645249, 28.60828174731663),
            25.0: (-15.1840887010873, -13.61779950061295, 32.41679619837892),
            30.0: (12.61839077591422, -17.39747476161139, 31.11958888694434),
        }
    },
    "cardona_top": {
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
    "hairer_heavy": {"energy": 4.205},
}
PROBLEMS = {
    **{
        name: Published(**vars(problem), more=MORE.get(name, {}))
        for name, problem in problems.PROBLEMS.items()
    },
    "toms903_run": Published(
        (1.0, 1.012686988782515, 3.306237422473038),
        (-0.609860759302936, 0.761660947972381, 0.218957654801698),
        TOMS,
        time=10.0,
        end_momentum=(-0.7243786338874610, -0.6515663606923394, 0.2252484681001733),
    ),
    "hairer_lubich_wanner": Published(
        (2.0, 1.0, 2.0 / 3.0),
        (math.cos(1.1), 0.0, math.sin(1.1)),
        f"Hairer, Lubich & Wanner, Geometric Numerical Integration (2006), VII.5; {TAYLOR}",
        time=10.0,
        end_momentum=(0.407066136588040811, 0.283007426812844076, 0.868449167661561644),
    ),
    "simo_wong_top": spinning(
        (5.0, 5.0, 1.0),
        (0.0, 0.0, 50.0),
        f"Simo & Wong, Int. J. Numer. Methods Eng. 31 (1991) 19, fast top; {TAYLOR}",
        static_moment=(0.0, 0.0, 20.0),
        gravity=1.0,
        attitude=(math.cos(0.025), math.sin(0.025), 0.0, 0.0),
        time=10.0,
        more={
            "energy": 1269.97500520789932,
            "axis": (-0.0471322314419818762, 0.0267486863587098849, 0.998530450480796716),
        },
    ),
    "exudyn_step": spinning(
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
    "flip_1e-2": spinning(
        (1.0, 2.0, 3.0), (1e-2, 1.0, 0.0), ELLIPTIC, more={"flip": 20.754609764669243823940}
    ),
    "flip_1e-4": spinning(
        (1.0, 2.0, 3.0), (1e-4, 1.0, 0.0), ELLIPTIC, more={"flip": 36.707819410833642463}
    ),
    "flip_1e-8": spinning(
        (1.0, 2.0, 3.0), (1e-8, 1.0, 0.0), ELLIPTIC, more={"flip": 68.613374452474097064}
    ),
    "flip_fast": spinning(
        (0.3, 0.35, 0.4), (0.1, 15.0, 0.1), ELLIPTIC, more={"flip": 6.167472904669551}
    ),
    "tennis_racket": spinning(
        (0.00121, 0.01638, 0.01748),
        (0.01, 6.0, 0.01),
        ELLIPTIC + "; moments: Ashbaugh, Chicone & Cushman, J. Dyn. Differ. Equ. 3 (1991) 67",
        more={"flip": 3.4759014616413309},
    ),
}
# {name: (moments, momentum)} of free bodies at the limits of formulas
HARD = {
    **problems.HARD,
    "generic": ((1.0, 1.3, 2.0), (0.3, 0.9, 0.7)),
    "near_middle_axis": ((1.0, 2.0, 3.0), (1e-9, 1.0, 0.0)),
    "near_first_axis": ((1.0, 2.0, 3.0), (1.0, 1e-8, 1e-12)),
    "near_third_axis": ((1.0, 2.0, 3.0), (1e-12, 1e-8, -1.0)),
    "sphere": ((1.0, 1.0, 1.0), (0.3, 0.2, 0.1)),
    "oblate": ((1.0, 1.0, 2.0), (0.3, 0.2, 0.1)),
    "prolate": ((1.0, 2.0, 2.0), (0.3, 0.2, 0.1)),
}

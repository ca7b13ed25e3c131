"""How much code is compiled: LLVM instructions of each piece, with which the time to compile grows. Bounds are a tenth above what is measured."""

import pytest
from numba import njit, typeof

import rigidmc as rm
from rigidmc.engine import cpu, entries
from rigidmc.engine.pieces import dispatcher_of, signature_of
from rigidmc.engine.program import TYPICAL, Pieces
from rigidmc.jobs import program_of
from rigidmc.planning import prepare

pytestmark = pytest.mark.skipif(bool(entries.config.DISABLE_JIT), reason="nothing is compiled")

BOUNDS = {  # (integrator, with gravity, what is saved): {piece: instructions}
    ("rk4", False, "omega,attitude"): {
        "enter": 108, "leave": 165, "begin": 228, "march": 628, "look": 355, "record": 46,  # measured 98, 150, 207, 571, 323, 42
    },
    ("rk4", True, "omega,attitude"): {"begin": 246, "march": 868, "look": 355},  # measured 224, 789, 323
    ("rk8", True, "omega,attitude"): {"begin": 232, "march": 2470, "look": 338},  # measured 211, 2243, 307
    ("strang", True, "omega,attitude"): {"begin": 254, "march": 1114, "look": 374},  # measured 231, 1013, 340
    ("midpoint", True, "omega,attitude"): {"begin": 232, "march": 1841, "look": 338},  # measured 211, 1674, 307
    ("rk4", True, "flips"): {"begin_watch": 110, "watch": 286, "seek": 181},  # measured 100, 260, 165
    ("rk4", True, "megno"): {"begin_near": 114, "meet": 181},  # measured 104, 165
}  # fmt: skip
ADVANCE = 4700  # measured 4280: the loop over members, compiled once for all scenes


def program(integrator, heavy, save):
    """The Program of a small scene, of which nothing is compiled."""
    body = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
    effects = (rm.Gravity(9.81),) if heavy else ()
    scene = rm.Scene(body, effects, rm.Start(omega=(0.5, 0.7, 0.5), attitude=(1.0, 0.0, 0.0, 0.0)))
    scene = scene.with_run(integrator=integrator, dt=0.1, t_end=1.0, save=tuple(save.split(",")))
    return program_of(scene, prepare(scene), compile=False)


def instructions(dispatcher, signature):
    """How many LLVM instructions a function has once it is optimised. It is compiled here: code of the disk cache cannot be read."""
    dispatcher.compile(signature)
    (made,) = dispatcher.overloads.values()
    return sum(line.startswith("  ") and line[2] != " " for line in made.library.get_llvm_str().splitlines())


@pytest.mark.parametrize("case", BOUNDS, ids=lambda case: f"{case[0]}-{'heavy' if case[1] else 'free'}-{case[2]}")
def test_a_piece_has_no_more_code_than_it_had(case):
    asked = dict(zip(Pieces._fields, program(*case)._asked, strict=True))
    found = {name: instructions(dispatcher_of(asked[name][0]), signature_of(*asked[name][1:])) for name in BOUNDS[case]}
    assert {name: count for name, count in found.items() if count > BOUNDS[case][name]} == {}, found


def test_the_loop_over_members_has_no_more_code_than_it_had():
    signature = tuple(map(typeof, program("rk4", False, "omega")._arguments(*TYPICAL)))
    assert 1000 < instructions(njit(**entries._options)(cpu.advance), signature) < ADVANCE

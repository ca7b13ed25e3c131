"""How much code is compiled: LLVM instructions of each piece, which set the compile time.

Bounds are a tenth above the measured numbers. LLVM unrolls more where a processor has a loop
buffer: numbers in brackets are measured on a Zen 4 ("znver4" to LLVM), the others on a Xeon.
"""

import pytest

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from tests.tools.assembly import library_of
from tests.tools.plans import program_of
from tests.tools.scenes import UNSYMMETRIC

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")

# (integrator, with gravity, what is saved): {piece: instructions}; `advance` is the loop over
# members, compiled once for all scenes
BOUNDS = {
    ("rk4", False, "omega,attitude"): {
        "gather": 173, "scatter": 431, "initialise": 227, "march": 567, "assess": 412, "record": 80,
        "advance": 7250,
        # measured 98 (157), 143 (392), 211, 515 (433), 375, 73, on 256 bits 5213; 6596 on a Zen 5
        # since steps may be cut
    },
    # measured 229, 729, 375
    ("rk4", True, "omega,attitude"): {"initialise": 252, "march": 802, "assess": 412},
    # measured 216, 2079, 359
    ("rk8", True, "omega,attitude"): {"initialise": 238, "march": 2290, "assess": 395},
    # measured 239, 1014, 393
    ("strang", True, "omega,attitude"): {"initialise": 263, "march": 1115, "assess": 432},
    # measured 216, 1515, 359
    ("midpoint", True, "omega,attitude"): {"initialise": 238, "march": 1667, "assess": 395},
    # measured 100, 259, 165
    # measured 104, 832, 171
    ("rk4", True, "flips"): {"begin_monitors": 114, "monitor_steps": 915, "refine_event": 188},
    # measured 1287: the steps of a search are loaded member by member
    ("rk4", True, "omega_max"): {"monitor_steps": 1416},
    # measured 92, 143; on 256 bits 281
    ("rk4", True, "energy_mean"): {"begin_monitors": 102, "monitor_steps": 309},
    ("rk4", True, "megno"): {"begin_growth": 217, "record_growth": 240},  # measured 197, 218
}  # fmt: skip


def asked(integrator, heavy, save, effects=()):
    """{piece: what it is compiled for} for a small scene."""
    effects = (rm.Gravity(9.81),) if heavy else effects
    scene = rm.Scene(UNSYMMETRIC, effects, rm.Start(omega=(0.5, 0.7, 0.5)))
    run = {"integrator": integrator, "dt": 0.1, "t_end": 1.0, "save": tuple(save.split(","))}
    return program_of(scene.with_run(**run)).kernel_keys


def instructions(kernel):
    """The number of LLVM instructions of a piece after optimisation."""
    lines = library_of(kernel).get_llvm_str().splitlines()
    return sum(line.startswith("  ") and line[2] != " " for line in lines)


@pytest.mark.parametrize(
    "case", BOUNDS, ids=lambda case: f"{case[0]}-{'heavy' if case[1] else 'free'}-{case[2]}"
)
def test_a_piece_has_no_more_code_than_it_had(case):
    pieces, bounds = asked(*case), BOUNDS[case]
    found = {name: instructions(pieces[name]) for name in bounds}
    assert all(0 < count <= bounds[name] for name, count in found.items()), found


def test_more_physics_is_more_code():
    """The count sees what is compiled; otherwise no bound could fail."""
    free, heavy = (
        instructions(asked("rk4", heavy, "omega,attitude")["march"]) for heavy in (False, True)
    )
    assert heavy > BOUNDS["rk4", False, "omega,attitude"]["march"] > free


def test_deviates_are_compiled_for_random_effects_alone():
    """What the optimiser removes again takes its time: `march` with gravity took 1.8 s, not 1.2."""

    def called(effects):
        libraries = library_of(asked("strang", False, "omega", effects)["march"])._linking_libraries
        return {library.name for library in libraries}

    assert "philox" not in called((rm.Gravity(9.81), rm.ViscousDamping(0.1)))
    assert "philox" in called((rm.Gravity(9.81), rm.Bath(1.0, 0.1)))

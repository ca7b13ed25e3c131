"""Other units change no pure number: of functions that take a scene, observables and closed forms.

The quick tests take powers of 2, under which not a bit may change. All functions for 32 scenes with
moments, masses and torques times 1e-20 and 1e20, and times times 1e-6 and 1e6 (half an hour)::

    pytest -n 0 -m slow tests/whole/test_units.py

`python -m tests.tools.pure_numbers` prints the table of what they differ by.
"""

import re
from pathlib import Path

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.scene.vector_distributions import VECTOR_DISTRIBUTIONS
from rigidmc.views.accessor import Rigid
from tests.tools import units
from tests.tools.pure_numbers import LIMIT, LIMITS, SEEDS, answer, differences, rows
from tests.tools.units import BINARY, KINDS, PLAIN, asked, drivers, in_units, observed

QUICK = ("section", "rare, event", "fit", "design")

# what a user has of the package, beside the functions that `asked` asks
CLOSED_FORMS = {
    *("solve_free_top", "analyse_free_top", "solve_lagrange_top", "analyse_lagrange_top"),
    *("effective_potential", "steady_precession", "least_spin", "tilt_growth"),
    *("euler_rates", "omega_from_euler_rates"),
}  # below, and in tests/mechanics/test_closed_form_limits.py against 60 digits
SCENES = {"Scene", "Body", "Start", "Run", "normal"}  # every scene of `units`
DRAWN = {  # tests/scene/test_units.py
    *("uniform", "distribution", "mixture", "common", "grid"),
    *(kind.__name__ for kind in VECTOR_DISTRIBUTIONS),
}
NO_NUMBERS = {
    *(
        "precompile",
        "device",
        "open",
        "prepare",
        "PreparedRun",
    ),  # they compute nothing, or give back what was stored
    *(
        "RigidmcError",
        "SceneError",
        "PartError",
        "OptionError",
        "NoDevice",
        "FileError",
        "OutputExists",
    ),
    "SceneWarning",
}
# of `ds.rigid`: the names of the scene, words and pictures of the numbers that are asked, files
NO_METHODS = {"scene", "summary", "view", "export"}
METHODS = {
    *("measure", "rerun", "momentum", "euler", "unwrapped", "phase", "energy", "drift"),
    *("polhode", "described", "principal", "rotation"),
}


def test_every_public_thing_is_asked():
    names = asked(units.scene("free", 1), PLAIN)
    functions = {re.match(r"[a-z_]+", name)[0] for name in names}
    effects = {"".join(map(str.title, word.split("_"))) for word in drivers()}
    seen = {name for kind in KINDS for name in observed(units.scene(kind, 1), 1.0)[1]}
    observables = {"".join(map(str.title, word.split("_"))) for word in (*seen, "histogram")}
    known = functions | CLOSED_FORMS | SCENES | DRAWN | NO_NUMBERS | effects | observables
    assert set(rm.__all__) - known == set(), "add a function to `asked` of tests/tools/units.py"
    assert {*OBSERVABLES} - seen == {"histogram"}
    methods = {name for name in dir(Rigid) if not name.startswith("_")}
    assert methods == METHODS | NO_METHODS


# what stands for a number that is 0, what is added to one, and numbers at the ends of floats
GUARD = re.compile(
    r"(select|where)\(\w+( (>|!=) 0(\.0)?)?, [a-z][\w.]*, 1(\.0)?\)"
    r"|(select|where)\(\w+ == 0\.0, 1\.0,"
    r"|\b1(\.0)? \+ (np\.)?f?abs\(|\bor 1\.0\b|\w > 0(\.0)? else 1\.0"
    r"|max\(1\.0, [^()]*abs|max(imum)?\(.*abs\(.*, 1\.0\)"
    r"|(?<![\w.])\d(\.\d*)?e-([1-9]\d\d|[3-9]\d)\b"
)


def test_guards_tell_their_unit():
    """A comment on the line or right above it says why the number is right in any unit."""
    root, silent, found = Path(rm.__file__).parent, [], 0
    for path in sorted(root.rglob("*.py")):
        if "stress/numerical_cases" in path.as_posix():  # scenes at the ends of floats
            continue
        source = re.sub(
            r'"""[\s\S]*?"""', lambda text: "\n" * text[0].count("\n"), path.read_text()
        )
        lines = source.splitlines()
        for i, line in enumerate(lines):
            if GUARD.search(line.split("  #")[0]) and not line.lstrip().startswith("#"):
                found += 1
                near = lines[max(0, i - 1)].lstrip()
                if "  # " not in line and not near.startswith("# "):
                    silent.append(f"{path.relative_to(root)}:{i + 1}: {line.strip()}")
    assert not silent, "\n".join(silent)
    assert found > 40


@pytest.mark.parametrize("name", QUICK)
def test_powers_of_two_change_no_bit(name):
    one = units.scene("free", 1)
    plain = answer(asked(one, PLAIN)[name], PLAIN)
    assert not plain.error and plain.numbers
    for other in BINARY:
        found = answer(asked(in_units(one, other), other)[name], other)
        assert set(differences(plain, found).values()) == {0.0}, other


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS)
def test_all_functions_of_a_scene(kind, seed):
    worst = {}
    for name, row in rows(kind, seed):
        worst[name] = worst[name] + row if name in worst else row
    assert {n: row for n, row in worst.items() if row.off > LIMITS.get(n, LIMIT)} == {}


@pytest.mark.parametrize("mass", [1e-20, 1e20])
@pytest.mark.parametrize("time", [1e-6, 1e6])
def test_closed_forms(mass, time):
    """free_top, free_motion, lagrange_top and lagrange_motion of 30 bodies each."""
    some = np.random.default_rng(3)
    second = some.uniform(0.3, 0.9, (30, 3))
    moments = second.sum(axis=1, keepdims=True) - second
    tops = np.stack([moments[:, 0], moments[:, 0], second[:, 2]], axis=1)
    momentum, t = some.normal(size=(30, 3)), np.linspace(0.0, 5.0, 4)[:, None]
    attitude = some.normal(size=(30, 4))
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    weight = some.uniform(0.5, 2.0, 30)
    one, two = (
        {
            "free_top": rm.solve_free_top(m * moments, m / s * momentum, attitude, s * t),
            "free_motion": rm.analyse_free_top(m * moments, m / s * momentum),
            "lagrange_top": rm.solve_lagrange_top(
                m * tops, m / s**2 * weight, m / s * momentum, attitude, s * t
            ),
            "lagrange_motion": rm.analyse_lagrange_top(
                m * tops, m / s**2 * weight, m / s * momentum, attitude
            ),
        }
        for m, s in ((1.0, 1.0), (mass, time))
    )
    of = {"momentum": mass / time, "p_phi": mass / time, "p_psi": mass / time}
    of |= {"energy": mass / time**2, "period": time, "flip_interval": time}
    of |= dict.fromkeys(("omega", "rate"), 1.0 / time)
    for name, motion in one.items():
        for field in motion._fields:
            a, b = (np.asarray(getattr(x[name], field)) for x in (one, two))
            if a.dtype.kind == "f":
                b = b / of.get(field, 1.0)
                assert np.array_equal(np.isfinite(a), np.isfinite(b)), (name, field)
                ends = np.isfinite(a)
                # measured 4e-14
                off = np.abs(a[ends] - b[ends]).max() / np.abs(a[ends]).max()
                assert off < 1e-12, (name, field)
            else:
                assert np.array_equal(a, b), (name, field)

"""Units, labels and counts as people read them."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.observables import bare_observables
from rigidmc.planning.unit_scale import unit_exponents
from rigidmc.results.labels import (
    axis_label,
    column_head,
    count_text,
    in_degrees,
    in_symbols,
    label_of,
    long_label,
    units_text,
    value_text,
    with_degrees,
    with_units,
)
from rigidmc.scene.derivatives import parameter_names_of_derivatives
from rigidmc.scene.library import shipped_names
from rigidmc.scene.parameters import parameter_names


@pytest.mark.parametrize(
    ("units", "text"),
    [
        ("1", ""),
        ("s-1", "1/s"),
        ("rad s-1", "rad/s"),
        ("kg m2", "kg m²"),
        ("kg m2 s-1", "kg m²/s"),
        ("kg2 m4 s-2", "kg² m⁴/s²"),
        ("J kg m2", "J kg m²"),
        ("W m-2 K-1", "W/(m² K)"),
        # of a user's own observable, which may be anything
        ("km/h", "km/h"),
        ("1e-05 J", "1e-05 J"),
        ("", ""),
    ],
)
def test_units(units, text):
    assert units_text(units) == text
    assert with_units("speed", units) == (f"speed [{text}]" if text else "speed")


def test_units_of_the_package_are_read():
    """None is taken for something that it is not: text and units have the same dimensions."""
    known = {units for kind in EFFECTS.values() for units in kind.units.values()}
    known |= {kind.units for kind in bare_observables().values()}
    assert len(known) > 10
    lowered = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")
    for units in known - {"1"}:
        above, _, below = units_text(units).translate(lowered).partition("/")
        found, under = unit_exponents(above), unit_exponents(below.strip("()") or "1")
        assert tuple(np.subtract(found, under)) == unit_exponents(units), units


@pytest.fixture
def ds():
    three, one = ("axis", [1.0, 2.0, 3.0]), ((), 0.5)
    return xr.Dataset({
        "momentum": (*three, {"units": "kg m2 s-1"}),
        "omega": (*three, {"units": "rad s-1"}),
        "frequency": (*three, {"units": "rad s-1", "symbol": "nu"}),
        "orbit": (*one, {"long_name": "radius; of the orbit", "units": "m"}),
        "flips": (*one, {}),
    })  # fmt: skip


def test_labels(ds):
    assert axis_label(ds.momentum, 3) == "L₃ [kg m²/s]"
    assert axis_label(ds.omega, 3) == "ω₃ [rad/s]"
    assert axis_label(ds.omega) == "ω [rad/s]"
    assert axis_label(ds.frequency, 10) == "ν₁₀ [rad/s]"
    assert axis_label(ds.flips) == "flips"
    assert column_head(ds.frequency, 1) == "nu_1 [rad/s]"
    assert label_of(ds, " momentum[2]") == axis_label(ds.momentum, 2)
    assert label_of(ds, "flips") == "flips"
    assert long_label(ds.orbit) == "radius; of the orbit [m]"


@pytest.mark.parametrize(("name", "shown"), [
    ("start.omega.3", "ω₃(0)"),
    ("start_omega[3]", "ω₃(0)"),
    ("start.attitude.theta.mean", "mean of θ(0)"),
    ("start.momentum.azimuth", "azimuth of L(0)"),
    ("body.moments.1", "I₁"),
    ("body.tensor.1.2", "I₁₂"),
    ("body.hollow_cylinder.inner", "inner of hollow cylinder"),
    ("body.box.size.3", "size 3 of box"),
    ("effects.gravity.g", "g of gravity"),
    ("effects.rotor.momentum.2", "L₂ of rotor"),
    ("run.t_end", "end of the run"),
    ("growth_rate", "growth rate"),
    ("energy_drift_max", "largest energy drift"),
    ("p(omega_max[1] >= 0.05)", "p(largest ω₁ ≥ 0.05)"),
    ("correlation(start_omega[1], flip_first)", "correlation(ω₁(0), first flip)"),
])  # fmt: skip
def test_names_are_symbols_or_words_in_pictures(name, shown):
    assert in_symbols(name) == shown


def test_no_parameter_is_a_raw_name_in_pictures():
    """All names of shipped scenes: symbols or words without dots, all apart."""
    names = {
        name
        for scene in map(rm.Scene.load, shipped_names())
        for name in (*parameter_names(scene.model), *parameter_names_of_derivatives(scene.model))
    }
    found = {name: in_symbols(name) for name in names}
    assert len(found) > 80 and not [one for one in found.values() if re.search(r"[._]", one)]
    assert len(set(found.values())) == len(found)


def test_pictures_have_angles_in_degrees(ds):
    angle = ds.assign(theta=("axis", np.array([0.0, np.pi, 1.0]), {"units": "rad"}))
    shown = with_degrees(angle, "theta", "omega")
    assert axis_label(shown.theta) == "θ [deg]" and shown.theta.values[1] == 180.0
    assert shown.omega.equals(ds.omega) and in_degrees(2.0, "rad s-1") == (2.0, "rad s-1")


def test_values_and_counts(ds):
    assert value_text(0.25, ds.omega) == "0.25 rad/s" and value_text(3.0, ds.flips) == "3"
    assert value_text(2.0 / 3.0, ds.orbit, 2) == "0.67 m"
    assert count_text(1, "member") == "1 member" and count_text(0, "fault") == "0 faults"
    assert count_text(20_000, "member") == "20,000 members"
    assert count_text(2, "family") == "2 families"
    assert count_text(np.int64(1), "task is", "tasks are") == "1 task is"
    assert count_text(3, "task is", "tasks are") == "3 tasks are"


UNIT = re.compile(r"\[(1/)?(rad|s|m|J|kg|N|deg|W|T)\b[^\]]*\]")


def shown_texts():
    """(place, text) of the texts in the code of pictures, tables and maps, without docstrings."""
    root = Path(rm.__file__).parent
    for pattern in (
        "views/*.py", "studies/*/picture.py", "studies/*/table.py",
        "studies/stability_map/cases.py",
    ):  # fmt: skip
        for path in root.glob(pattern):
            tree = ast.parse(path.read_text("utf-8"))
            statements = (n.value for n in ast.walk(tree) if isinstance(n, ast.Expr))
            docstrings = {id(one) for one in statements if isinstance(one, ast.Constant)}
            for node in ast.walk(tree):
                is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
                if is_text and id(node) not in docstrings:
                    yield f"{path.relative_to(root)}:{node.lineno}", node.value


def test_no_picture_or_table_writes_a_unit_by_hand():
    """Else another way to write a unit would not reach it."""
    known = "expected phi, psi or an angle [rad] saved at all times"  # an error, no label
    texts = list(shown_texts())
    assert len(texts) > 1000 and UNIT.search("energy [J]") and UNIT.search("moment [kg m²]")
    assert [place for place, text in texts if UNIT.search(text) and known not in text] == []

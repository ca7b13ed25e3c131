"""Numbers with units: what pint, astropy and scipy.constants say, whatever the place and notation;
and what is refused."""

import re
import tomllib
from typing import NamedTuple

import numpy as np
import pytest
import tomli_w
from scipy import constants

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError
from rigidmc.inputs.measured import Measured, quantity_text
from rigidmc.inputs.units import KNOWN, converter, unit_of, units_text
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import effect, facts
from rigidmc.scene.parameters import parameter_names, unit_at
from rigidmc.scene.units import squared
from rigidmc.scene.varied import variables, with_values
from tests.tools.random_scenes import kinds, scene

BODY = "body.moments = [1.0, 2.0, 2.5]\n"
AT_REST = BODY + "start.omega = [0.0, 0.0, 0.0]\n"
DEGREE = np.pi / 180.0


def spin(text):
    return rm.Scene.loads(f"{BODY}start.omega = {text}").start.omega


FACTORS = {  # {texts of a unit: its number of SI units}
    "deg/s; °/s": constants.degree,
    "rpm": 2.0 * np.pi / 60.0,
    "rev/h": 2.0 * np.pi / constants.hour,
    "arcsec": constants.arcsec,
    "arcmin": constants.arcmin,
    "g mm2; g·mm²; g*mm**2": 1e-9,
    "lb in^2": constants.lb * constants.inch**2,
    "slug ft2": constants.slug * constants.foot**2,
    "oz": constants.oz,
    "lbf in": constants.lbf * constants.inch,
    "N m s; m/s/s; J/(kg m)": 1.0,
    "mN m/deg": 1e-3 / constants.degree,
    "ft/s2": constants.foot,
    "1/d": 1.0 / constants.day,
}
POWERS = {"km^3 s^-2": 9, "uT; µT": -6, "G": -4, "mA m2": -3, "g/cm3": 3, "%": -2}  # of ten
FACTORS |= {text: float(f"1e{power}") for text, power in POWERS.items()}


@pytest.mark.parametrize("texts", FACTORS)
def test_factors(texts):
    for text in texts.split("; "):
        # measured 2.2e-16
        assert unit_of(text).factor == pytest.approx(FACTORS[texts], rel=4e-16), text


def test_decimal_units_round_once():
    """A number in mm is the number in m that one would write, to the bit."""
    some = np.random.default_rng(1)
    millimetre, micronewton = unit_of("mm"), unit_of("uN m")
    for x in some.uniform(0.0, 100.0, 1000).round(4).tolist():
        assert millimetre.convert(x) == float(f"{x}e-3")
        assert micronewton.convert(x) == float(f"{x}e-6")
    assert 0.0051 != 5.1 * 1e-3  # a product rounds twice
    assert spin('{ value = [180.0, 90.0, 0.0], unit = "deg/s" }') == (np.pi, np.pi / 2.0, 0.0)


@pytest.mark.parametrize(
    ("text", "words", "right"),
    [
        ("Nm", "'Nm' is not a unit", "N m"),
        ("mNms", "'mNms'", "mN m s"),
        ("kgm2", "'kgm'", "kg m2"),
        ("degrees/s", "'degrees'", "deg/s"),
        ("RPM", "'RPM'", "rpm"),
        ("hours", "'hours'", "h"),
        ("N/kg m", "two ways", "N/(kg m)"),
        ("Hz", "rev/s", None),
        ("°C", "temperatures are not taken", None),
        ("K", "temperatures are not taken", None),
        ("parsecs per fortnight", "not a unit", None),
        ("m99", "product of powers", None),
        ("2 m", "product of powers", None),
        ("", "expected a unit", None),
        ("m " * 100, "expected a unit", None),
        (3, "expected a unit", None),
    ],
)
def test_texts_that_are_no_units(text, words, right):
    with pytest.raises(SceneError) as error:
        unit_of(text)
    assert words in error.value.rule and error.value.nearest in (right, error.value.nearest)
    if right is not None:
        assert error.value.nearest == right


PARTS = {"10 deg/s": "10|deg/s", "-.5e-3kg m2": "-.5e-3|kg m2", "1e3 m": "1e3|m"}
PARTS |= {"10 1/s": "10|1/s", "5 °": "5|°"}
PLAIN = "11/s", "1e999", "1e+3000 m", "9.81", "vertical", "1979-05-27", "1, 2", "inf m"


@pytest.mark.parametrize("text", [*PARTS, *PLAIN])
def test_text_of_a_number_with_a_unit(text):
    assert quantity_text(text) == (tuple(PARTS[text].split("|")) if text in PARTS else None)


def test_every_unit_of_an_effect_is_known():
    for kind in EFFECTS.values():
        for units in facts(kind).units.values():
            assert unit_of(units).factor == 1.0
            assert unit_of(units_text(units)).powers == unit_of(units).powers
            doubled = tuple(2 * power for power in unit_of(units).powers)
            assert unit_of(squared(units)).powers == doubled


def test_no_prefixed_unit_is_another_unit():
    assert len({(f, pi, p) for f, pi, p in KNOWN.values()}) >= len(KNOWN) - 1  # t is 1000 kg
    assert "min" in KNOWN and KNOWN["min"][0] == 60  # no milli-inch


# {SI units: other units}; the texts are those of a user, pint reads a translation
OTHERS = {
    "kg": ("g", "lb", "oz", "slug", "t"),
    "m": ("mm", "cm", "km", "in", "ft"),
    "rad": ("deg", "mrad", "arcmin", "rev"),
    "rad s-1": ("deg/s", "rpm", "rev/h", "mrad/ms"),
    "kg m2": ("g mm2", "kg cm2", "lb in2", "N m s2"),
    "kg m2 s-1": ("N m s", "g mm2/s", "mN m s", "lb in2/min"),
    "s-1": ("1/min", "1/h", "1/d"),
    "J": ("mJ", "N mm", "lbf ft", "kN m"),
    "N m": ("mN m", "uN m", "lbf in", "N cm"),
    "N m-1": ("N/mm", "mN/um", "lbf/in"),
    "m s-2": ("mm/s2", "ft/s2", "km/h2"),
    "m3 s-2": ("km3/s2", "ft3/min2"),
    "T": ("uT", "nT", "mT"),
    "A m2": ("mA m2", "A cm2", "N m/uT"),
    "1": ("%",),
}
OTHERS |= {
    squared(si): tuple(squared_text(other) for other in others)
    for si, others in {k: OTHERS[k] for k in ("rad s-1", "kg m2 s-1", "kg m2")}.items()
    for squared_text in [lambda text: "/".join(squared(part) for part in text.split("/"))]
}
IN_PINT = {"rev": "turn", "d": "day", "h": "hour", "min": "minute", "in": "inch", "t": "tonne"}
TABLES = {"body": {"moments": "kg m2", "mass": "kg", "centre": "m"},
          "start": {"omega": "rad s-1", "momentum": "kg m2 s-1", "attitude": "rad"}}  # fmt: skip


def translated(text):
    def word(found):
        return f"*{IN_PINT.get(found[1], found[1])}" + f"**{found[2]}" * bool(found[2])

    top, *below = text.split("/")
    unit = re.compile(r" ?([A-Za-z%]+)(-?\d)?")
    parts = [unit.sub(word, part).removeprefix("*") for part in (top, *below)]
    return "/".join(part if i == 0 else f"({part})" for i, part in enumerate(parts))


class Writer(NamedTuple):
    """Writes the numbers of a scene file in other units; its factors are those of pint."""

    registry: object
    some: np.random.Generator

    def other(self, si):
        """(a unit, its number of SI units)"""
        text = str(self.some.choice(OTHERS[si]))
        one = self.registry.Quantity(1.0, translated(text))
        return text, one.to(translated(si) if si != "1" else "").magnitude

    def write(self, value, si):
        unit, factor = self.other(si)
        if isinstance(value, list):
            plain = all(isinstance(x, float) for x in np.ravel(np.array(value, object)))
            if plain and self.some.random() < 0.5:
                return {"value": (np.array(value) / factor).tolist(), "unit": unit}
            return [self.write(x, si) for x in value]
        if isinstance(value, dict):
            return {**{k: scaled(v, k, factor) for k, v in value.items()}, "unit": unit}
        if self.some.random() < 0.5:
            return f"{value / factor!r} {unit}"
        return {"value": value / factor, "unit": unit}

    def vector(self, value, si):
        is_one = isinstance(value, dict) and len(value) == 1
        ((name, table),) = value.items() if is_one else ((0, 0),)
        fields = {
            "cone": {"size": si, "angle": "rad", "azimuth": "rad"},
            "sphere": {"size": si},
            "correlated": {"mean": si, "covariance": squared(si)},
            "shell": {"energy": "J"},
            "gibbs": {"kT": "J"},
            "second_moments": {"values": si},
            "fisher": {},
            "pointing": {},
        }
        if name not in fields:
            return self.write(value, si)
        known = fields[name]
        return {name: {k: self.write(v, known[k]) if k in known else v for k, v in table.items()}}


def scaled(value, key, factor):
    if key in ("normal", "uniform", "between"):
        return [x / factor for x in value]
    if key == "grid":
        return [value[0] / factor, value[1] / factor, value[2]]
    if isinstance(value, dict):  # of scipy
        return {k: x / factor if k in ("loc", "scale") else x for k, x in value.items()}
    return value


def numbers_of(value):
    if isinstance(value, dict):
        return [x for key in sorted(value) for x in (key, *numbers_of(value[key]))]
    if isinstance(value, list):
        return [x for one in value for x in numbers_of(one)]
    return [value]


def test_any_number_of_a_scene_in_any_unit():
    """30 generated scenes: all numbers of bodies, effects and starts in other units, by pint."""
    pint = pytest.importorskip("pint")
    writer = Writer(pint.UnitRegistry(), np.random.default_rng(48))
    written, units = 0, set()
    for i, kind in enumerate(kinds(60, seed=48)):
        text = scene(kind, i).dumps()
        if "stored" in text:  # rows of a result have no text
            continue
        data = tomllib.loads(text)
        for table, known in TABLES.items():
            for key, si in known.items():
                value = data[table].get(key)
                angles = isinstance(value, (list, dict)) and (key != "attitude" or len(value) == 3)
                if angles or (key != "attitude" and value is not None):
                    data[table][key] = writer.vector(value, si)
        for name, given in data["effects"].items():
            for table in given if isinstance(given, list) else [given]:
                for key, si in facts(EFFECTS[name]).units.items():
                    if key in table:
                        table[key] = writer.write(table[key], si)
        other = tomli_w.dumps(data)
        units |= set(re.findall(r'unit = "(.*?)"', other))
        again = rm.Scene.loads(other).dumps()
        assert '"unit"' not in again and "unit =" not in again
        one, two = (numbers_of(tomllib.loads(x)) for x in (text, again))
        # distributions of scipy state loc = 0 and scale = 1, too
        assert len(one) <= len(two)
        plain = [[x for x in xs if isinstance(x, float)] for xs in (one, two)]
        np.testing.assert_allclose(plain[1], plain[0], rtol=2e-15, atol=0.0)  # measured 4.4e-16
        written += 1
        if written == 30:
            break
    assert written == 30 and len(units) > 40


def test_distributions_scale_with_their_unit():
    assert spin('[{ normal = [10, 1], unit = "deg/s" }, 0, 0]')[0] == rm.normal(10 * DEGREE, DEGREE)
    u = np.linspace(0.01, 0.99, 50)
    for text in (
        "lognorm = { s = 0.5, scale = 10.0 }",
        "gamma = { a = 2.0, scale = 3.0, loc = 1.0 }",
        "loguniform = { a = 1.0, b = 100.0 }",
        "expon = {}",
        "normal = [1, 0.1], between = [0.9, 1.5]",
        "mixture = [{ weight = 9, normal = [0, 1] }, { weight = 1, uniform = [-5, 5] }]",
        "uniform = [-5, 5]",
        "common = [1, 0.1, 0, 0.2]",
    ):
        plain = spin(f"[{{ {text} }}, 0, 0]")[0]
        law = spin(f'[{{ {text}, unit = "rpm" }}, 0, 0]')[0]
        np.testing.assert_allclose(law.ppf(u), plain.ppf(u) * np.pi / 30.0, rtol=1e-12, atol=1e-15)
    grid = spin('[{ grid = [0, 360, 4], unit = "deg/s" }, 0, 0]')[0]
    middles = np.array([0.25, 0.75, 1.25, 1.75])
    np.testing.assert_allclose(grid.values(), np.pi * middles, rtol=1e-15)


def test_parameters_of_vector_distributions_have_units_of_their_own():
    angle = 'angle = { normal = [10, 1], unit = "deg" }'
    cone = spin(f'{{ cone = {{ axis = 3, size = "2 rpm", {angle} }} }}')
    assert cone == rm.Cone(3, converter("rpm", "rad s-1", "").convert(2.0),
                           rm.normal(10 * DEGREE, DEGREE))  # fmt: skip
    assert spin('{ sphere = 1.0, unit = "deg/s" }') == rm.Sphere(DEGREE)
    covariance = "[[4, 1, 0], [1, 4, 0], [0, 0, 4]]"
    law = f"correlated = {{ mean = [1, 2, 3], covariance = {covariance} }}"
    whole = spin(f'{{ {law}, unit = "deg/s" }}')
    np.testing.assert_allclose(whole.mean, np.array([1, 2, 3]) * DEGREE, rtol=1e-15)
    np.testing.assert_allclose(whole.covariance[0], np.array([4, 1, 0]) * DEGREE**2, rtol=1e-15)
    one = spin(
        '{ correlated = { mean = { value = [1, 2, 3], unit = "deg/s" },'
        f' covariance = {{ value = {covariance}, unit = "deg2/s2" }} }} }}'
    )
    assert one == whole
    with pytest.raises(SceneError, match="differ in dimension"):
        spin('{ cone = { axis = 3, size = 2.0, angle = 1.0 }, unit = "deg/s" }')
    six = f'{{ value = {(1e-4 * np.eye(6)).tolist()}, unit = "g2 mm4" }}'
    mean = f'{{ value = {np.diag([2.0, 2.5, 3.0]).tolist()}, unit = "g mm2" }}'
    text = "tensor = { uncertain_inertia = { mean = %s, covariance = %s } }"
    body = rm.Scene.loads(f"[start]\nomega = [0, 0, 1]\n[body]\n{text % (mean, six)}").body
    np.testing.assert_allclose(body.moments.covariance[0][0], 1e-22, rtol=1e-15)
    ten = six.replace("[0.0001, 0.0", "[0.0001, 0.0, 0.0, 0.0, 0.0")
    with pytest.raises(SceneError):
        rm.Scene.loads(f"[start]\nomega = [0, 0, 1]\n[body]\n{text % (mean, ten)}")


def test_columns_of_a_table_have_a_unit(tmp_path):
    (tmp_path / "spins.csv").write_text("a,b,c\n10,0,360\n20,90,0\n")
    texts = {
        '{ table = "spins.csv", columns = ["a", "b", "c"], unit = "deg/s" }': DEGREE,
        '[{ table = "spins.csv", column = "a", unit = "rpm" }, 0, 0]': np.pi / 30.0,
    }
    for text, factor in texts.items():
        (tmp_path / "a.toml").write_text(f"{BODY}start.omega = {text}")
        omega = rm.Scene.load(tmp_path / "a.toml").start.omega
        np.testing.assert_allclose(omega[0], np.array([10.0, 20.0]) * factor, rtol=1e-15)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("start.omega.1", "10deg/s"),
        ("start.omega.1", "10 deg/s"),
        ("start.omega.1", '{ value = 10, unit = "deg/s" }'),
        ("start.omega", "[10, 0, 0] deg/s"),
        ("start.omega", "[10.,0,0]deg/s"),
        ("start.omega", '{ value = [10, 0, 0], unit = "deg/s" }'),
    ],
)
def test_settings_have_units(key, text):
    spins = rm.Scene.load("dzhanibekov", settings=[("start.omega", "[0, 0, 0]"), (key, text)])
    assert spins.start.omega == (10 * DEGREE, 0.0, 0.0)


def test_bodies_and_shapes():
    text = """
    body.box = { mass = "12 g", size = { value = [10, 20, 30], unit = "mm" } }
    body.pivot = { value = [0, 0, -1.5], unit = "cm" }
    start = { omega = [0, 0, 1], attitude = { value = [0, 30, 0], unit = "deg" } }
    """
    one, true = rm.Scene.loads(text), rm.Body.box(0.012, (0.01, 0.02, 0.03))
    moments = true.with_pivot((0, 0, -0.015)).moments
    np.testing.assert_allclose(one.body.moments, moments, rtol=1e-15)
    assert one.start.attitude == (0.0, 30 * DEGREE, 0.0)
    at = "at = { value = [1, 0, 0], unit = 'mm' }"
    parts = f"[[body.shape]]\nsolid = 'ball'\nradius = '3 cm'\n{at}"
    (part,) = rm.Scene.loads(f"{AT_REST}{parts}").body.shape
    assert part.sizes == {"radius": 0.03} and part.at == (0.001, 0.0, 0.0)


def test_observables_and_run():
    text = """
    observables.passage = { axis = 3, angle = "30 deg", hold = "1h30m" }
    observables.flips = { within = { value = 60, unit = "deg" } }
    observables.histogram = { of = "omega[3]", low = "-10 rpm", high = "10 rpm" }
    run.t_end = { value = 2, unit = "h" }
    run.every = "90 s"
    run.turn = "5 deg"
    run.turn_rate = "1 rev/s"
    """
    found = rm.Scene.loads(AT_REST + text)
    found_of = {type(one).__name__: one for one in found.observables}
    histogram, flips, passage = (found_of[name] for name in ("Histogram", "Flips", "Passage"))
    assert passage.angle == 30 * DEGREE and passage.hold == 5400.0
    assert (flips.within, histogram.high) == pytest.approx((np.pi / 3.0, np.pi / 3.0), rel=4e-16)
    assert (found.run.t_end, found.run.every) == (7200.0, 90.0)
    assert (found.run.turn, found.run.turn_rate) == (5 * DEGREE, 2 * np.pi)


def test_quantities_of_pint_and_astropy():
    """Their own factors, in places for numbers, arrays, distributions, times and functions."""
    pint, astropy = pytest.importorskip("pint"), pytest.importorskip("astropy.units")
    registry = pint.UnitRegistry()

    def by_pint(value, unit):
        return registry.Quantity(value, translated(unit))

    def by_astropy(value, unit):
        return value * astropy.Unit(translated(unit).replace("turn", "cycle"))

    for of in (by_pint, by_astropy):
        rows = of(np.arange(12.0).reshape(4, 3), "deg/s")
        for omega in ((of(10.0, "deg/s"), of(1.0, "rev/s"), 0.0), [of(10.0, "deg/s"), 0.0, 0.0]):
            assert rm.Start(omega=omega).omega[0] == pytest.approx(10 * DEGREE, rel=1e-15)
        start = rm.Start(omega=rows, attitude=of([0.0, 30.0, 0.0], "deg"))
        np.testing.assert_allclose(start.omega[2], np.arange(2.0, 12.0, 3.0) * DEGREE, rtol=1e-15)
        np.testing.assert_allclose(start.attitude, (0.0, 30 * DEGREE, 0.0), rtol=1e-15)
        law = rm.normal(of(10.0, "deg/s"), of(1.0, "deg/s"))
        drawn = rm.Start(omega=(law, rm.uniform(0.0, of(1.0, "rev/s")), 0.0)).omega
        assert drawn[0].parameters == pytest.approx((10 * DEGREE, DEGREE), rel=1e-15)
        assert drawn[1].parameters == pytest.approx((0.0, 2 * np.pi), rel=1e-15)
        cone = rm.Start(omega=rm.Cone(3, of(60.0, "rpm") if of is by_pint else 2 * np.pi,
                                      of(10.0, "deg"))).omega  # fmt: skip
        assert (cone.size, cone.angle) == pytest.approx((2 * np.pi, 10 * DEGREE), rel=1e-15)
        body = rm.Body(of([1.0, 2.0, 2.5], "g mm2"), of(3.0, "g"), of([0.0, 0.0, 1.0], "mm"))
        assert body.moments == pytest.approx((1e-9, 2e-9, 2.5e-9), rel=4e-16)
        assert (body.mass, body.centre[2]) == pytest.approx((0.003, 0.001), rel=4e-16)
        box = rm.Body.box(mass=of(12.0, "g"), size=of([1.0, 2.0, 3.0], "cm"))
        assert box.moments == pytest.approx((1.3e-6, 1e-6, 0.5e-6), rel=1e-15)
        run = rm.Run(t_end=of(2.0, "h"), turn=of(5.0, "deg"))
        passage = rm.Passage(3, of(30.0, "deg"), hold=of(2.0, "min"))
        spun = rm.Start(omega=(0, 0, 1))
        turning = rm.Scene(box, rm.Gravity(of(981.0, "cm/s2")), spun, run, observables=(passage,))
        assert turning.effects[0].g == pytest.approx(9.81, rel=4e-16)
        assert turning.run.t_end == 7200.0 and turning.observables[0].hold == 120.0
        energy = rm.Body((1, 2, 3)).kinetic_energy(of([1.0, 0.0, 0.0], "deg/s"))
        assert energy == pytest.approx(0.5 * DEGREE**2, rel=1e-15)
        for wrong in (
            lambda of=of: rm.Start(omega=of([1.0, 2.0, 3.0], "mm")),
            lambda of=of: rm.Body((1, 2, 3)).kinetic_energy(of([1.0, 2.0, 3.0], "mm")),
            lambda of=of, box=box: rm.Scene(box, rm.Gravity(of(9.81, "m/s"))),
            lambda of=of: rm.Start(omega=(rm.normal(of(1.0, "mm"), of(1.0, "mm")), 0, 0)),
        ):
            with pytest.raises(SceneError) as error:
                wrong()
            assert ": is in " in str(error.value) and "\n" not in str(error.value)
        with pytest.raises(SceneError, match="Hz may mean"):
            rm.Start(omega=of([1.0, 2.0, 3.0], "Hz" if of is by_astropy else "hertz"))
        with pytest.raises(SceneError, match="give standard_deviation a unit, too"):
            rm.normal(of(1.0, "deg/s"), 1.0)
        with pytest.raises(SceneError, match="only Euler angles"):
            rm.Start(omega=(0, 0, 1), attitude=of([1.0, 0.0, 0.0, 0.0], "deg"))


def test_rows_of_euler_angles_with_a_unit():
    """Three rows with a unit are never a matrix, even the unit matrix in radians."""
    pint = pytest.importorskip("pint")
    quantity = pint.UnitRegistry().Quantity
    angles = np.arange(12.0).reshape(4, 3)
    found = rm.Start(omega=(0, 0, 1), attitude=quantity(angles, "deg")).attitude
    np.testing.assert_allclose(np.transpose(found), angles * DEGREE, rtol=1e-15)
    found = rm.Start(omega=(0, 0, 1), attitude=quantity(angles[:3], "deg")).attitude
    np.testing.assert_allclose(np.transpose(found), angles[:3] * DEGREE, rtol=1e-15)
    for wrong in (quantity(np.eye(3), "rad"), quantity(np.ones((4, 4)), "deg")):
        with pytest.raises(SceneError, match=r"matrix|only Euler"):
            rm.Start(omega=(0, 0, 1), attitude=wrong)


def test_text_in_python():
    law = rm.normal("10 deg/s", "1 deg/s").between(0.0, "12 deg/s")
    plain = rm.normal(10 * DEGREE, DEGREE).between(0.0, 12 * DEGREE)
    omega = rm.Start(omega=(law, "1 rpm", rm.grid("0 rpm", "60 rpm", 2))).omega
    assert omega[0].ppf(np.array([0.3])) == pytest.approx(plain.ppf(np.array([0.3])), rel=1e-14)
    assert omega[1] == pytest.approx(np.pi / 30.0, rel=1e-15)
    assert omega[2].high == pytest.approx(2 * np.pi, rel=1e-15)
    assert rm.Body.cylinder("12 g", radius="1 cm", height="3 cm").mass == 0.012
    whole = rm.mixture((1.0, rm.normal("0 rpm", "1 rpm")), (1.0, rm.uniform("0 rpm", "1 rpm")))
    found = rm.Start(omega=(whole, 0, 0)).omega[0].parameters[1][1].parameters
    assert found == pytest.approx((0.0, np.pi / 30.0), rel=4e-16)
    with pytest.raises(SceneError, match="one unit"):
        rm.mixture((1.0, rm.normal("0 rpm", "1 rpm")), (1.0, rm.uniform(0.0, 1.0)))
    with pytest.raises(SceneError, match="one dimension"):
        rm.normal("0 rpm", "1 mm")
    assert repr(Measured(3.0, "mm")) == "3.0 mm"


def test_custom_effects_state_their_units():
    class Wind(NamedTuple):
        size: float

        def torque(self):
            return self.size, 0.0, 0.0

    @effect(units={"size": "N m"})
    class Gust(NamedTuple):
        size: float

        def torque(self):
            return self.size, 0.0, 0.0

    body = rm.Body((1.0, 2.0, 2.5))
    with pytest.raises(SceneError, match="no known unit"):
        rm.Scene(body, Wind("3 mN m"))
    assert rm.Scene(body, Gust("3 mN m")).effects[0].size == 0.003


def test_values_of_varied_parameters():
    pint = pytest.importorskip("pint")
    start, registry = rm.Start(omega=(0.0, 0.1, 1.0)), pint.UnitRegistry()
    whole, nominal = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=start), {"start.omega": [0.0, 0.0, 1]}
    rates = {"start.omega": registry.Quantity(np.ones((2, 3)), "deg/s")}
    varied = {"start.omega": variables(whole.model)["start.omega"]}
    given, count = with_values(whole.model, varied, nominal, rates)
    assert count == 2 and given.start.omega[0] == pytest.approx(DEGREE, rel=1e-15)
    with pytest.raises(OptionError, match=r"start\.omega is in rad/s, .*does not convert"):
        lengths = {"start.omega": registry.Quantity(np.ones((2, 3)), "mm")}
        with_values(whole.model, varied, nominal, lengths)
    cone = rm.Scene(whole.body, start=rm.Start(momentum=rm.Cone(3, 1.0, 0.1)))
    found = {name: unit_at(cone.model, name) for name in parameter_names(cone.model)}
    assert found["start.momentum.angle"] == "rad" and found["start.momentum.size"] == "kg m2 s-1"


def test_bounds_have_the_unit_of_their_distribution():
    texts = (
        '{ normal = ["10 deg/s", "1 deg/s"], between = ["0 deg/s", "12 deg/s"] }',
        '{ normal = [10, 1], between = [0, 12], unit = "deg/s" }',
    )
    for text in texts:
        inner, low, high = spin(f"[{text}, 0, 0]")[0].parameters
        assert inner == rm.normal(10 * DEGREE, DEGREE)
        assert (low, high) == pytest.approx((0.0, 12 * DEGREE), rel=4e-16)


@pytest.mark.parametrize(("line", "cure"), [
    ("mass = 643.1 g", 'a number with its unit is a text, "643.1 g"'),
    ("centre = [0, 0, 6cm]", 'a number with its unit is a text, "6cm"'),
    ("mass = 0,6431", "decimals follow a point, 0.6431"),
])  # fmt: skip
def test_a_unit_without_quotes_gets_them(line, cure):
    """TOML itself says: expected newline or end of document after a statement."""
    with pytest.raises(SceneError, match="not valid TOML") as error:
        rm.Scene.loads(f'title = """\n\n"""  # 5 g\n[body]\n{line}\n')
    assert cure in str(error.value)
    with pytest.raises(SceneError, match="not valid TOML") as error:
        rm.Scene.loads('mass = "5 g"\n[body\n')
    assert ";" not in str(error.value)
    with pytest.raises(SceneError, match="did you mean 'g'"):
        rm.Body.solid("ball", mass="5 gr", radius=0.1)

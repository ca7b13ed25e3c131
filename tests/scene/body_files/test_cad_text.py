"""Mass properties as text: units, points and signs of products, which the numbers decide."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics import inertia
from rigidmc.scene.body_files import find_part
from rigidmc.scene.body_files.cad_units import INERTIA, LENGTH, MASS, find_unit

SIX = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def solidworks(masses, x, sign=1.0, blocks="PLI", words="", digits=6, unit="grams * square mm"):
    """The text of a body of particles in g and mm. sign: +1 for products +int x y dm."""
    mass = masses.sum()
    centre = masses @ x / mass
    own = inertia.of_particles(masses, x - centre)
    moments, axes = np.linalg.eigh(own)

    def number(value):
        return f"{value:.{digits}f}"

    def tensor(letter, whole):
        printed = np.where(np.eye(3, dtype=bool), whole, -sign * whole)
        rows = [
            "\t".join(f"{letter}{a}{b} = {number(printed[i, j])}" for j, b in enumerate("xyz"))
            for i, a in enumerate("xyz")
        ]
        return "\n".join(rows)

    text = [f"Mass = {number(mass)} grams", "Volume = 12.00 cubic millimeters", ""]
    text += ["Center of mass: ( millimeters )"]
    text += [f"\t{a} = {number(c)}" for a, c in zip("XYZ", centre, strict=True)]
    if "P" in blocks:
        text.append(f"Principal axes of inertia and principal moments of inertia: ( {unit} )")
        text.append("Taken at the center of mass.")
        for a, axis, moment in zip("xyz", axes.T, moments, strict=True):
            text.append(f"I{a} = ({', '.join(map(number, axis))})\tP{a} = {number(moment)}")
    about_centre = "at the center of mass and aligned with the output coordinate system"
    about_origin = inertia.of_particles(masses, x)
    for letter, point, whole in (
        ("L", about_centre, own),
        ("I", "at the output coordinate system", about_origin),
    ):
        if letter in blocks:
            text += [f"Moments of inertia: ( {unit} )", f"Taken {point}. {words}"]
            text.append(tensor(letter, whole))
    return "\n".join(text)


def particles(seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(1.0, 5.0, 6), rng.normal(size=(6, 3)) * 20.0 + [30.0, -10.0, 5.0]


def read(tmp_path, text, **options):
    (tmp_path / "part.txt").write_text(text)
    return rm.Body.read(tmp_path / "part.txt", **options)


def truth(masses, x):
    return rm.Body.from_particles(1e-3 * masses, 1e-3 * x)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("blocks", ["PLI", "PL", "LI", "PI"])
def test_the_numbers_decide_the_sign(tmp_path, sign, blocks):
    masses, x = particles()
    notation = r"\+int" if sign > 0.0 else "-int"
    with pytest.warns(rm.SceneWarning, match=f"read as {notation} x y dm, as its numbers show"):
        body = read(tmp_path, solidworks(masses, x, sign, blocks))
    exact = truth(masses, x)
    assert body.mass == pytest.approx(exact.mass, rel=1e-7)
    # six decimals of g and g mm2: measured 4.5e-13 of 2e-5
    assert np.abs(body.tensor - exact.tensor).max() < 4e-12
    wrong = read_without_warning(tmp_path, solidworks(masses, x, -sign, "L"), products(sign))
    assert np.abs(wrong.tensor - exact.tensor).max() > 1e-6  # of the opposite sign


def products(sign):
    return "positive" if sign > 0.0 else "negative"


def read_without_warning(tmp_path, text, notation):
    with pytest.warns(rm.SceneWarning, match="as asked"):
        return read(tmp_path, text, products=notation)


def test_the_words_decide_where_the_numbers_do_not(tmp_path):
    masses, x = particles(2)
    exact = truth(masses, x)
    for sign in (1.0, -1.0):
        words = f"(Using {products(sign)} tensor notation.)"
        with pytest.warns(rm.SceneWarning, match="as its words say"):
            body = read(tmp_path, solidworks(masses, x, sign, "L", words))
        assert np.abs(body.tensor - exact.tensor).max() < 4e-12
        with pytest.raises(rm.RigidmcError, match=r"its words say .* but its numbers fit"):
            read(tmp_path, solidworks(masses, x, -sign, "PL", words))
        with pytest.raises(rm.RigidmcError, match=r"products asks for .* but its numbers fit"):
            read(tmp_path, solidworks(masses, x, -sign, "PL"), products=products(sign))


def test_what_reads_two_ways_is_refused(tmp_path):
    masses, x = particles(3)
    with pytest.raises(rm.SceneError, match=r"\[body\] products: .* read two ways"):
        read(tmp_path, solidworks(masses, x, blocks="L"))
    text = solidworks(masses, x, blocks="L").replace("Taken at the center of mass", "Taken")
    text = text.replace("output coordinate system", "drawing")
    with pytest.raises(rm.SceneError, match=r"\[body\] about: .* about which point"):
        read(tmp_path, text, products="positive")
    with pytest.warns(rm.SceneWarning, match="as asked"):
        body = read(tmp_path, text, products="positive", about="centre")
    assert np.abs(body.tensor - truth(masses, x).tensor).max() < 4e-12
    with pytest.raises(rm.RigidmcError, match="contradict each other"):
        read(tmp_path, solidworks(masses, x, blocks="PL").replace("Px = ", "Px = 9"))


def test_without_products_there_is_no_question(tmp_path):
    x = np.array([[1, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0], [0, 0, 3], [0, 0, -3.0]])
    masses = np.ones(6)
    body = read(tmp_path, solidworks(masses, x, blocks="L"))
    assert np.abs(body.tensor - truth(masses, x).tensor).max() < 1e-16


def test_units_behind_the_numbers(tmp_path):
    text = """Mass: 2.5 kg
Center of mass
X: 10 mm
Y: -20 mm
Z: 5 mm
Moments of inertia about the center of mass
Lxx: 0.0200 kg m²  Lxy: 0 kg m²  Lxz: 0 kg m²
Lyy: 0.0300 kg m²  Lyz: 0 kg m²
Lzz: 0.0425 kg m²
"""
    body = read(tmp_path, text, pivot="centre")
    assert np.abs(body.tensor - np.diag([0.02, 0.03, 0.0425])).max() < 1e-16
    assert read(tmp_path, text).centre == (0.01, -0.02, 0.005)


POUND, INCH = 0.45359237, 0.0254
UNITS = {
    "( grams * square millimeters )": (INERTIA, 1e-9),
    "Moments: ( pounds * square inches ) Taken (Using tensor notation.)": (
        INERTIA,
        POUND * INCH**2,
    ),
    "kg m^2": (INERTIA, 1.0),
    "kg*mm2": (INERTIA, 1e-6),
    "lb in²": (INERTIA, POUND * INCH**2),
    "slugs * square feet": (INERTIA, 4.4482216152605 * 0.3048),  # lbf ft s2
    "grams": (MASS, 1e-3),
    " lb": (MASS, POUND),
    "( inches )": (LENGTH, INCH),
}


@pytest.mark.parametrize("text", UNITS)
def test_units(text):
    kind, factor = UNITS[text]
    assert find_unit(text, kind, "x", "f") == pytest.approx(factor, rel=1e-15)


LONG = "^" + " " * 2_000_000  # took the square of its length
NO_UNITS = {INERTIA: ("kg m", "kg", "kg m^2 s"), LENGTH: ("mm^2", "furlongs")}
NO_UNITS[MASS] = "", "stone", "grams per cubic mm", LONG


@pytest.mark.parametrize("kind", NO_UNITS)
def test_units_that_are_not(kind):
    for text in NO_UNITS[kind]:
        with pytest.raises(rm.FileError, match=f"expected a unit of {kind}"):
            find_unit(text, kind, "x", "f")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Mass =", "Masse =", "expected one line such as 'Mass = 1.5 kilograms', in English"),
        ("Volume = 12.00 cubic millimeters", "Mass = 3 grams", "not 2"),
        ("X = ", "X = 1,", "comma"),
        ("\tLyz = ", "\tLyz = 9", "not symmetric"),
        ("Lxx = ", "Lxx = -", "not positive"),
        ("\tZ = ", "Height Z = ", "expected X, Y and Z"),
        ("Lyx", "Lxy", "Lxy: is given twice"),
        ("Py =", "Px =", "Px: is given twice"),
        ("Iy =", "Ix =", "Ix: is given twice"),
        ("Mass = ", " " * 200_000 + "Mass = ", "larger than 0.125 MB"),
        ("( millimeters )", "", "expected a unit of length"),
    ],
)
def test_mistakes_are_named(tmp_path, old, new, words):
    text = solidworks(*particles(), blocks="PL").replace(old, new, 1)
    with pytest.raises(rm.RigidmcError) as caught:
        read(tmp_path, text)
    assert words in str(caught.value) and "part.txt" in str(caught.value)


def test_few_digits_are_told(tmp_path):
    masses, x = 1e-3 * particles()[0], 0.05 * particles()[1]
    text = solidworks(masses, x, blocks="PL", digits=2)
    (tmp_path / "part.txt").write_text(text)
    found = find_part(str(tmp_path / "part.txt"), None, None, None)
    assert "fewer than two significant digits" in found.notes[-1]


def test_rounded_texts_never_get_the_wrong_sign(tmp_path):
    """With few decimals, the numbers may fit both signs; they never fit the wrong one alone."""
    wrong = refused = 0
    for seed in range(40):
        masses, x = particles(seed)
        for digits in (1, 2, 4):
            (tmp_path / "p.txt").write_text(solidworks(masses, x, 1.0, "PL", digits=digits))
            try:
                found = find_part(str(tmp_path / "p.txt"), None, None, None)
            except rm.RigidmcError:
                refused += 1
                continue
            wrong += "-int" in found.notes[0]
    assert wrong == 0
    assert refused < 6  # of 120; measured 1, which fits both

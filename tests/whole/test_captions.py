"""Captions of the gallery: what a caption states as a fact is checked here, or by a test that the
table names. A caption that is new or changed, and every number in one, needs a line."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipk

import rigidmc as rm

ROOT = Path(__file__).parents[2]
PICTURE = re.compile(
    r"```\{picture\} (?P<title>[^\n]+)\n(?P<words>.*?)\n\n(?P<caption>.*?)```", re.DOTALL
)


def gallery():
    """{title: (command, caption)} of the gallery."""
    text = (ROOT / "docs" / "gallery.md").read_text("utf-8")
    return {
        one["title"]: (one["words"], " ".join(one["caption"].split()))
        for one in PICTURE.finditer(text)
    }


def body(name):
    return rm.Scene.load(name).body


def nutation(name, spin, lean):
    """The motion of a shipped top that is let go with a spin, leaning."""
    top = body(name)
    attitude = np.cos(lean / 2), np.sin(lean / 2), 0.0, 0.0
    weight = top.mass * 9.81 * top.centre[2]
    return rm.lagrange_motion(top.moments, weight, (0.0, 0.0, top.moments[2] * spin), attitude)


def handle():
    moments = np.array(body("dzhanibekov").moments)
    assert np.argsort(moments)[1] == 2  # spun about axis 3
    waits = rm.free_motion(moments, moments * [[0.01, 0.01, 6.28], [0.001, 0.001, 6.28]])
    assert 2.0 < waits.flip_interval[0] < waits.flip_interval[1] < 8.0  # s; measured 3.9 and 5.9


def racket():
    moments = np.array(body("tennis_racket").moments)
    start = rm.free_motion(moments, moments * [0.05, 6.0, 0.05])
    assert 0.0 < start.mc < 1e-2 and np.argsort(moments)[1] == 1  # at the separatrix, about axis 2


def book():
    i1, i2, i3 = body("book").moments
    share = 2.0 / np.pi * np.arctan(np.sqrt(i1 * (i2 - i1) / (i3 * (i3 - i2))))
    assert abs(share - 1 / 3) < 0.02 and i1 < i2 < i3  # 0.3425
    edges = body("book").shape[0].sizes["size"]
    assert edges[0] == max(edges) and edges[2] == min(edges)  # along the spine, through the pages


def cusps():
    assert nutation("heavy_top", 200.0, 0.4).kind == "cusps"


def gyroscope():
    nods = [nutation("gyroscope", spin, np.pi / 2) for spin in (300.0, 600.0)]
    swings = [np.degrees(float(one.low - one.high)) for one in nods]
    assert 2.5 < swings[0] < 3.5 and 0.5 < swings[1] < 1.5  # measured 3.23 and 0.81


def pendulum():
    assert ellipk(np.sin(1.5) ** 2) > 2.0 * ellipk(0.0)
    assert rm.Scene.load("pendulum").start.omega == (0.0, 0.0, 0.0)


def toutatis():
    moments = np.array(body("toutatis").moments)
    spin = [part.parameters[0] for part in rm.Scene.load("toutatis").start.omega]
    assert rm.free_motion(moments, moments * spin).kind == "about the smallest moment"
    assert np.argmin(moments) == 2


def chandler():
    words, _ = gallery()["The wobble of the Earth"]
    assert float(words.split("--t-end ")[1].split()[0]) == 20 * 365 * 86400.0
    angle = rm.Scene.load("chandler").start.omega.angle
    assert abs(np.degrees(angle) * 3600.0 - 0.2) < 0.01  # 0.206


def explorer():
    moments = body("damped_dzhanibekov").moments
    assert np.argmin(moments) == 2 and moments[1] > moments[0]


def cylinder():
    low, one, two = body("cylinder_on_edge").moments
    assert abs(one / two - 1.0) < 1e-12 and low < one
    axes = np.array(body("cylinder_on_edge").axes)  # columns, in the axes of the cylinder
    centre = axes.T @ np.array(body("cylinder_on_edge").centre)
    assert abs(centre[0]) > 0.1 and np.abs(centre[1:]).max() < 1e-12
    assert 0.1 < abs(axes[2, 0]) < 0.9  # the symmetry axis is not that of the solid


def wheel():
    i1, i2, i3 = body("gyrostat_wheel").moments
    assert i1 < i2 < i3 and round((i3 - i2) * 0.5, 4) == 0.0205
    low, high = rm.Scene.load("gyrostat_wheel").effects[0].momentum[1].parameters
    assert low < (i3 - i2) * 0.5 < high


def kapitza():
    assert round(rm.Scene.load("kapitza_top").effects[1].frequency / (2 * np.pi)) == 70


def sleeping():
    top = body("sleeping_top")
    weight = top.mass * 9.81 * top.centre[2]
    least = 2.0 * np.sqrt(top.moments[0] * weight) / top.moments[2]
    assert abs(least - 119.1) < 0.05  # 119.11


def four_periods():
    words, _ = gallery()["What parts the starts of a driven pendulum"]
    end = float(words.split("--t-end ")[1].split()[0])
    frequency = rm.Scene.load("driven_pendulum").effects[1].frequency
    assert abs(end * frequency / (2 * np.pi) - 4.0) < 1e-12


def rare():
    """A plain look: of 200,000 tops the event takes about two, so none to ten."""
    words, _ = gallery()["What almost never happens"]
    assert "p(nutation_max >= 0.75)" in words and "normal = [0.4, 0.05]" in words
    lean, spin = 0.75 - np.radians(3.0), 200.0  # it nods by less than 5.3 degrees
    assert (lean - 0.4) / 0.05 > 5.0 and spin  # beyond 5 sigma even so: at most 3e-7 by the lean
    low = nutation("heavy_top", 200.0, 0.4 + 4.26 * 0.05).low  # 1e-5 of the leans are beyond
    assert abs(low - 0.75) < 0.03


LIBRARY = "tests/scene/test_library_physics.py::"
MAPS = "tests/studies/test_maps.py::test_every_map"
# {title: (phrases that state facts, the check or the name of the test)}
FACTS = {
    "A T-handle flips again and again": (["about its middle axis", "every few seconds"], handle),
    "Polhodes of a tossed racket": (["begin at axis 2", "separatrix"], racket),
    "A book tossed in all directions": (
        ["Two thirds", "axis 3, through the pages", "one third axis 1, along the spine", "axis 2"],
        book,
    ),
    "A heavy top draws cusps": (["stands still at each cusp"], cusps),
    "The closed form of a heavy top": (
        ["by elliptic functions"],
        "tests/mechanics/test_lagrange_top.py::",
    ),
    "A toy gyroscope": (["nods by one to three degrees"], gyroscope),
    "A pendulum of all amplitudes": (["wide swings take longer"], pendulum),
    "Kovalevskaya's top": (["another quantity is constant"], LIBRARY + "kept"),
    "The closed form of a free body": (["check-case 2"], "tests/integrators/test_published.py::"),
    "Toutatis tumbles": (["asteroid 4179", "about its long axis"], toutatis),
    "The wobble of the Earth": (["Twenty years", "0.2″"], chandler),
    "Explorer 1 goes over to a flat spin": (["from axis 3, the long one"], explorer),
    "Hyperion": (["chaotic"], "tests/scene/test_satellites.py::"),
    "Phobos": (["both librate"], LIBRARY),
    "A dip needle": (["comes to rest along it"], LIBRARY),
    "A rod on its head": (["70 times a second"], kapitza),
    "A cylinder held at its edge": (["Two equal moments", "on the third axis"], cylinder),
    "A satellite with a momentum wheel": (["enough momentum", "middle axis"], wheel),
    "A satellite with two spins": (["an angle that theory tells"], LIBRARY),
    "A sleeping top wakes": (["Above 119 rad/s"], sleeping),
    "A rod in thermal equilibrium": (["law of Gibbs"], "tests/effects/test_bath.py::"),
    "The intermediate axis": (["about their middle axis"], MAPS),
    "The growth of a disturbance": (["lines are theory"], MAPS),
    "The wait for the first flip": (["divided by ten", "lines are theory"], MAPS),
    "Which end of the major axis": (["ends of axis 3", "about axis 1"], MAPS),
    "Where a top sleeps": (["border in theory"], MAPS),
    "Kapitza's pendulum": (["Mathieu's equation"], MAPS),
    "Chaos of a heavy top": (["nearly Kovalevskaya's"], MAPS),
    "How much chaos, from Lagrange's top to Kovalevskaya's": (
        ["Both sides are integrable"],
        "tests/studies/test_chaotic_tops.py::",
    ),
    "An adaptive map": ([], "tests/studies/test_adaptive_maps.py::"),
    "Hyperion at every pericentre: a sea of chaos with islands": (
        ["Figure 2", "(1984)"],
        "tests/studies/test_sections.py::",
    ),
    "Kovalevskaya's top has no chaos": (["closed curves"], "tests/studies/test_sections.py::"),
    "Islands of regular motion in a sea of chaos, by their frequencies": (
        ["another face"],
        "tests/studies/test_frequencies.py::",
    ),
    "The lean decides the nutation, the spin the precession": (
        ["95 %"],
        "tests/studies/test_sensitivity.py::",
    ),
    "What almost never happens": (["p = 1e-5"], rare),
    "Few members make short steps": ([], "tests/studies/test_multilevel.py::"),
    "A driven pendulum ends in one motion or the other": ([], "tests/studies/test_basins.py::"),
    "What parts the starts of a driven pendulum": (["four periods"], four_periods),
    "How far energy and momentum drift": ([], "tests/views/test_pictures.py::"),
    "What accuracy costs": ([], "tests/studies/test_accuracy.py::"),
}


def test_every_caption_has_a_line_and_every_number_is_in_it():
    found = gallery()
    assert set(found) == set(FACTS)
    for title, (_, caption) in found.items():
        phrases, _ = FACTS[title]
        left = re.sub(r"\]\([^)]*\)|\$[^$]*\$", "]", caption)  # links and formulas
        for phrase in phrases:
            assert phrase in left, (title, phrase, left)
            left = left.replace(phrase, "")
        left = re.sub(r"\baxis [123]\b", "", left)  # a name
        assert not re.search(r"\d", left), (title, left)


@pytest.mark.parametrize("title", FACTS)
def test_captions_state_facts(title):
    check = FACTS[title][1]
    if callable(check):
        check()
        return
    file, _, name = check.partition("::")
    text = (ROOT / file).read_text("utf-8")
    assert f"def {name}" in text

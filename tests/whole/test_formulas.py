"""Formulas on the pages: denominators have brackets, and values are those of the closed forms."""

import math
import re

import numpy as np
import pytest
from scipy.special import ellipk

import rigidmc as rm
from rigidmc.mechanics import inertia, rotation
from tests.whole.test_readme import PAGES, ROOT

BLOCK = re.compile(r"(?ms)^( *)```(.*?)\n(.*?)^\1```")
MATH = re.compile(r"\$\$(.+?)\$\$|\$([^$]+)\$", re.S)
SCRIPT = r"(?>[_^](?:\{[^{}]*\}|\\[A-Za-z]++|[A-Za-z0-9*])|')*"
# a derivative, the thermal energy, a function of an argument, a symbol or a number
ATOM = (
    r"(?>(?:\\partial|d)\s*\\?[A-Za-z]+|kT|\\text\{[^}]*\}|\\(?:ln|sum|sqrt)(?:\s*\{[^{}]*\}|\s*\w)?"
    rf"|(?:\\[A-Za-z]+|[A-Za-z]|\d+){SCRIPT})"
)
APART = "le|ge|ll|gg|ne|approx|to|propto|times|pm|mp|q?quad|text|end|rangle|right|langle"
PRODUCT = re.compile(rf"/\s*+{ATOM}\s*+(?:[A-Za-z0-9(]|\\(?!(?:{APART})\b)[A-Za-z])")


def formulas(text):
    """Yield the formulas of a page."""
    for _, language, content in BLOCK.findall(text):
        if language == "{math}":
            yield content
    for shown, inline in MATH.findall(re.sub(r"`[^`\n]*`", "", BLOCK.sub("", text))):
        yield shown or inline


def ambiguous(text):
    """Return the formulas in which a slash is followed by a product without brackets."""
    return [one for one in formulas(text) if PRODUCT.search(one)]


@pytest.mark.parametrize(("formula", "wrong"), [
    (r"I_3\omega_3/I_1\cos\theta", True), (r"I_3\omega_3/(I_1\cos\theta)", False),
    ("L^2/2I_3", True), (r"\sqrt{4 I_1 k}/2 I_1", True), (r"\pi\lambda/2K", True),
    (r"4K(m)/\lambda", False), (r"\partial L/\partial p", False), (r"dM/ds = M \times w", False),
    ("I_i = L_i/J_i", False), (r"\frac{a}{2 I_1}", False), ("k/I_1'", False), ("x/46", False),
    (r"(b^2/4I_1 - k)\,\theta^2", True), (r"e^{-(T + V)/kT}", False), ("a/b + c", False),
])  # fmt: skip
def test_what_is_ambiguous(formula, wrong):
    assert bool(ambiguous(f"${formula}$")) == wrong
    assert bool(ambiguous(f"```{{math}}\n:label: x\n{formula}\n```\n")) == wrong


@pytest.mark.parametrize("path", PAGES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_denominator_stands_alone_or_in_brackets(path):
    assert not ambiguous(path.read_text("utf-8"))


FUNCTIONS = {"sqrt": math.sqrt, "cos": math.cos, "sin": math.sin, "ln": math.log, "K": ellipk}
STEPS = (
    (r"\\(?:left|right|,|;|!|quad|tfrac|\\(?:\[\w+\])?)|&", lambda m: r"\frac" * ("frac" in m[0])),
    (r"\\frac\s*(\w|\\\w+)\s*(\w|\\[A-Za-z]+)", r"((\1)/(\2))"),
    (r"\\dot\s*\\", r"\\d"),
    (r"(\\?\w+?)_\\?(\w)", r" \1\2 "),
    (r"\\sqrt\s*(\d)", r"\\sqrt(\1)"),
    (r"\\(cos|sin|ln)\^2\s*(\\\w+)", r"(\1(\2))**2"),
    (r"\\(cos|sin|ln)\s*(\\\w+|\d+)", r" \1(\2)"),
    (r"\^", "**"),
    (r"\\lambda", " rate "),  # a word of Python
    (r"\\", " "),
)
BRACES = (
    (r"frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}", r"((\1)/(\2))"),
    (r"(sqrt|\*\*)\s*\{([^{}]*)\}", r"\1(\2)"),
)


def value(formula, names):
    """Evaluate the formula of a page."""
    for pattern, new in STEPS:
        formula = re.sub(pattern, new, formula)
    before = ""
    while formula != before:  # from the inner braces outwards
        before = formula
        for pattern, new in BRACES:
            formula = re.sub(pattern, new, formula)
    tokens, code = re.findall(r"[A-Za-z]\w*|\d+(?:\.\d+)?|\*\*|\S", formula), ""
    for before, token in zip(["(", *tokens], tokens, strict=False):
        is_product = re.match(r"[\w)]", before) and re.match(r"[\w(]", token)
        code += "*" * bool(is_product and before not in FUNCTIONS) + token
    return eval(code, dict(FUNCTIONS, **names))


I1, I3, K, SPIN, TILT = 2.0, 0.7, 1.3, 9.0, 0.6
MOMENTS = (I1, I1, I3)
SLOW, FAST = map(float, rm.steady_precession(MOMENTS, K, SPIN, TILT))
TOP = {"I1": I1, "I3": I3, "k": K, "omega3": SPIN, "theta": TILT, "dphi": SLOW, "pphi": 4.9,
       "ppsi": 6.3, "a": 4.9, "b": 6.3, "M": K, "g": 1.0, "l": 1.0, "dtheta": 0.0}  # fmt: skip
WELL = float(rm.effective_potential(MOMENTS, K, 4.9, 6.3, TILT))
BODY, MOMENTUM = (1.0, 1.7, 2.3), np.array([0.3, 0.8, 2.9])
FREE = {"I1": 1.0, "I2": 1.7, "I3": 2.3, "omega2": 0.8, "L": float(np.linalg.norm(MOMENTUM)),
        "T": float(0.5 * (MOMENTUM**2 / BODY).sum())}  # fmt: skip
MOTION = rm.analyse_free_top(BODY, MOMENTUM)
OF_PERIOD = {"rate": float(MOTION.rate), "m": float(MOTION.m)}
# I_1 = I_2: how far L turns about axis 3 in 0.1 s, and the body about L
ROUND = rm.solve_free_top((1.0, 1.0, 2.3), MOMENTUM, (1.0, 0.0, 0.0, 0.0), 0.1)
TURN = np.angle(complex(*ROUND.momentum[:2]) / complex(*MOMENTUM[:2])) / 0.1
CYLINDER = rm.Body.cylinder(2.0, 0.1, 0.3).moments
SIZE = {"M": 2.0, "a": 0.1, "h": 0.3}
HELD = rm.Body.cylinder(2.0, 0.1, 0.3).with_pivot((-0.1, 0.0, -0.15)).tensor / (2.0 / 12)
CHECKED = [  # page, formula, names, the same by rigidmc
    ("theory/heavy_top", r"\frac{2 \sqrt{I_1 k \cos\theta}}{I_3}", TOP,
     rm.least_spin(MOMENTS, K, TILT)),
    ("theory/heavy_top", r"\sqrt{4 I_1 k - (I_3\omega_3)^2}/(2 I_1)", {**TOP, "omega3": 1.2},
     rm.tilt_growth(MOMENTS, K, 1.2)),
    ("theory/heavy_top", r"I_1 \dot\phi^2 \cos\theta - I_3\omega_3 \dot\phi + k", TOP, 0.0),
    ("tutorials/heavy_top", r"I_1 \dot\phi^2 \cos\theta - I_3\omega_3 \dot\phi + M g l",
     {**TOP, "dphi": FAST}, 0.0),
    ("tutorials/heavy_top", r"\frac{(a - b \cos\theta)^2}{2 I_1 \sin^2\theta} + \frac{b^2}{2 I_3}"
     r" + M g l \cos\theta", TOP, WELL),
    ("theory/free_body", r"(1/I_1 - 1/I_3) L_3", {**FREE, "L3": 2.9}, TURN),
    ("theory/free_body", r"\sqrt{\frac{(I_3 - I_2)(L^2 - 2 T I_1)}{I_1 I_2 I_3}}", FREE,
     MOTION.rate),
    ("theory/free_body", r"\frac{(I_2 - I_1)(2 T I_3 - L^2)}{(I_3 - I_2)(L^2 - 2 T I_1)}", FREE,
     MOTION.m),
    ("theory/free_body", r"4K(m)/\lambda", OF_PERIOD, MOTION.period),
    ("theory/free_body", r"2K(m)/\lambda", OF_PERIOD, MOTION.flip_interval),
    ("theory/free_body", r"\omega_2 \sqrt{\frac{(I_2 - I_1)(I_3 - I_2)}{I_1 I_3}}", FREE,
     0.8 * inertia.growth_rate(BODY)),
    ("teaching/exercises", r"\omega_2 \sqrt{(I_2 - I_1)(I_3 - I_2)/(I_1 I_3)}", FREE,
     0.8 * inertia.growth_rate(BODY)),
    ("teaching/examples", r"\frac{M}{12}(3a^2 + h^2)", SIZE, CYLINDER[0]),
    ("teaching/examples", r"\frac{M}{2} a^2", SIZE, CYLINDER[2]),
    ("teaching/examples", r"15a^2 + 4h^2", SIZE, HELD[1, 1]),
]  # fmt: skip


@pytest.mark.parametrize(("page", "formula", "names", "true"), CHECKED)
def test_a_formula_has_the_value_of_the_closed_form(page, formula, names, true):
    text = (ROOT / "docs" / f"{page}.md").read_text("utf-8")
    assert " ".join(formula.split()) in " ".join(text.split())
    assert value(formula, names) == pytest.approx(float(true), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("share", [1e-6, 0.3, 1.0 - 1e-6])
def test_waves_lie_between_cusps_and_loops_outside(share):
    """docs/theory/heavy_top.md: 1,000 tops at shares of three ranges of the rate."""
    random = np.random.default_rng(1)
    i1, i3, k, theta = random.uniform((0.2, 0.1, 0.1, 0.05), (2.0, 0.4, 3.0, 3.0), (1000, 4)).T
    u, zero = np.cos(theta), 0.0 * theta
    p_psi = np.sqrt(2.0 * i1 * k * (1.0 + u)) * random.uniform(1.02, 10.0, 1000)
    ends = [-p_psi / (i1 * (1.0 - u)), zero, 2.0 * k / p_psi, p_psi / (i1 * (1.0 + u))]
    attitude = rotation.from_euler(np.stack([zero, theta, zero], -1))
    for n, kind in enumerate(("loops", "monotone precession", "loops")):
        rate = ends[n] + share * (ends[n + 1] - ends[n])
        momentum = np.stack([zero, i1 * rate * np.sin(theta), p_psi], -1)
        tops = rm.analyse_lagrange_top(np.stack([i1, i1, i3], -1), k, momentum, attitude)
        assert set(tops.kind) == {kind}

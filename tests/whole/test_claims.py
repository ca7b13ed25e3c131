"""Numbers in words: the rules by which `python -m bench.claims` finds those that nothing gives, and
that their list does not grow."""

import pytest

from bench.claims import claims, numbers, of_text


@pytest.mark.parametrize(("text", "found"), [
    ("The error is 3e-8 of its start.", ["3e-8"]),
    ("It takes 0.31 of the time, 1,234 members and -2.5 %.", ["0.31", "1,234", "-2.5"]),
    ("Axis 3, order 8, float64, section 11, 512-bit vectors, 21 May 2024, 3.11.2.", []),
    ("Half a turn is 180 degrees, with 95 % of 12 members, to 1e6, 9.81 m/s2.", []),
    ("`dt = 0.013` and the step 0.013 again, not 0.014.", ["0.014"]),
    ("$x = 0.37$ and ``0.38`` in [a link](0.39.md), {cite:p}`one0.4`.", []),
    ("```\nrun x --dt 0.017\n```\n\nSteps of 0.017 s, errors of 4e-5.", ["4e-5"]),
    ("# 0.77 in a heading\n\n| 0.5 rad | 0.71 |\n| --- | --- |\n", ["0.71"]),
    ("<!-- bench:x -->\n0.21\n<!-- /bench:x -->\n", []),
    ("of the scene `dzhanibekov`, 6.283185307179586 rad/s and 5.5 rad/s", ["5.5"]),
])  # fmt: skip
def test_what_counts_as_a_claim(text, found):
    assert [one.number for one in of_text("x", text)] == found


@pytest.mark.parametrize("given", [
    "`rigidmc rare heavy_top`", "`python -m bench rare`", "`tests/studies/test_rare.py`",
    "{cite:p}`wisdom1984`", "Wisdom et al.", "(1984)", "measured",
])  # fmt: skip
def test_what_gives_a_number(given):
    (one,) = of_text("x", f"It is 0.37, by {given}.")
    assert one.given
    (before,) = of_text("x", f"By {given}:\n\n| a | 0.37 |\n")
    assert before.given
    assert [bool(one.given) for one in of_text("x", f"It is 0.37.\n\nBy {given}.")] == [False]


def test_a_paragraph_that_leads_to_an_executed_cell():
    (one,) = of_text("x", "It stays within 0.37:\n\n```{code-cell} ipython3\nprint(1)\n```\n")
    assert one.given
    assert [word for _, word in numbers("0.37 and 0.38", {"0.38"})] == ["0.37"]


def test_the_list_does_not_grow():
    """At most as many as there were; who removes one may lower the number."""
    found = claims()
    left = [one for one in found if not one.given]
    pages = [one for one in left if one.file.endswith((".md", ".toml"))]
    assert len(found) > 400  # the rules still find claims
    assert len(pages) <= 15  # were 10
    assert len(left) <= 150  # were 163

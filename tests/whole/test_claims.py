"""Numbers in words: the rules by which `python -m bench.claims` finds those that nothing gives, and
that their list does not grow."""

import ast
import json
import re

import numpy as np
import pytest

import rigidmc as rm
from bench.tools.claims import ROOT, claims, constants, given_by, numbers, of_text, shows
from rigidmc.runs.directory import checkpoints, cluster
from rigidmc.runs.directory.shards import SHARD
from rigidmc.studies.section import points
from rigidmc.views.viewer import data


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
    "`rigidmc rare heavy_top`", "`python -m bench rare`", "`tests/whole/test_claims.py`",
    "{cite:p}`wisdom1984`", "Wisdom et al.", "(1984)", "`python -m timeit x`",
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
    assert [word for _, word in numbers("0.37 and 0.38", {0.38})] == ["0.37"]


def test_defaults_examples_and_constants_are_no_claims():
    assert [one.number for one in of_text("x", "By default 0.123, or 1e-12.")] == ["0.123"]
    assert [one.number for one in of_text("x", "E.g. 0.3, 0.41 or 0.7, and 0.8.")] == ["0.8"]
    code = constants(ast.parse("from rigidmc.views.viewer.data import MOST\nx = 1e-9"))
    assert not list(of_text("x", "Up to 4,000 frames, to 1e-9.", code=code))
    assert [one.number for one in of_text("x", "Up to 4,000 frames.")] == ["4,000"]


def test_a_source_is_no_claim_and_gives_no_measured_number():
    text = "It is 0.37 off. Source: Henon, Physica D 5 (1982) 412, TdC (3.35)."
    assert [(one.number, one.given) for one in of_text("x.py", text)] == [("0.37", "")]
    assert not list(of_text("x", "As in Physica D 17 (1985) 125, and TdC (3.35)-(3.37)."))


def test_a_test_gives_only_the_numbers_that_it_has():
    file = "tests/engine/kernel/test_layout.py"
    assert not shows(file, "0.123456") and shows("tests/whole/test_claims.py", "0.123456")
    for number, known in (("0.12", True), ("12", True), ("0.13", False), ("4,100", True)):
        assert shows("tests/whole/test_claims.py", number) == known or number == "0.13"  # 4,096
    assert not given_by("x", "It is 0.37, by `tests/whole/no.py`.", "0.37")


def test_constants_that_pages_and_docstrings_state():
    scene = rm.Scene.load("brownian_rotor")
    for name, words, number in (
        ("docs/viewer.md", "to\n4,000 frames of a member", data.MOST),
        ("rigidmc/views/viewer/page.py", "4,000\n        frames reach", data.MOST),
        ("docs/viewer.md", "16 x 16 pixels", data.SIDE),
        ("docs/how_to/long_runs.md", "every 20 s", checkpoints.EVERY),
        ("rigidmc/studies/section/study.py", "more than 0.2 rad", points.ARC),
        ("docs/tutorials/thermal_rotor.md", "0.1 ms", 1e3 / scene.effects[1].gamma),
    ):
        assert words in (ROOT / name).read_text("utf-8")
        assert float(re.search(r"[\d.,]+", words)[0].replace(",", "")) == pytest.approx(number)


def test_what_a_cluster_takes_is_what_the_bench_measured():
    """The table in rigidmc/runs/directory/cluster.py, from the rows of two benches."""
    rows = json.loads((ROOT / "bench" / "results" / "runs.json").read_text("utf-8"))["rows"]
    measured = {row["what"]: row["measured"] for row in rows if row["kind"] == "target"}
    seconds = np.median(
        [2.0 * row["without"] / row["members"] for row in rows if row["kind"] == "share"]
    )
    peak = next(row for row in rows if row["kind"] == "peak" and row["members"] == 2_000_000)
    many = json.loads((ROOT / "bench" / "results" / "workers.json").read_text("utf-8"))["rows"]
    task = next(1e-3 * row["scheduler"]["ms"] for row in many if row["kind"] == "many")
    members, each = 1e10, peak["bytes"] / peak["members"]
    whole, files = members * seconds, [members * each / size for size in (5e8, SHARD)]
    found = {
        "38,000 s of one": round(whole, -3),
        "1.22 TB": round(members * each / 1e12, 2),
        "2,400 files": round(files[0], -2),
        "16 s of one": round(whole / files[0]),
        "67 MB": round(SHARD / 1e6),
        "18,000 files": round(files[1], -3),
        "1.1 ms": round(1e3 * task, 1),
        "3 s for 2,400": round(task * files[0]),
        "20 s for 18,000": round(task * files[1]),
        "6 ms for 1,000": round(1e3 * measured["status of 1,008 shards"]),
        "rm.open 0.27 s": round(measured["rm.open of 1,008 shards"], 2),
    }
    for words, number in found.items():
        assert words in cluster.__doc__, words
        assert float(re.search(r"\d[\d.,]*", words)[0].replace(",", "")) == number, words


def test_nothing_is_left():
    """Every number has what gives it."""
    found = claims()
    assert len(found) > 350  # the rules still find claims: 385
    assert not [one for one in found if not one.given]

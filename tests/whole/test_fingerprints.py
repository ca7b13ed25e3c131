"""`bench.fingerprints` finds a changed bit, and masks what moves with the clock alone."""

import numpy as np
import pytest

import rigidmc as rm
from bench.tools import fingerprints, kinds, mistakes, texts


@pytest.fixture
def words(tmp_path, monkeypatch):
    """Options of a comparison of one scene."""
    monkeypatch.setattr(texts, "TERMINAL", {})
    one = {"scenes": lambda threads: kinds.scenes(threads, ("dzhanibekov",))}
    monkeypatch.setattr(kinds, "KINDS", one)
    return ["--file", str(tmp_path / "record.json"), "--threads", "1"]


def test_a_changed_bit_is_found(words, monkeypatch, capsys):
    assert fingerprints.main(["--record", *words]) == 0
    assert fingerprints.main(["--compare", *words]) == 0
    simulate = rm.simulate

    def other(*given, **named):
        ds = simulate(*given, **named)
        ds.omega.values[3, 1, 5] = np.nextafter(ds.omega.values[3, 1, 5], 9.0)
        ds.moments.attrs["units"] = "g m2"
        return ds

    monkeypatch.setattr(rm, "simulate", other)
    capsys.readouterr()
    assert fingerprints.main(["--compare", *words]) == 1
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("scenes: ")]
    assert told == ["scenes: dzhanibekov: moments: changed", "scenes: dzhanibekov: omega: changed"]


def test_a_kind_that_stops_is_told(words, monkeypatch, capsys):
    assert fingerprints.main(["--record", *words]) == 0
    monkeypatch.setattr(rm, "simulate", None)
    assert fingerprints.main(["--compare", *words]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "scenes: stopped"


def test_measured_numbers_are_masked_and_words_are_not():
    line = "cost         {} ns per {} on one thread (measured now); about {} s for the steps"
    assert texts.masked(line.format(3.1, "step", 20)) == texts.masked(line.format(12, "step", 1.5))
    assert texts.masked(line.format(3.1, "step", 20)) != texts.masked(line.format(3.1, "turn", 20))
    kept = "energy 1.2e-9, 40 members, dt = 0.01 s, 0.2 s apart, 4 s to t_end"
    assert texts.masked(kept) == kept


def test_a_call_without_an_error_is_no_mistake():
    assert mistakes.error_of(mistakes.CALLS["start: nothing"]).startswith("SceneError: [start] ")
    with pytest.raises(RuntimeError, match="no error, but float"):
        mistakes.error_of(lambda: 1.0)

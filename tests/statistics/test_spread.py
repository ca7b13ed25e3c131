"""Means and quantiles by blocks against numpy, for numbers in any order."""

import numpy as np
import pytest
import xarray as xr

from rigidmc.statistics import intervals, spread

QUANTILES = (0.05, 0.5, 0.95)
RANDOM = np.random.default_rng(2)
MANY = 20_000
CASES = {
    "normal": RANDOM.normal(size=MANY),
    "sorted": np.sort(RANDOM.normal(size=MANY)),
    "falling": np.arange(MANY)[::-1] * 1.0,
    "three integers": RANDOM.integers(0, 3, MANY),
    "constant": np.full(MANY, 0.1),
    "ties at a rank": np.where(np.arange(MANY) < MANY // 20, -1.0, 0.0),
    "heavy tails": RANDOM.standard_cauchy(MANY),
    "nan and inf": np.where(RANDOM.random(MANY) < 0.3, np.nan, RANDOM.normal(size=MANY)),
    "all nan": np.full(MANY, np.nan),
    "one": np.array([2.5]),
    "two": np.array([1.0, 2.0]),
}
CASES["nan and inf"][::1000] = np.inf


@pytest.fixture
def small(monkeypatch):
    """Blocks, samples and memory for few numbers, so that some cases need several passes."""
    settings = {"BLOCK": 300, "PIECE": 100, "SAMPLE": (16, 8), "KEPT": 512}
    for name, value in settings.items():
        monkeypatch.setattr(spread, name, value)


@pytest.mark.parametrize("name", CASES)
def test_spreads_are_those_of_numpy(name, small):
    values = CASES[name]
    for flags in (0.0, 0.02):
        status = (RANDOM.random(values.size) < flags).astype("i1")
        of = {"status": ("member", status), "x": (("axis", "member"), [status, values])}
        dataset = xr.Dataset(of)
        counts, (found,) = spread.spreads(dataset, [spread.Row("x", 1)], QUANTILES)
        good = values[status == 0]
        there = good[np.isfinite(good)].astype(float)
        assert counts["status"][:2].tolist() == [good.size, values.size - good.size]
        wanted = (good.size, np.isnan(good).sum(), there.size)
        assert (found.members, found.unknown, found.finite) == wanted
        if not there.size:
            assert np.isnan(found.mean) and np.isnan(found.quantiles).all()
            continue
        wanted = np.quantile(there, QUANTILES, method="averaged_inverted_cdf")
        assert found.quantiles == tuple(wanted)  # to the bit
        assert (found.first, found.low, found.high) == (there[0], there.min(), there.max())
        assert found.mean == pytest.approx(there.mean(), rel=1e-12, abs=1e-13 * abs(there).max())
        assert found.is_constant == bool(intervals.is_constant(there))
        if there.size > 1:
            assert found.variance == pytest.approx(there.var(ddof=1), rel=1e-9, abs=1e-28)


def test_memory_is_bounded(small, monkeypatch):
    """No bracket keeps more numbers than it may, even if its sample misleads it."""
    kept, calls = [], []
    take, passed = spread._Bracket.take, spread._passed

    def watched(self, found):
        take(self, found)
        kept.append(self._held)

    def once(*given):
        calls.append(given)
        if len(calls) > 1:
            raise RuntimeError("second pass")
        return passed(*given)

    monkeypatch.setattr(spread._Bracket, "take", watched)
    monkeypatch.setattr(spread, "_passed", once)
    monkeypatch.setattr(spread, "SURE", 1e9)  # brackets that exclude nothing
    values = {"status": ("member", np.zeros(MANY, "i1")), "x": ("member", CASES["normal"])}
    with pytest.raises(RuntimeError):
        spread.spreads(xr.Dataset(values), [spread.Row("x")], QUANTILES)
    assert max(kept) <= spread.KEPT and len(kept) >= MANY // 100

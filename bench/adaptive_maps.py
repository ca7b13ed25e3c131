"""Count how many pixels an adaptive map computes, and how many get another class than in the full
map: the table in docs/how_to/maps.md. `python -m bench.adaptive_maps [NAME RESOLUTION]`

Without arguments it computes both maps of 256 x 256 pixels; heavy_chaos at 1024 takes an hour.
"""

import sys

import numpy as np

from rigidmc.studies.stability_map.compute import prepared_case, run_map
from rigidmc.studies.stability_map.refine import CLASSES, EDGES, STRIDE

BORDERS = {"p": 0.5, "mean(megno)": 4.0}  # of measures; others have CLASSES equal intervals


def classes(name, whole, values):
    """Return the class of each value of a measure, as in an adaptive map."""
    border = BORDERS.get(name[0] if name.startswith("p(") else name)
    first = whole[::STRIDE, ::STRIDE]
    low, high = np.quantile(first[np.isfinite(first)], EDGES)
    edges = [border] if border is not None else np.linspace(low, high, CLASSES + 1)[1:-1]
    return np.where(np.isnan(values), -1, np.searchsorted(edges, values, side="right"))


def compared(name, resolution):
    """Return (fraction computed, fraction of another class) of a map of the package."""
    whole, part = (
        run_map(prepared_case(name, resolution, adaptive=adaptive)) for adaptive in (False, True)
    )
    first = next(str(v) for v in whole.data_vars if f"{v}_low" in whole)
    all_of, some = whole[first].values, part[first].values
    other = classes(first, all_of, all_of) != classes(first, all_of, some)
    return float(part.computed.mean()), float(other.mean())


def main():
    pairs = [("intermediate_axis", 256), ("damped_axis", 256)]
    if asked := sys.argv[1:]:
        pairs = [(asked[0], int(asked[1]))]
    for name, resolution in pairs:
        computed, other = compared(name, resolution)
        print(f"{name}, {resolution} x {resolution}: {computed:.1%} computed, {other:.3%} differ")


if __name__ == "__main__":
    main()

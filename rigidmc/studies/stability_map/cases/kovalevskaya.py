"""Kovalevskaya's top in the plane of `heavy_chaos`: integrable, so regular everywhere."""

from rigidmc.studies.stability_map.case import MapCase
from rigidmc.studies.stability_map.cases.heavy_chaos import heavy_chaos


def kovalevskaya() -> MapCase:
    """A = B = 2 C, with the centre of mass in the plane of A and B."""
    title = "Kovalevskaya's top, A = B = 2 C: regular everywhere"
    return heavy_chaos((2.0, 2.0, 1.0), (1.0, 0.0, 0.0))._replace(title=title)

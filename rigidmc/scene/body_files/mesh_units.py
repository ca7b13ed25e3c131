"""The unit of a mesh file, which most formats do not contain: metres, or millimetres as in CAD."""

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.mesh import six_volumes

LARGE = 10.0  # m: few bodies are larger, and few drawings in mm are smaller
MATTER = (5.0, 23_000.0)  # kg/m3: from foam and thin boxes to osmium


def guess_scale(triangles: Array, mass: float | None) -> tuple[float, str]:
    """Return metres per unit of a mesh, and a note if the unit is not metres or not certain.

    triangles (n, 3, 3) : in the unit of the file
    mass : of the solid within the triangles [kg]; None if it is not known
    """
    sizes = np.ptp(triangles.reshape(-1, 3), axis=0)
    fits = _by_density(triangles, mass)
    by_size = 1e-3 if sizes.max() > LARGE else 1.0
    scale = fits[0] if len(fits) == 1 else by_size
    if scale == 1.0:
        return 1.0, ""
    by_mm, by_m = (" x ".join(f"{by * size:.4g}" for size in sizes) for by in (1e-3, 1.0))
    return scale, (
        f"is read in millimetres, as a body of {by_mm} m, not of {by_m} m: give scale = 1 if its"
        " unit is m, or scale = 0.001 to confirm"
    )


def _by_density(triangles: Array, mass: float | None) -> list[float]:
    """Return the scales, 1 and 0.001, for which the mass makes a density of matter."""
    if not isinstance(mass, (int, float)) or not mass > 0.0:
        return []
    volume = abs(six_volumes(triangles).sum()) / 6.0
    if not volume > 0.0:
        return []
    return [by for by in (1.0, 1e-3) if MATTER[0] <= mass / (by**3 * volume) <= MATTER[1]]

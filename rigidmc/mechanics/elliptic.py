"""Elliptic functions and integrals of arrays, accurate also as the modulus goes to 1.

All take the parameter m = k^2, 0 <= m <= 1, or its complement mc = 1 - m. Near 1 the complement
counts: at m = 1 - 1e-14, m holds two digits of mc, and scipy.special.ellipj has errors of 2 and
more (scipy issue 8480, tests/mechanics/test_elliptic.py).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import elliprd, elliprf, elliprj

from rigidmc.arrays import floats
from rigidmc.engine.formulas import evaluate
from rigidmc.mechanics import jacobi as formulas

_Floats = NDArray[np.float64]


class Jacobi(NamedTuple):
    """sn, cn, dn and the amplitude am [rad], arrays of one shape."""

    sn: NDArray[np.float64]
    cn: NDArray[np.float64]
    dn: NDArray[np.float64]
    am: NDArray[np.float64]


def jacobi(u: ArrayLike, m: ArrayLike | None = None, mc: ArrayLike | None = None) -> Jacobi:
    """Jacobi's elliptic functions at any u, DLMF 22.2 and 22.16(i); u and m or mc broadcast.

    Errors are below 2e-15 for all 0 <= m <= 1 and |u| <= K(m); beyond, add those of u mod 4K, 4e-16
    |u|. nan if m is not in [0, 1] or u is not finite. mc below 1e-120 counts as 1e-120
    (tests/mechanics/test_elliptic.py).
    """
    m, mc = _complements(m, mc)
    u, m, mc = np.broadcast_arrays(floats(u, "u"), m, mc)
    values = evaluate(formulas.JacobiAt, 4, np.stack([u.ravel(), m.ravel(), mc.ravel()]))
    values[:, ~np.isfinite(u.ravel())] = np.nan
    return Jacobi(*values.reshape(4, *u.shape))


def complete_first(m: ArrayLike | None = None, mc: ArrayLike | None = None) -> _Floats:
    """K(m) = integral_0^(pi/2) dphi / sqrt(1 - m sin^2 phi), DLMF 19.2.8; inf at m = 1."""
    value: _Floats = elliprf(0.0, _complements(m, mc)[1], 1.0)
    return value


def first(phi: ArrayLike, m: ArrayLike | None = None, mc: ArrayLike | None = None) -> _Floats:
    """F(phi | m), DLMF 19.2.4, for any phi [rad]; broadcasts."""
    n, s, cc, dd, m, mc = _reduced(phi, m, mc)
    value: _Floats = s * elliprf(cc, dd, 1.0) + _multiple(n, elliprf(0.0, mc, 1.0))
    return value


def second(phi: ArrayLike, m: ArrayLike | None = None, mc: ArrayLike | None = None) -> _Floats:
    """E(phi | m) = integral sqrt(1 - m sin^2 phi), for any phi [rad]; broadcasts.

    DLMF 19.2.5 and 19.25.10.
    """
    n, s, cc, dd, m, mc = _reduced(phi, m, mc)
    with np.errstate(all="ignore"):  # E(1) = 1, where R_F and R_D are infinite
        part = mc * (s * elliprf(cc, dd, 1.0) + m / 3.0 * s**3 * elliprd(cc, 1.0, dd))
        part = part + m * s * np.sqrt(cc / dd)
        whole = mc * (elliprf(0.0, mc, 1.0) + m / 3.0 * elliprd(0.0, 1.0, mc))
    # E(1) = 1: pure
    return np.where(mc > 0.0, part, s) + _multiple(n, np.where(mc > 0.0, whole, 1.0))


def third(
    n: ArrayLike, phi: ArrayLike, m: ArrayLike | None = None, mc: ArrayLike | None = None
) -> _Floats:
    """Pi(n; phi | m) = integral dphi / ((1 - n sin^2 phi) sqrt(1 - m sin^2 phi)), n < 1, any phi.

    DLMF 19.2.7 and 19.25.14; broadcasts.
    """
    turns, s, cc, dd, m, mc = _reduced(phi, m, mc)
    n = floats(n, "n")
    weight = elliprj(cc, dd, 1.0, 1.0 - n * s * s)
    value: _Floats = s * elliprf(cc, dd, 1.0) + n / 3.0 * s**3 * weight
    whole = elliprf(0.0, mc, 1.0) + n / 3.0 * elliprj(0.0, mc, 1.0, 1.0 - n)
    return value + _multiple(turns, whole)


def _multiple(n: _Floats, value: _Floats) -> _Floats:
    """2 n value; 0 for n = 0 also if the value is infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(n == 0.0, 0.0, 2.0 * n * value)


def _complements(m: ArrayLike | None, mc: ArrayLike | None) -> tuple[_Floats, _Floats]:
    """(m, mc) from either, as arrays; nan outside [0, 1]."""
    if (m is None) == (mc is None):
        raise ValueError("give the parameter m or its complement mc = 1 - m, one of them")
    given: Any = floats(m if mc is None else mc, "m" if mc is None else "mc")
    given = np.where((given >= 0.0) & (given <= 1.0), given, np.nan)
    return (given, 1.0 - given) if mc is None else (1.0 - given, given)


def _reduced(
    phi: ArrayLike, m: ArrayLike | None, mc: ArrayLike | None
) -> tuple[_Floats, _Floats, _Floats, _Floats, _Floats, _Floats]:
    """(n, sin rest, cos^2 rest, 1 - m sin^2 rest, m, mc) of phi = n pi + rest."""
    m, mc = _complements(m, mc)
    phi = floats(phi, "phi")
    n = np.round(phi / np.pi)
    rest = phi - n * np.pi
    s, cc = np.sin(rest), np.cos(rest) ** 2
    return n, s, cc, cc + mc * s * s, m, mc

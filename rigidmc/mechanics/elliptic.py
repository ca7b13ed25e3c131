"""Elliptic functions and integrals of arrays that stay accurate as the modulus goes to 1, where 1 - m is what counts.

All take the parameter m = k^2, 0 <= m <= 1, or its complement mc = 1 - m: at m = 1 - 1e-14 half the digits of mc are lost in m, and
scipy.special.ellipj is wrong by 2 there (scipy issue 8480).
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import elliprd, elliprf, elliprj

from rigidmc.engine.formulas import evaluate
from rigidmc.mechanics import jacobi as formulas


class Jacobi(NamedTuple):
    """sn, cn, dn and the amplitude am [rad], arrays of one shape."""

    sn: np.ndarray
    cn: np.ndarray
    dn: np.ndarray
    am: np.ndarray


def jacobi(u, m=None, mc=None):
    """Jacobi's elliptic functions at any u, DLMF 22.2 and 22.16(i): Jacobi(sn, cn, dn, am); u and m or mc broadcast.

    Errors under 2e-15 for all 0 <= m <= 1 and |u| <= K(m); beyond, those of u mod 4K are added: 2e-16 |u|. nan where m is not in
    [0, 1] or u not finite. mc under 1e-120 is taken for it.
    """
    m, mc = _complements(m, mc)
    u, m, mc = np.broadcast_arrays(np.asarray(u, dtype=float), m, mc)
    values = evaluate(formulas.JacobiAt, 4, np.stack([u.ravel(), m.ravel(), mc.ravel()]))
    values[:, ~np.isfinite(u.ravel())] = np.nan
    return Jacobi(*values.reshape(4, *u.shape))


def complete_first(m=None, mc=None):
    """K(m) = integral_0^(pi/2) dphi / sqrt(1 - m sin^2 phi), DLMF 19.2.8; inf at m = 1."""
    return elliprf(0.0, _complements(m, mc)[1], 1.0)


def first(phi, m=None, mc=None):
    """F(phi | m), DLMF 19.2.4, for any phi [rad]; broadcasts."""
    n, s, cc, dd, m, mc = _reduced(phi, m, mc)
    return s * elliprf(cc, dd, 1.0) + _whole(n, elliprf(0.0, mc, 1.0))


def second(phi, m=None, mc=None):
    """E(phi | m) = integral sqrt(1 - m sin^2 phi), DLMF 19.2.5 and 19.25.10, for any phi [rad]; broadcasts."""
    n, s, cc, dd, m, mc = _reduced(phi, m, mc)
    with np.errstate(all="ignore"):  # E(1) = 1, where RF and RD are infinite
        part = mc * (
            s * elliprf(cc, dd, 1.0) + m / 3.0 * s**3 * elliprd(cc, 1.0, dd)
        ) + m * s * np.sqrt(cc / dd)
        whole = mc * (elliprf(0.0, mc, 1.0) + m / 3.0 * elliprd(0.0, 1.0, mc))
    return np.where(mc > 0.0, part, s) + _whole(n, np.where(mc > 0.0, whole, 1.0))


def third(n, phi, m=None, mc=None):
    """Pi(n; phi | m) = integral dphi / ((1 - n sin^2 phi) sqrt(1 - m sin^2 phi)), DLMF 19.2.7 and 19.25.14, n < 1, any phi; broadcasts."""
    turns, s, cc, dd, m, mc = _reduced(phi, m, mc)
    part = s * elliprf(cc, dd, 1.0) + n / 3.0 * s**3 * elliprj(cc, dd, 1.0, 1.0 - n * s * s)
    return part + _whole(
        turns,
        elliprf(0.0, mc, 1.0) + n / 3.0 * elliprj(0.0, mc, 1.0, 1.0 - np.asarray(n, dtype=float)),
    )


def _whole(n, value):
    """2 n value, and 0 for n = 0 where the value is infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(n == 0.0, 0.0, 2.0 * n * value)


def _complements(m, mc):
    """m and mc from either, as arrays; nan where they are not in [0, 1]."""
    if (m is None) == (mc is None):
        raise ValueError("give the parameter m or its complement mc = 1 - m, one of them")
    given: Any = np.asarray(m if mc is None else mc, dtype=float)
    given = np.where((given >= 0.0) & (given <= 1.0), given, np.nan)
    return (given, 1.0 - given) if mc is None else (1.0 - given, given)


def _reduced(phi, m, mc):
    """phi = n pi + rest: (n, sin rest, cos^2 rest, 1 - m sin^2 rest, m, mc)."""
    m, mc = _complements(m, mc)
    phi = np.asarray(phi, dtype=float)
    n = np.round(phi / np.pi)
    rest = phi - n * np.pi
    s, cc = np.sin(rest), np.cos(rest) ** 2
    return n, s, cc, cc + mc * s * s, m, mc

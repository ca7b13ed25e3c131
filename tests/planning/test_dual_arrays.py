"""Arrays with tangents, against derivatives in 40 digits (mpmath)."""

import mpmath as mp
import numpy as np
import pytest

from rigidmc.mechanics.axes_rates import axes_rates
from rigidmc.mechanics.inertia import principal_axes
from rigidmc.physics.dynamics import functions as own
from rigidmc.physics.dynamics.dual_arrays import (
    DualArray,
    TangentsLost,
    as_array,
    plain_numbers,
    with_values,
    zeros,
)
from rigidmc.physics.dynamics.vectors import nearest_integer

X = np.array([0.31, 0.77, -0.52])
MP = {
    "sqrt": (np.sqrt, mp.sqrt), "sin": (np.sin, mp.sin), "cos": (np.cos, mp.cos),
    "tan": (np.tan, mp.tan), "arcsin": (np.arcsin, mp.asin), "arccos": (np.arccos, mp.acos),
    "arctan": (np.arctan, mp.atan), "exp": (np.exp, mp.exp), "expm1": (np.expm1, mp.expm1),
    "log": (np.log, mp.log), "log1p": (np.log1p, mp.log1p), "square": (np.square, lambda x: x * x),
    "absolute": (np.absolute, abs),
    "own sine": (own.sine, mp.sin), "own cosine": (own.cosine, mp.cos),
    "own tangent": (own.tangent, mp.tan), "own arctangent": (own.arctangent, mp.atan),
    "own exponential": (own.exponential_of, mp.exp), "own expm1": (own.expm1, mp.expm1),
    "own arcsine": (own.arcsine, mp.asin), "own arccosine": (own.arccosine, mp.acos),
    "own tanh": (own.hyperbolic_tangent, mp.tanh), "own sinh": (own.hyperbolic_sine, mp.sinh),
    "own cosh": (own.hyperbolic_cosine, mp.cosh),
    "own cube": (lambda x: own.whole_power(x, 3), lambda x: x**3),
}  # fmt: skip
TWO = {
    "divide": (np.divide, lambda a, b: a / b), "power": (np.power, lambda a, b: a**b),
    "arctan2": (np.arctan2, mp.atan2), "hypot": (np.hypot, mp.hypot),
    "own arctan2": (own.arctan2, mp.atan2), "own hypotenuse": (own.hypotenuse, mp.hypot),
    "minimum": (np.minimum, min), "maximum": (np.maximum, max),
}  # fmt: skip
POSITIVE = ("sqrt", "log", "power")


def one(x):
    """x with two parameters: itself, and twice itself."""
    return DualArray(x, np.stack([np.ones_like(x), np.full_like(x, 2.0)]))


@pytest.mark.parametrize("name", MP)
def test_functions_of_one_number(name):
    function, true = MP[name]
    x = np.abs(X) if name in POSITIVE else X
    y = function(one(x))
    assert np.array_equal(y.value, function(x))  # every bit
    with mp.workdps(40):
        known = np.array([float(mp.diff(true, mp.mpf(v))) for v in x.tolist()])
    # measured 4e-16 with functions of NumPy, 3e-15 with polynomials
    assert np.abs(y.tangents[0] / known - 1.0).max() < 6e-15
    assert np.allclose(y.tangents[1], 2.0 * y.tangents[0], rtol=1e-15, atol=0.0)


@pytest.mark.parametrize("name", TWO)
def test_functions_of_two_numbers(name):
    function, true = TWO[name]
    a, b = (np.abs(X) if name in POSITIVE else X), np.array([1.4, -0.6, 0.9])
    y = function(DualArray(a, [np.ones(3), np.zeros(3)]), DualArray(b, [np.zeros(3), np.ones(3)]))
    assert np.array_equal(y.value, a**b if name == "power" else function(a, b))
    for i, order in enumerate(((1, 0), (0, 1))):
        with mp.workdps(40):
            pairs = zip(a.tolist(), b.tolist(), strict=True)
            known = [float(mp.diff(true, (mp.mpf(u), mp.mpf(v)), order)) for u, v in pairs]
        # measured 2e-15
        assert np.abs(y.tangents[i] - known).max() < 6e-15, order


def test_large_angles_are_reduced_without_tangents():
    x = one(np.array([1e3, -54.0, 3.0, 1.5707963267948966]))
    s, c = own.sincos(x)
    assert not isinstance(nearest_integer(x), DualArray)
    # measured 2e-16
    assert max(np.abs(s.tangents[0] - c.value).max(), np.abs(c.tangents[0] + s.value).max()) < 2e-15


def test_places_without_a_derivative():
    x, y = DualArray(0.0, [1.0, 0.0]), DualArray(0.0, [0.0, 1.0])
    for size in (np.sqrt(x * x + y * y), np.hypot(x, y), own.hypotenuse(x, y), abs(x)):
        assert size.tangents.tolist() == [0.0, 0.0]
    assert np.arctan2(x, y).tangents.tolist() == own.arctan2(x, y).tangents.tolist() == [0.0, 0.0]
    with np.errstate(invalid="ignore"):  # the value warns as without tangents, the tangents never
        assert (x / 0.0).tangents.tolist() == [np.inf, 0.0]
    assert np.where(np.array([True, False]), x, 1.0).tangents.tolist() == [[1.0, 0.0], [0.0, 0.0]]


def test_nothing_loses_tangents():
    x = one(X)
    plain = np.zeros(3)
    for lose in (
        lambda: np.asarray(x), lambda: float(x[0]), lambda: bool(x[0]), lambda: np.cbrt(x),
        lambda: np.median(x), lambda: np.interp(x, [0, 1], [0, 1]), lambda: np.add.reduce(x),
        lambda: plain.__setitem__(slice(None), x),
        lambda: np.add(x, 1.0, out=plain), lambda: own.logarithm_of(x[0]), lambda: np.array([x, x]),
    ):  # fmt: skip
        with pytest.raises(TangentsLost):
            lose()
    with pytest.raises(ValueError, match="sequence") as caught:
        plain[0] = x[0]
    assert isinstance(caught.value.__cause__, TangentsLost)
    with pytest.raises(TangentsLost, match="cbrt"):
        np.cbrt(x)
    with pytest.raises(TypeError):
        hash(x)


def test_arrays_keep_tangents_in_their_places():
    a = DualArray(np.arange(6.0).reshape(2, 3), np.arange(24.0).reshape(4, 2, 3))
    assert a.T.tangents.shape == (4, 3, 2) and a.T[2, 1].tangents.tolist() == [5, 11, 17, 23]
    assert np.stack([a, 1.0 + 0.0 * a.value], -1).tangents.shape == (4, 2, 3, 2)
    assert np.concatenate([a, np.ones((1, 3))]).tangents[:, 2].tolist() == [[0.0] * 3] * 4
    assert a.sum(0).tangents.tolist() == a.tangents.sum(1).tolist()
    assert a.sum(-2).tangents.tolist() == a.tangents.sum(1).tolist()
    assert a.ravel().tangents.tolist() == a.tangents.reshape(4, 6).tolist()
    assert np.sum(a).tangents.tolist() == a.tangents.sum((1, 2)).tolist()
    assert (a + np.ones((5, 2, 1))).tangents.shape == (4, 5, 2, 3)
    assert a[None, ..., 1].shape == (1, 2) and a[a > 3.0].tangents.shape == (4, 2)
    first, second = np.broadcast_arrays(a[:, :1], 2.0 * a)
    assert first.tangents.shape == second.tangents.shape == (4, 2, 3)
    assert np.clip(a, 1.0, 4.0).tangents[0].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 0.0]]
    assert np.diag(a[0]).tangents[1].tolist() == np.diag(a.tangents[1, 0]).tolist()
    block = zeros((3, 2), 4)
    block[1:3] = a[:, :2]
    block[0, np.array([False, True])] = a[1, 2]
    block[2] = 7.0
    assert block.tangents[3].tolist() == [[0.0, 23.0], [18.0, 19.0], [0.0, 0.0]]
    for row in block[:2]:
        row[:] = 5.0
    assert not block.tangents.any() and block.value[:2].tolist() == [[5.0, 5.0]] * 2
    nested = as_array(((a[0, 0], 1.0), (2.0, 3.0)))
    assert nested.tangents[:, 0, 0].tolist() == [0, 6, 12, 18]
    assert nested.value[1].tolist() == [2, 3]
    assert type(as_array((1.0, 2))) is np.ndarray
    moved = with_values([a[0, 1], 2.0], plain_numbers([a[0, 2], 3.0]))
    assert (float(moved[0].value), moved[1]) == (2.0, 3.0) and moved[0].tangents[0] == 1.0


@pytest.mark.parametrize(("gap", "error"), [(0.5, 3e-15), (1e-3, 4e-13), (1e-6, 4e-10)])
def test_rates_of_principal_axes_in_40_digits(gap, error):
    """Moments 2, 2 + gap, 3; the error of the axes grows as 1/gap."""
    turn = np.linalg.qr(np.array([[2.0, 0.3, -0.4], [0.5, 3.0, 0.2], [0.1, -0.3, 2.5]]))[0]
    tensor = (turn * np.array([2.0, 2.0 + gap, 3.0])) @ turn.T
    tensor = 0.5 * (tensor + tensor.T)
    change = np.array([[0.3, 0.2, -0.5], [0.2, 0.1, 0.4], [-0.5, 0.4, -0.2]])
    moments, axes = principal_axes(tensor)
    moving, turning = axes_rates(moments, axes, change)
    with mp.workdps(40):
        exact, by = mp.matrix(tensor.tolist()), mp.matrix(change.tolist())

        def at(t):
            values, vectors = mp.eigsy(exact + t * by)
            for j in range(3):
                along = sum(vectors[i, j] * float(axes[i, j]) for i in range(3))
                for i in range(3):
                    vectors[i, j] *= mp.sign(along)
            return [*values, *(vectors[i, j] for i in range(3) for j in range(3))]

        h = mp.mpf(10) ** -13
        true = [float((x - y) / (2 * h)) for x, y in zip(at(h), at(-h), strict=True)]
    assert np.abs(moving - true[:3]).max() < 1e-14 / gap**0.5  # measured 1e-15, 3e-14, 4e-13
    # measured: 1e-15, 1e-13, 1e-10 of the largest
    assert np.abs(turning.ravel() - true[3:]).max() / np.abs(true[3:]).max() < error

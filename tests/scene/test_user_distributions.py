"""Laws of a user's own: tried before anything is drawn from them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.protocols import VectorDistribution, sample

BODY = rm.Body.from_moments((1.0, 1.4, 2.0))


@dataclass(frozen=True)
class OnLine(VectorDistribution):
    """A vector along axis 1."""

    size: Any
    variables = ("omega", "momentum")

    def sample(self, source, name, first, count, facts):
        (x,) = sample((self.size,), source, name, first, count)
        return np.stack([x, 0.0 * x, 0.0 * x])


def other(**changed):
    """OnLine with other facts or methods."""
    return dataclass(frozen=True)(type("Own", (OnLine,), {"__annotations__": {}, **changed}))


def sampling(sample):
    return other(sample=lambda self, source, name, first, count, facts: sample(first, count))


@pytest.mark.parametrize(("kind", "words"), [
    (other(variables=("speed",)), "Own.variables: is .'speed',., expected a tuple of some"),
    (other(variables=("attitude",)), "Own.variables: is a distribution of attitude, not of omega"),
    (sampling(lambda first, count: np.ones((2, count))), r"Own.sample: returns shape \(2, 5\)"),
    (sampling(lambda first, count: [1.0, 2.0, 3.0]), "Own.sample: returns list, expected an array"),
    (sampling(lambda first, count: np.ones((3, count), int)), "not finite floats"),
    (sampling(lambda first, count: np.full((3, count), np.nan)), "not finite floats"),
    (sampling(lambda first, count: np.random.default_rng().random((3, count))),
     "Own.sample: returns other numbers for a member if other members are"),
    (sampling(lambda first, count: np.random.default_rng(1).random((3, count))),
     "Own.sample: returns other numbers for a member if other members are"),
    (sampling(lambda first, count: nothing), "Own.sample: raises NameError"),  # noqa: F821
    (other(check=lambda self, where: None), "Own.check: returns NoneType, expected Own"),
    (type("Own", (OnLine,), {"__annotations__": {"more": Any}}), "expected a frozen dataclass"),
])  # fmt: skip
def test_laws_that_could_not_be_drawn_from_are_refused(kind, words):
    with pytest.raises(rm.SceneError, match=words):
        rm.Start(omega=kind(1.0))


def test_parameters_are_checked_and_members_do_not_depend_on_others():
    with pytest.raises(rm.SceneError, match=r"\[start.omega.on_line\] size"):
        rm.Start(omega=OnLine("fast"))
    start = rm.Start(omega=OnLine(rm.normal(2.0, 0.5)))
    _, drawn = start.sample_spin(7, 0, 4000, None)
    assert abs(drawn[0].mean() - 2.0) < 0.03  # measured 0.016, two standard errors
    assert abs(drawn[0].std() - 0.5) < 0.02  # measured 0.0008
    assert np.array_equal(start.sample_spin(7, 1000, 10, None)[1], drawn[:, 1000:1010])
    scene = rm.prepare(rm.Scene(BODY, start=start)).scene
    assert "on_line" in scene.dumps() and __file__ in scene.dumps()

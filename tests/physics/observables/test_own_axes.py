"""Custom observables of a body described in axes other than its principal axes."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.mechanics.inertia import quaternions
from rigidmc.physics.dynamics.body_axes import with_axes
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.observables.compiled import observed
from rigidmc.protocols import described, described_attitude, observable, vertical
from rigidmc.views.descriptions import body_lines, describe_body

TENSOR = [[1.36, -0.48, 0.1], [-0.48, 1.64, 0.05], [0.1, 0.05, 2.5]]


@observable(units="1", long_name="vertical", dims=("axis",))
class Up(NamedTuple):
    def value(self, q):
        return vertical(q)


@observable(units="1", long_name="height of axis 3", dims=())
class Height(NamedTuple):
    def value(self, body, q):
        return (described(body, vertical(q))[2],)


@observable(units="1", long_name="scalar part of the attitude", dims=())
class Scalar(NamedTuple):
    def value(self, body, q):
        return (described_attitude(body, q)[0],)


def test_own_observables_are_of_the_axes_in_which_the_body_is_described():
    """Uncompiled: the kernel runs the same functions."""
    body = rm.Body.from_tensor(TENSOR)
    moments, _, centre, turn = body.sample_turned(0, 0, 1)
    own = MassProperties.of(tuple(moments[:, 0]), tuple(centre[:, 0]))
    axes = with_axes(own, tuple(quaternions(turn)[k][0] for k in range(4)))
    for attitude in Rotation.random(20, rng=1):
        q = tuple((attitude * Rotation.from_matrix(turn[..., 0])).as_quat(scalar_first=True))
        given = ((), 0.0, q, (1.0, 2.0, 3.0), (0.0,) * 4, ())
        up, whole = attitude.as_matrix()[2], attitude.as_quat(scalar_first=True)
        assert np.abs(np.array(observed(Up(), axes, *given)) - up).max() < 5e-15  # measured 4.5e-16
        assert abs(observed(Height(), axes, *given)[0] - up[2]) < 5e-15  # measured 4.5e-16
        assert abs(abs(observed(Scalar(), axes, *given)[0]) - abs(whole[0])) < 5e-15  # 2.3e-16
        assert np.abs(np.array(observed(Up(), own, *given)) - up).max() > 1e-3  # measured 0.07


def test_descriptions_name_the_axes():
    body = rm.Body.from_tensor(TENSOR)
    assert "in the described axes; steps are in the principal axes" in body_lines(body)[-1]
    assert any("stable about principal axes" in line for line in describe_body(body, ""))
    former = body_lines(rm.Body.from_tensor(TENSOR, axes="principal"))[-1]
    assert former == "axes         start, effects and results are in the principal axes"
    plain = rm.Body.from_moments((1.0, 1.5, 2.0))
    assert len(body_lines(plain)) == 1
    assert any("stable about axes" in line for line in describe_body(plain, ""))

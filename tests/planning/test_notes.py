"""Notes on scenes whose effects do not go together."""

import numpy as np
import pytest

import rigidmc as rm


def test_inner_friction_beside_a_rotor_is_noted():
    """The friction keeps |I omega|, not the |I omega + H| that no internal torque can change."""
    wheel, friction = rm.Rotor((0.0, 0.0, 1.0)), rm.EnergyDissipation(0.02)
    body = rm.Body.from_moments((13.6, 19.2, 23.1))
    start = rm.Start(omega=(0.2, 0.0, 0.05))
    drifts = []
    for effects in ((wheel,), (wheel, friction)):
        scene = rm.Scene(body, effects, start)
        run = {"dt": 0.5, "t_end": 600.0, "save": ("momentum",)}
        if len(effects) == 2:
            with pytest.warns(rm.SceneWarning, match=r"\|I omega \+ H\| is what stays"):
                ds = rm.simulate(scene, **run)
        else:
            ds = rm.simulate(scene, **run)
        whole = ds.momentum.values[..., 0] + np.array([0.0, 0.0, 1.0])
        size = np.linalg.norm(whole, axis=1)
        drifts.append(np.abs(size / size[0] - 1.0).max())
    assert drifts[0] < 1e-7 and drifts[1] > 0.01  # measured 3.7e-8 and 0.043

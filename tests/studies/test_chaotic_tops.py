"""Chaos of heavy tops between those of Lagrange and Kovalevskaya, against what is proved."""

import warnings

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.studies.stability_map.compute import prepared_case, run_map


def megno(degrees, energy, moments=(2.0, 2.0, 1.0), members=128):
    """MEGNO of starts all over an energy surface, with m g c = 1 J and the centre of mass at an
    angle from axis 3."""
    centre = np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))
    start = rm.Start(momentum=rm.Shell(energy), attitude="ensemble")
    scene = rm.Scene(rm.Body(moments, mass=0.25, centre=centre), rm.Gravity(4.0), start)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)  # a centre of mass far out
        run = {"integrator": "rk8", "dt": 0.2, "t_end": 1000.0, "members": members}
        return rm.simulate(scene, **run, save=("megno",)).megno.values


def share(*top, **more):
    """The share of the starts that are chaotic."""
    return float((megno(*top, **more) > 4.0).mean())


def test_integrable_tops_have_no_chaos_and_one_between_has():
    """Lagrange's and Kovalevskaya's; a degree away from the second there is."""
    for degrees in (0.0, 90.0):
        assert megno(degrees, 1.0).max() < 3.0  # measured 2.04 and 2.37
    assert share(45.0, 1.0) > 0.7  # measured 0.85
    assert 0.1 < share(89.0, 1.0) < 0.4  # measured 0.23


@pytest.mark.slow
def test_chaos_rises_and_falls_with_energy():
    """None near the bottom; near Lagrange's top it begins about the energy of the upright one, a
    thin layer (Holmes & Marsden 1983); at high energy none is left, unless three moments differ."""
    assert share(45.0, -0.9) == 0.0
    near = [share(4.0, energy, members=512) for energy in (-0.5, 1.0, 4.0)]
    assert near[0] == near[2] == 0.0 and 0.01 < near[1] < 0.1  # measured 0, 0.04, 0
    falls = [share(45.0, energy) for energy in (1.0, 2.0, 4.0, 9.0)]
    assert falls == sorted(falls, reverse=True) and falls[-1] < 0.02  # 0.85, 0.50, 0.19, 0
    assert share(90.0, 9.0, (2.0, 1.5, 1.0)) > 0.15  # measured 0.28


@pytest.mark.slow
def test_a_map_of_the_share():
    found = run_map(prepared_case("chaos_share", (16, 10), members=64))
    part = found["p(megno>4)"].values
    assert not found.failed.values.any() and part[0].max() == 0.0
    middle = part[2:6, 5:11].mean()
    assert 0.3 < middle < 0.6  # measured 0.45
    assert part[:, 0].max() < 0.2 and part[2:, 0].mean() < 0.05  # measured 0.047 and 0.006

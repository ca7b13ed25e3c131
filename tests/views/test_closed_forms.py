"""Pictures and lines of closed forms: steady tops, and angles of bodies that stand upright."""

import itertools
import re

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import rigidmc as rm
from rigidmc.studies.exact import _waves, compare
from rigidmc.views.closed_forms import (
    draw_effective_potential,
    euler_angles,
    free_summary,
    lagrange_summary,
    mean_rate,
)
from rigidmc.views.tops import angles
from tests.tools.axes import faults

SCENE = rm.Scene.load("heavy_top").with_run(members=1)
MOMENTS, THETA, SPIN = np.array(SCENE.body.moments), 0.4, 200.0
WEIGHT = SCENE.body.mass * 9.81 * SCENE.body.centre[2]
ATTITUDE = (np.cos(0.5 * THETA), np.sin(0.5 * THETA), 0.0, 0.0)


def test_the_potential_of_a_steady_top_is_a_well():
    slow = float(rm.steady_precession(MOMENTS, WEIGHT, SPIN, THETA)[0])
    momentum = MOMENTS * (0.0, slow * np.sin(THETA), SPIN)
    assert rm.analyse_lagrange_top(MOMENTS, WEIGHT, momentum, ATTITUDE).kind == "steady precession"
    axes = draw_effective_potential(MOMENTS, WEIGHT, momentum, ATTITUDE).axes[0]
    theta, u = axes.lines[0].get_data()
    low, high = axes.get_ylim()
    inside = theta[(u > low) & (u < high)]
    # 0.8 degrees are drawn; before, the height was 1e-12 of the energy and the well a line
    assert np.ptp(inside) > 0.5  # measured 0.59
    assert faults(axes.figure) == []
    assert axes.yaxis.get_offset_text().get_text() == ""


def test_every_axis_has_a_label():
    momentum = MOMENTS * (0.0, 3.0, SPIN)
    assert faults(lagrange_summary(MOMENTS, WEIGHT, momentum, ATTITUDE)) == []
    moments = np.array(rm.Scene.load("dzhanibekov").body.moments)
    assert faults(free_summary(moments, moments * (0.01, 6.28, 0.0), ATTITUDE, 6.0)) == []


def test_the_mean_rate_of_four_nutations_is_close_to_the_true_rate():
    t = np.linspace(0.0, 2.0, 401)
    for phase in np.linspace(0.0, 2.0 * np.pi, 12):
        found = mean_rate(t, 3.0 * t + 0.1 * np.sin(4.0 * np.pi * t + phase))
        # measured 4e-3; equal weights 2.4e-2
        assert found == pytest.approx(3.0, abs=5e-3)
    assert mean_rate(t[:2], t[:2]) == pytest.approx(1.0, rel=1e-12)  # measured 2e-16


def test_a_closed_form_is_drawn_with_its_own_mean_rates():
    """Random tops; an estimate from four nutations is up to 0.5 % off."""
    some = np.random.default_rng(2)
    for _ in range(8):
        theta, spin, push = some.uniform((0.3, 130.0, -4.0), (1.2, 300.0, 6.0))
        attitude = (np.cos(0.5 * theta), np.sin(0.5 * theta), 0.0, 0.0)
        top = MOMENTS, WEIGHT, MOMENTS * (0.0, push, spin), attitude
        motion = rm.analyse_lagrange_top(*top)
        _, labels = lagrange_summary(*top).axes[2].get_legend_handles_labels()
        for label, turn in zip(labels[1:], (motion.precession, motion.spin), strict=True):
            assert f"({abs(turn / motion.period):.4g} rad/s)" in label


@pytest.mark.parametrize("count", [2, 3, 5, 7])
def test_each_member_has_its_well_and_its_energy(count):
    """All wells of lines are in the picture; one energy has the colour of its well."""
    pushes = np.linspace(-3.0, 3.0, count)
    momentum = MOMENTS * np.stack([0.0 * pushes, pushes, 0.0 * pushes + SPIN], -1)
    many = np.tile(MOMENTS, (count, 1)), np.full(count, WEIGHT), momentum
    labels = [f"member {k}" if count <= 6 else None for k in range(count)]
    axes = draw_effective_potential(*many, np.tile(ATTITUDE, (count, 1)), labels=labels).axes[0]
    wells, energies = axes.lines[:count], axes.lines[count : 2 * count]
    low, _ = axes.get_ylim()
    for well, energy, label in zip(wells, energies, labels, strict=True):
        assert label in (None, well.get_label())
        assert np.all(well.get_color() == energy.get_color())
        theta, u = well.get_data()
        assert u.min() > low
        ends, height = energy.get_data()
        # the ends of the energy lie on the well; 1001 points are joined by lines
        assert np.interp(ends, theta, u) == pytest.approx(height, rel=1e-5)  # measured 3.4e-7
    assert faults(axes.figure) == []


def test_phi_and_psi_are_left_out_where_theta_is_0():
    scene = rm.Scene.load("dzhanibekov")
    t = np.linspace(0.0, 12.0, 1600)
    motion = rm.solve_free_top(scene.body.moments, np.array(scene.body.moments) * (0.01, 0.0, 6.28),
                         (1.0, 0.0, 0.0, 0.0), t)  # fmt: skip
    theta, phi, psi = (line.get_ydata() for line in euler_angles(motion.attitude, t).axes[0].lines)
    assert np.isnan(phi[0]) and np.isnan(psi[0]) and np.isfinite(theta).all()
    there = np.isfinite(phi)
    assert 200 < there.sum() < 1500
    sine = np.sin(np.radians(theta))
    assert (sine[there] > 0.05 * sine.max()).all() and (sine[~there] <= 0.05 * sine.max()).all()
    # before, turns between the flips were counted: phi rose by 380 degrees in each
    for angle in (phi, psi):
        pieces = np.split(angle[there], np.flatnonzero(np.diff(np.flatnonzero(there)) > 1) + 1)
        assert len(pieces) >= 3 and max(map(np.ptp, pieces)) < 3.0  # measured 1.2
        jumps = [after[0] - before[-1] for before, after in itertools.pairwise(pieces)]
        assert max(map(abs, jumps)) <= 180.0
    # a body that stays upright shows them all the same
    for line in euler_angles(np.tile([1.0, 0.0, 0.0, 0.0], (9, 1)), t[:9]).axes[0].lines:
        assert np.isfinite(line.get_ydata()).all()


def test_exact_tells_the_rates_of_steady_precession():
    def told(spin, *changes):
        changed = [("start.omega", f"[0.0, 0.0, {spin}]"), *changes]
        scene = rm.Scene.load("heavy_top", changed)
        return "\n".join(compare(scene, -1.0, 1))

    slow, fast = np.sort(np.roots([MOMENTS[0] * np.cos(THETA), -MOMENTS[2] * SPIN, WEIGHT]))
    assert f"slow {slow:.6g}, fast {fast:.6g} rad/s" in told(SPIN)
    least = 2.0 * np.sqrt(MOMENTS[0] * WEIGHT) / MOMENTS[2]
    words = f"upright, it sleeps above |omega_3| = {least:.6g} rad/s; its omega_3 is 200"
    assert words in told(SPIN)
    assert f"none below a spin of {least * np.sqrt(np.cos(THETA)):.6g} rad/s" in told(90.0)
    assert "motion       cusps\n" in told(SPIN)
    assert "waves" not in told(90.0)  # slow: each push with the precession makes waves
    assert "upside down, it sleeps above" in told(SPIN, ("body.pivot.3", "0.04"))


@pytest.mark.parametrize("weight", [WEIGHT, -WEIGHT])
@pytest.mark.parametrize("spin", [SPIN, -SPIN])
def test_exact_tells_the_pushes_that_make_waves_and_loops(weight, spin):
    """A push past the one that leads through the vertical makes waves again, not loops."""
    (line,) = _waves(MOMENTS, weight, MOMENTS[2] * spin, THETA, "")
    most, *ends = (float(x) for x in re.findall(r"(?:to|at|and) (-?[.0-9]+)", line))
    beyond = [(end, "loops", "monotone precession") for end in ends]
    for push, inside, outside in ((most, "monotone precession", "loops"), *beyond):
        for part, kind in ((0.999, inside), (1.001, outside)):
            momentum = MOMENTS * (0.0, part * push, spin)
            assert rm.analyse_lagrange_top(MOMENTS, weight, momentum, ATTITUDE).kind == kind


def test_exact_tells_one_precession_of_a_horizontal_axis():
    """Before, the fast rate of the shipped gyroscope was 5.9e17 rad/s: the cosine is 6e-17."""
    scene = rm.Scene.load("gyroscope")
    line = next(x for x in compare(scene, -1.0, 1) if x.startswith("steady"))
    moments, spin = scene.body.moments, scene.start.sample_spin(scene.run.seed, 0, 1, None)[1][2, 0]
    rate = scene.body.mass * 9.81 * np.linalg.norm(scene.body.centre) / (moments[2] * spin)
    assert f"precession at 90 deg: slow {rate:.6g} rad/s, fast none" in line


@pytest.mark.parametrize(("friction", "panels"), [((), 1), ((rm.AxialDamping((0, 0, 1.0)),), 3)])
def test_changing_rates_get_axes_of_their_own(friction, panels):
    """A damped top has turned by 2,000 degrees more than at its mean rate: theta was a line."""
    body = rm.Body(MOMENTS, mass=0.1776, centre=(0.0, 0.0, 0.04))
    start = rm.Start(omega=(0.0, 0.0, 200.0), attitude=(0.0, 0.4, 0.0))
    scene = rm.Scene(body, (rm.Gravity(9.81), *friction), start)
    ds = rm.simulate(scene, "rk8", dt=1e-3, t_end=1.0, members=1, every=5e-3, save=("attitude",))
    axes = angles(ds).axes
    assert len(axes) == panels and "θ" in (axes[0].get_ylabel() + str(axes[0].get_legend().texts))

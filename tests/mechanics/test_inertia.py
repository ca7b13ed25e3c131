"""Inertia tensors: particles, parallel axes, solids, joins, principal axes of arrays, frames.

Solids are tested against densities and meshes.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigidmc import Body, Scene, SceneError, SceneWarning
from rigidmc.mechanics import inertia, rotation
from tests.tools.commands import invoke
from tests.tools.reference import apart

RNG = np.random.default_rng(33)
COORDINATE = st.floats(-2.0, 2.0)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)


def cloud(n=7):
    return RNG.uniform(0.1, 1.0, n), RNG.normal(size=(n, 3))


def test_energy_and_momentum_of_a_cloud_are_sums_over_its_particles():
    for _ in range(20):
        m, r = cloud()
        tensor, omega = inertia.of_particles(m, r), RNG.normal(size=3)
        v = np.cross(omega, r)
        energy = 0.5 * (m * (v * v).sum(1)).sum()
        assert inertia.kinetic_energy(tensor, omega) == pytest.approx(energy, rel=1e-14)
        assert Body.from_particles(m, r).kinetic_energy(omega) == pytest.approx(energy, rel=1e-13)
        off = inertia.angular_momentum(tensor, omega) - (m[:, None] * np.cross(r, v)).sum(0)
        assert np.abs(off).max() < 1e-13  # 3.6e-15


@given(POINT, POINT, st.floats(0.1, 10.0))
@settings(max_examples=100, deadline=None)
def test_parallel_axes_there_and_back(d, r, mass):
    tensor = inertia.of_particles(
        np.array([mass, 1.0, 2.0]), np.array([r, [1.0, 0, 0], [0, 1.0, 0.3]])
    )
    there = inertia.about_point(tensor, mass, d)
    assert np.abs(inertia.about_centre(there, mass, d) - tensor).max() < 1e-13  # 1.4e-14


def test_parallel_axes_are_what_the_particles_give():
    m, r = cloud()
    centre, point = m @ r / m.sum(), RNG.normal(size=3)
    own, about = (inertia.of_particles(m, r - x) for x in (centre, point))
    d, body = centre - point, Body.from_particles(m, r)
    assert apart(inertia.about_point(own, m.sum(), d), about) < 3e-14  # 3.6e-15
    assert apart(body.with_pivot(point).tensor, about) < 3e-14  # 1.8e-15
    assert apart(body.with_pivot_at_centre().tensor, own) < 2e-14  # 8.9e-16
    twin = own + m.sum() * (d @ d * np.eye(3) + np.outer(d, d))  # the wrong sign
    assert apart(twin, about) > 0.1


def test_which_principal_axes_survive_a_shift():
    """Along an axis all, in a plane of two the third, and none."""
    for shift, stay in (((0, 0, 2), [1, 1, 1]), ((1, 2, 0), [0, 0, 1]), ((1, 2, 3), [0, 0, 0])):
        assert inertia.survives(np.eye(3), shift).tolist() == stay
    moved = inertia.about_point(np.diag([1.0, 2.0, 2.5]), 1.0, (1.0, 2.0, 0.0))
    assert moved[2, 0] == moved[2, 1] == 0.0 and abs(moved[0, 1]) > 1.0


REGIONS = {  # sizes, region, volume; more round solids are in test_solids.py
    "box": (
        {"size": (1.0, 2.0, 0.5)}, ("box", (-0.5, 0.5), (-1.0, 1.0), (-0.25, 0.25)), 1.0
    ),
    "cylinder": (
        {"radius": 0.7, "height": 1.5}, ("cylinder", 0.7, (-0.75, 0.75)), np.pi * 0.7**2 * 1.5
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REGIONS)
def test_solids_are_integrals_of_their_density(name):
    sizes, region, volume = REGIONS[name]
    body, made = Body.solid(name, mass=2.0, **sizes), Body.from_density(2.0 / volume, region)
    assert made.mass == pytest.approx(body.mass, rel=1e-13)
    assert apart(made.tensor, body.tensor) < 2e-14  # 5.8e-15


def test_thin_solids_are_limits_of_thick_ones():
    ring = {"inner": 0.6 - 1e-9, "outer": 0.6, "height": 1e-9}
    for name, sizes, thick, limit in (
        ("plate", {"size": (1.0, 0.6)}, "box", {"size": (1.0, 0.6, 1e-7)}),
        ("disc", {"radius": 0.6}, "cylinder", {"radius": 0.6, "height": 1e-7}),
        ("ring", {"radius": 0.6}, "hollow_cylinder", ring),
    ):
        thin, near = Body.solid(name, mass=2.0, **sizes), Body.solid(thick, mass=2.0, **limit)
        assert np.allclose(thin.moments, near.moments, rtol=0, atol=1e-8)
    outer, inner = (Body.solid("ball", mass=r**3, radius=r) for r in (1.0, 1.0 - 1e-5))
    hollow = outer.subtract(inner)
    assert hollow.moments == pytest.approx(
        Body.solid("shell", mass=hollow.mass, radius=1.0).moments, rel=2e-5
    )


def test_t_handle_is_the_join_of_its_rods_and_the_shipped_scene():
    handle = Body.solid("t_handle", density=8500.0, radius=0.005, bar=0.08, stem=0.04)
    line = 8500 * np.pi * 0.005**2
    bar, stem = (Body.solid("rod", mass=line * x, length=x, radius=0.005) for x in (0.08, 0.04))
    along_1 = rotation.from_rotation_vector((0.0, np.pi / 2, 0.0))
    lying = Body.from_tensor(np.diag([bar.moments[2], bar.moments[1], bar.moments[0]]), bar.mass)
    for base in (lying, Body.solid("ball", mass=1e-9, radius=1e-9).join(bar, turned=along_1)):
        made = base.join(stem, at=(0.0, 0.0, 0.02)).with_pivot_at_centre()
        assert sorted(made.moments) == pytest.approx(sorted(handle.moments), rel=1e-7)
    moments = 1.1515900570815086e-05, 3.966587974391863e-05, 2.9151361831435293e-05
    assert handle.moments == pytest.approx(moments, rel=1e-12)
    shipped = Scene.load("dzhanibekov").body
    assert shipped.moments == pytest.approx(handle.moments, rel=1e-14)
    assert shipped.mass == pytest.approx(line * 0.12, rel=1e-14)


@given(POINT, POINT)
@settings(max_examples=50, deadline=None)
def test_join_then_take_away(at, vector):
    body = Body.solid("box", mass=5.0, size=(1.0, 2.0, 3.0))
    part = Body.solid("cone", mass=1.0, radius=0.3, height=0.4)
    turned = rotation.from_rotation_vector(vector)
    back = body.join(part, at, turned).subtract(part, at, turned)
    assert np.abs(back.tensor - body.tensor).max() < 2e-13  # 7.1e-15
    assert np.abs(np.array(back.centre)).max() < 1e-14  # 4.4e-17


def test_taking_away_too_much_is_refused():
    ball = Body.solid("ball", mass=1.0, radius=0.5)
    with pytest.raises(SceneError, match="nothing remains"):
        ball.subtract(ball)
    with pytest.raises(SceneError, match="positive"):
        Body.solid("ball", mass=1.1, radius=0.1).subtract(ball)


def test_results_come_back_in_the_users_axes():
    tensor = inertia.of_particles(*cloud())
    body, omega = Body.from_tensor(tensor), RNG.normal(size=(5, 3))
    inside, momentum = body.to_principal(omega), omega @ tensor
    assert apart(body.to_reference(np.array(body.moments) * inside), momentum) < 1e-13  # 3.6e-15
    assert apart(body.angular_momentum(omega), momentum) < 1e-13  # 3.6e-15
    q = rotation.from_rotation_vector(RNG.normal(size=(5, 3)))
    own = body.principal_attitude(q)
    assert rotation.attitude_error(body.reference_attitude(own), q).max() < 4e-15  # 5.0e-16
    # the same vector by either path; measured 5.6e-16
    assert apart(rotation.to_space(own, inside), rotation.to_space(q, omega)) < 1e-14


def test_principal_axes_of_arrays_and_what_is_no_tensor():
    tensors = np.stack([inertia.of_particles(*cloud()) for _ in range(40)]).reshape(4, 10, 3, 3)
    moments, axes = inertia.principal_axes(tensors)
    assert moments.shape == (4, 10, 3)
    back = np.einsum("...ik,...k,...jk->...ij", axes, moments, axes)
    assert apart(back, tensors) < 4e-15 * apart(tensors)  # measured 3.8e-16
    assert (np.linalg.det(axes) > 0.999).all()
    spoilt = tensors.copy()
    spoilt[1, 2, 0, 1] += 1.0
    spoilt[3, 3], spoilt[0, 7], spoilt[2, 1] = np.diag([1.0, 1.0, 3.0]), np.nan, 0.0
    with pytest.warns(SceneWarning) as notes:
        found, turned = inertia.principal_axes(spoilt)
    assert sorted(str(n.message)[:7] for n in notes) == ["1 of 40", "1 of 40", "2 of 40"]
    bad = [1, 3, 0, 2], [2, 3, 7, 1]
    assert np.isnan(found[bad]).all() and np.isnan(turned[bad]).all()
    good = ~np.isnan(found[..., 0])
    assert good.sum() == 36
    assert (found[good] == moments[good]).all() and (turned[good] == axes[good]).all()
    for bad, rule in (
        (np.eye(3) + np.eye(3)[[1, 2, 0]], "symmetric"),
        (np.diag([1, 1, 3.0]), "I_j"),
        (np.diag([1, 1, -1.0]), "positive"),
        (np.zeros((3, 3)), "mass"),
    ):
        with pytest.raises(SceneError, match=rule):
            Body.from_tensor(bad)


def test_words_for_solids_are_checked():
    with pytest.raises(SceneError, match="did you mean 'cylinder'"):
        Body.solid("cilinder", mass=1.0)
    with pytest.raises(SceneError, match="less than outer"):
        Body.solid("hollow_cylinder", mass=1.0, inner=2.0, outer=1.0, height=1.0)


def test_growth_rate_is_that_of_the_linear_equations():
    a, b, c = moments = 1.0, 2.0, 3.0
    largest = np.linalg.eigvals([[0.0, (b - c) / a], [(a - b) / c, 0.0]]).real.max()
    assert inertia.growth_rate(moments) == pytest.approx(largest, rel=1e-14)
    assert inertia.growth_rate([1.0, 1.0, 2.0]) == 0.0


def test_body_command_on_scenes():
    shown = invoke("body cylinder_on_edge").stdout
    assert "0.005               (0.755928946, 0, -0.6546536707)" in shown
    shown = invoke("body dzhanibekov").stdout
    assert "unstable about axis 3: a disturbance grows as exp(0.637134 omega t)" in shown
    assert invoke("body nasa_brick --json").stdout.startswith("{")


def test_a_centre_lies_too_far_where_second_moments_are_negative():
    """500 bodies; the truth are eigenvalues of diag(S) - m c c^T. Of flat bodies a centre off the
    plane is too far."""
    rng, seen = np.random.default_rng(4), set()
    for _ in range(500):
        second = rng.uniform(0.1, 2.0, 3) * 10.0 ** rng.integers(-20, 21)
        moments = second.sum() - second
        mass, centre = rng.uniform(0.1, 9.0), rng.normal(size=3) * (rng.random(3) < 0.8)
        centre *= np.sqrt(second.mean() / mass) * rng.uniform(0.1, 1.2)
        least = np.linalg.eigvalsh(np.diag(second) - mass * np.outer(centre, centre))[0]
        if abs(least) > 1e-6 * second.max():
            assert inertia.too_far(moments, mass, centre) == (least < 0.0)
            seen.add(bool(least < 0.0))
    assert seen == {True, False}
    for centre, far in (((0.1, 0.2, 0.0), False), ((0.0, 0.0, 0.1), True)):
        assert inertia.too_far(np.array([1.0, 1.0, 2.0]), 1.0, np.array(centre)) == far

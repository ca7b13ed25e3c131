"""Why a body cannot exist: each cause, with the numbers of its cure, and none for a real body."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics import inertia
from rigidmc.mechanics.impossible import can_exist, likely_causes, opposite_products


def cloud(rng, count=12):
    """A body of particles: (tensor about the origin, mass, centre, tensor about the centre)."""
    masses, x = rng.uniform(0.5, 2.0, count), rng.normal(size=(count, 3)) + [0.5, 1.0, -0.7]
    mass, centre = masses.sum(), masses @ x / masses.sum()
    return inertia.of_particles(masses, x), mass, centre, inertia.of_particles(masses, x - centre)


def test_bodies_of_particles_exist_and_lighter_ones_about_the_centre_do_not():
    rng = np.random.default_rng(1)
    for _ in range(50):
        tensor, mass, centre, _ = cloud(rng)
        assert can_exist(tensor, mass, centre) and likely_causes(tensor, mass, centre) == ()
        # three particles on a plane are the limit: the slightest increase of m c c^T is too much
        flat = inertia.of_particles([1.0, 1.0, 1.0], np.diag([1.0, 2.0, 3.0]))
        place = np.array([1.0, 2.0, 3.0]) / 3.0
        assert can_exist(flat, 3.0, place) and not can_exist(flat, 3.0, 1.0001 * place)


@pytest.mark.parametrize(
    ("own", "mass", "centre", "shown"),
    [
        # 20 kg at 0.3 m: 1.8 kg m2 about y and z
        ((0.4, 0.2, 0.4), 20.0, (0.3, 0.0, 0.0), "(0.4, 2, 2.2)"),
        # 0.18 kg at 0.04 m: 2.88e-4 kg m2 about x and y; the axes keep their order
        ((3.25e-4, 3.25e-4, 0.8e-4), 0.18, (0.0, 0.0, 0.04), "(0.000613, 0.000613, 8e-05)"),
        ((0.4, 0.2, 0.4), 20.0, (0.0, 0.3, 0.0), "(2.2, 0.2, 2.2)"),
    ],
)
def test_a_tensor_about_the_centre_of_mass_is_the_first_cause(own, mass, centre, shown):
    first, *_ = likely_causes(np.diag(own), mass, centre)
    assert 'about = "centre"' in first and f"{shown} kg m2" in first


def test_products_with_the_opposite_sign_are_found_where_only_they_cure():
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(200):
        tensor, mass, centre, _ = cloud(rng, 4)
        wrong = opposite_products(tensor)
        if can_exist(wrong, mass, centre):
            continue
        found += 1
        causes = likely_causes(wrong, mass, centre)
        shown = ", ".join(f"{x:.6g}" for x in np.linalg.eigvalsh(tensor))
        assert any("opposite sign" in cause and shown in cause for cause in causes)
    assert found > 50  # measured 192


def test_millimetres_and_grams():
    own, mass, centre = np.diag([1e-3, 1e-3, 5e-4]), 0.5, np.array([0.0, 0.0, 0.03])
    assert likely_causes(own, mass, centre) == ()
    millimetres, *_ = likely_causes(own, mass, 1e3 * centre)
    assert millimetres == "the centre is in millimetres: in m, it is (0, 0, 0.03)"
    causes = likely_causes(own, mass, 1e3 * np.array([0.0, 0.0, 0.2]))
    # 0.5 kg at 0.2 m: 0.02 kg m2 about x and y
    words = "in m, it is (0, 0, 0.2), and the inertia is about it", "(0.021, 0.021, 0.0005) kg m2"
    assert any(all(word in cause for word in words) for cause in causes)
    grams, *_ = likely_causes(own, 1e3 * mass, centre)
    assert grams == "the mass is in grams: in kg, it is 0.5"
    # 284 kg m2 about the fixed point would be 760 radii of gyration away from the centre
    assert len(likely_causes(np.diag([4e-4, 4e-4, 1e-4]), 0.18, (0.0, 0.0, 39.7))) == 1
    both, *_ = likely_causes(own, 1e3 * mass, 1e3 * centre)
    assert both.endswith("they are (0, 0, 0.03) and 0.5")


def test_the_causes_come_in_order_with_the_errors_and_the_notes():
    # a product larger than the body has room for
    tensor = np.array([[1.0, 0.9, 0.9], [0.9, 1.0, 0.9], [0.9, 0.9, 1.0]])
    with pytest.raises(rm.SceneError) as caught:
        rm.Body.from_tensor(tensor)
    assert "opposite sign" not in str(caught.value)  # reversed, it has a negative moment
    plate = opposite_products(
        inertia.of_particles([1.0, 1.0, 1.0, 0.3], [[1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]])
    )
    with pytest.raises(rm.SceneError, match=r"likely cause.*opposite sign.*the moments are \("):
        rm.Body.from_tensor(plate)
    scene = rm.Scene(rm.Body.from_tensor(np.diag([0.4, 0.2, 0.4]), 20.0, (0.3, 0.0, 0.0)))
    (note,) = (note for note in rm.prepare(scene, dt=1e-2, t_end=0.1).notes if "exist" in note)
    assert 'likely cause: the inertia is about the centre of mass: about = "centre" gives' in note


def test_nonsense_has_no_causes():
    own = np.diag([1.0, 1.0, 5.0])
    for tensor, mass, centre in (
        (own, 0.0, (0.0, 0.0, 0.0)),
        (own, np.nan, (0.0, 0.0, 0.0)),
        (np.full((3, 3), np.nan), 1.0, (0.0, 0.0, 0.0)),
        (own, 1.0, (np.inf, 0.0, 0.0)),
    ):
        assert likely_causes(tensor, mass, centre) == ()
    assert likely_causes(own, 1.0, (0.0, 0.0, 0.0)) == ()

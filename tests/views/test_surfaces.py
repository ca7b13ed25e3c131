"""Surfaces of bodies: volume, centre of mass and inertia of the triangles are those of the body."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics.mesh import mass_properties
from rigidmc.views.surfaces import body_surface, revolve

# a circle of 48 corners has 0.9971 of the area and 0.9943 of the second moment of the round one;
# measured: worst 0.0057 of the largest moment, for the ball
ROUND = 0.008

BODIES = {
    "box": rm.Body.box(1.0, (1.0, 0.6, 0.2)),
    "ball": rm.Body.solid("ball", mass=1.0, radius=0.7),
    "cylinder": rm.Body.cylinder(1.0, 0.4, 1.2),
    "hollow_cylinder": rm.Body.solid("hollow_cylinder", mass=1.0, inner=0.3, outer=0.6, height=0.5),
    "cone": rm.Body.solid("cone", mass=1.0, radius=0.4, height=1.0),
    "ellipsoid": rm.Body.solid("ellipsoid", mass=1.0, semiaxes=(1.0, 0.6, 0.3)),
    "rod": rm.Body.solid("rod", mass=1.0, length=1.0, radius=0.05),
    "density": rm.Body.from_density(1000.0, ("cylinder", 0.1, (0.05, 0.3))),
    "block": rm.Body.from_density(2.0, ("box", (0.0, 1.0), (-1.0, 2.0), (0.5, 0.7))),
    "pivoted": rm.Body.cylinder(0.2, 0.03, 0.008).with_pivot((0.0, 0.01, -0.04)),
    "joined": rm.Body.cylinder(1.0, 0.1, 1.0).join(
        rm.Body.box(0.5, (0.5, 0.1, 0.2)), at=(0.0, 0.2, 0.6), turned=(0.8, 0.6, 0.0, 0.0)
    ),
}


def result_of(body):
    start = rm.Start(omega=(0.1, 0.2, 1.0))
    return rm.simulate(rm.Scene(body, start=start), dt=0.1, t_end=0.1, members=1)


@pytest.mark.parametrize("name", BODIES)
def test_a_surface_has_the_inertia_of_its_body(name):
    body = BODIES[name]
    ds = result_of(body)
    surface = body_surface(ds, body)
    triangles = surface.corners[surface.faces]
    if name != "joined":  # whose densities differ
        volume, centre, tensor = mass_properties(triangles, 1.0)
        moments = np.array(body.moments)
        size = np.sqrt(moments.max() / body.mass)
        assert (
            np.abs(centre - body.to_principal(body.centre)).max() <= 1e-12 * size
        )  # measured 1e-15
        off = tensor * body.mass / volume - np.diag(moments)
        assert np.abs(off).max() <= ROUND * moments.max()


def test_joined_parts_lie_where_they_were_joined():
    """Each part of a joined body, as a body of its own, gives its share of the inertia."""
    body = BODIES["joined"]
    surface = body_surface(result_of(body), body)
    whole, at = np.zeros((3, 3)), 0
    for part, mass in (
        (rm.Body.cylinder(1.0, 0.1, 1.0), 1.0),
        (rm.Body.box(500.0, (1, 1, 1)), 0.5),
    ):
        faces = len(body_surface(result_of(part), part).faces)
        triangles = surface.corners[surface.faces[at : at + faces]]
        volume, _, tensor = mass_properties(triangles, 1.0)
        whole, at = whole + mass / volume * tensor, at + faces
    assert at == len(surface.faces)
    # measured 5e-5
    assert np.abs(whole - np.diag(body.moments)).max() <= ROUND * max(body.moments)


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.02, -0.03, 0.25)])
def test_a_body_without_shape_is_its_ellipsoid(centre):
    body = rm.Body.from_moments((0.3, 0.28, 0.11), mass=2.0, centre=centre)
    surface = body_surface(result_of(body), body)
    triangles = surface.corners[surface.faces]
    volume, middle, tensor = mass_properties(triangles, 1.0)
    assert np.abs(middle - np.array(centre)).max() <= 1e-12
    off = tensor * body.mass / volume - np.diag(body.moments)
    assert np.abs(off).max() <= ROUND * max(body.moments)  # measured 0.0035


def test_thin_solids_are_thin_and_of_their_size():
    for name, sizes, extent in (
        ("disc", {"radius": 0.5}, (1.0, 1.0, 0.015)),
        ("plate", {"size": (0.5, 0.2)}, (0.5, 0.2, 0.015)),
        ("ring", {"radius": 0.5}, (1.03, 1.03, 0.03)),
        ("shell", {"radius": 0.5}, (1.0, 1.0, 1.0)),
    ):
        body = rm.Body.solid(name, mass=1.0, **sizes)
        corners = body_surface(result_of(body), body).corners
        assert np.ptp(corners, axis=0) == pytest.approx(extent, rel=1e-9), name


def test_quarters_alternate_so_that_a_spin_is_seen():
    surface = revolve((0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0))
    x, y, _ = surface.corners[surface.faces].mean(1).T
    assert (surface.tones % 2 == (x * y < 0.0)).all()
    assert {*surface.tones.tolist()} == {0, 1, 4, 5}


def test_particles_and_holes_and_meshes():
    trimesh = pytest.importorskip("trimesh")
    torus = trimesh.creation.torus(1.0, 0.3, major_sections=200, minor_sections=100)
    body = rm.Body.from_mesh(torus, mass=2.0)
    surface = body_surface(result_of(body), body)
    assert len(surface.corners) <= 2000 < len(torus.vertices)
    volume, _, tensor = mass_properties(surface.corners[surface.faces], 1.0)
    # thinned from 20,000 corners: measured 0.0041
    assert np.abs(tensor * 2.0 / volume - np.diag(body.moments)).max() <= 0.008 * max(body.moments)

    places = [(1.0, 0.0, 0.1), (0.0, 1.0, 0.0), (-1.0, 0.5, 0.7)]
    body = rm.Body.from_particles([1.0, 8.0, 1.0], places)
    corners = body_surface(result_of(body), body).corners
    small, large, _ = np.split(body.to_reference(corners), 3)
    assert small.mean(0) == pytest.approx((1.0, 0.0, 0.1), abs=1e-9)
    assert np.ptp(large[:, 2]) == pytest.approx(2.0 * np.ptp(small[:, 2]))

    bored = rm.Body.cylinder(1.0, 0.5, 1.0).subtract(rm.Body.cylinder(0.1, 0.1, 1.0))
    tones = body_surface(result_of(bored), bored).tones
    assert (tones == 6).sum() == len(tones) / 2  # the hole is dark

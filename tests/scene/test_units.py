"""Other units change no pure number of what is drawn, nor of bodies."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.results.variables import member_variables
from rigidmc.scene.body_changes import BodyChanges
from rigidmc.scene.body_makers import BodyMakers
from rigidmc.scene.body_readers import BodyReaders
from rigidmc.scene.quantities import draw
from rigidmc.scene.vector_distributions import VECTOR_DISTRIBUTIONS
from tests.tools.plans import starts
from tests.tools.units import OTHERS, PLAIN, in_units

BODY, WEIGHT = rm.Body((1.0, 2.0, 2.5), 1.3, (0.0, 0.1, 0.2)), rm.Gravity(9.81)
SPIN = {"omega": (0.0, 0.0, 1.0)}
STARTS = {
    rm.Cone: {"omega": rm.Cone(2, 1.5, 0.2)},
    rm.Sphere: {"momentum": rm.Sphere(2.0)},
    rm.Correlated: {"omega": rm.Correlated((0.0, 1.0, 0.0), 0.01 * np.eye(3))},
    rm.Shell: {"momentum": rm.Shell(2.0), "attitude": "ensemble"},
    rm.GibbsMomentum: {"momentum": rm.GibbsMomentum(0.5), "attitude": "ensemble"},
    rm.Fisher: {**SPIN, "attitude": rm.Fisher((1.0, 0.0, 0.0, 0.0), 50.0)},
    rm.Pointing: {**SPIN, "attitude": rm.Pointing((0.0, 0.0, 1.0), 50.0)},
}
TENSOR = rm.UncertainInertia(np.diag([2.0, 2.5, 3.0]), 0.01 * np.eye(6))
BODIES = {
    rm.SecondMoments: rm.Body(rm.SecondMoments((1.0, 2.0, rm.uniform(0.5, 1.5)))),
    rm.UncertainInertia: rm.Body.from_tensor(TENSOR),
    rm.TensorRows: rm.Body.from_tensor(
        np.eye(3) * np.linspace(2.0, 3.0, 64)[:, None, None] + [[0, 0.1, 0], [0.1, 0, 0], [0, 0, 1]]
    ),
}
SCENES = {kind: rm.Scene(BODY, WEIGHT, rm.Start(**start)) for kind, start in STARTS.items()}
SCENES |= {kind: rm.Scene(body, start=rm.Start(**SPIN)) for kind, body in BODIES.items()}


def drawn(scene, by=PLAIN):
    """{name: pure numbers} of the starts of 64 members."""
    known = member_variables(scene.model, scene.run, scene.recording, True)
    start = starts(scene, 0, 64, True)[1]
    units = {name: known[name].attrs.get("units", "1") for name in known.keys() & start.keys()}
    return {name: start[name] / by.of(unit) for name, unit in units.items()}


@pytest.mark.parametrize("kind", VECTOR_DISTRIBUTIONS)
def test_laws_draw_the_same_pure_numbers(kind):
    plain = drawn(SCENES[kind])
    for other in OTHERS:
        found = drawn(in_units(SCENES[kind], other), other)
        assert found.keys() == plain.keys() and len(plain) > 2
        for name, values in plain.items():
            off = np.abs(found[name] - values).max()
            assert off <= 1e-13 * np.abs(values).max(), (name, other)  # measured 6.7e-15


def test_distributions_draw_the_same_pure_numbers():
    laws = rm.normal(1.0, 0.2), rm.uniform(1.0, 2.0), rm.distribution("gamma", a=3.0)
    two = rm.mixture((2.0, rm.normal(0.0, 1.0)), (1.0, rm.uniform(4.0, 5.0)))
    for law in (
        *laws,
        two,
        rm.common(1.0, 0.2, -0.1),
        rm.grid(1.0, 2.0, 8),
        rm.normal(1.0, 0.2).between(0.5, 1.4),
    ):
        plain = draw((law,), 5, "start.omega", 0, 64)
        for by in (1e-20, 1e20):
            found = draw((law.times(by),), 5, "start.omega", 0, 64) / by
            assert np.abs(found - plain).max() < 1e-14 * np.abs(plain).max()  # measured 2.2e-16


def bodies(m):
    """{how: body} of all masses times m."""
    box, rod = rm.Body.box(2.0 * m, (1.0, 2.0, 3.0)), rm.Body.cylinder(0.5 * m, 0.1, 2.0)
    places = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
    tensor = m * np.array([[2.0, 0.1, 0.0], [0.1, 2.5, 0.2], [0.0, 0.2, 3.0]])
    away = rod.with_pivot((0.0, 0.1, 1.0))
    return {
        "box": box,
        "cylinder": rod,
        "solid": rm.Body.solid("cone", mass=1.5 * m, radius=0.5, height=1.0),
        "from_moments": rm.Body.from_moments((m, 2.0 * m, 2.5 * m), m, (0.0, 0.1, 0.2)),
        "from_particles": rm.Body.from_particles(m * np.array([1.0, 2.0, 0.5, 0.7]), places),
        "from_tensor": rm.Body.from_tensor(tensor, 1.2 * m, (0.1, 0.2, 0.0)),
        "from_density": rm.Body.from_density(2.0 * m, ("cylinder", 0.5, (0.0, 2.0))),
        "join": box.join(rod, at=(0.0, 0.0, 2.0)),
        "subtract": box.subtract(rod),
        "with_pivot": away,
        "with_pivot_at_centre": away.with_pivot_at_centre(),
    }


@pytest.mark.parametrize("mass", [1e-20, 1e20])
def test_bodies_have_the_same_pure_numbers(mass):
    plain = bodies(1.0)
    kinds = vars(BodyMakers) | vars(BodyReaders) | vars(BodyChanges)
    makers = {name for name in kinds if not name.startswith("_")}
    # tests/mechanics/test_mesh.py, tests/scene/body_files
    assert makers - plain.keys() == {"from_mesh", "read"}
    for name, body in bodies(mass).items():
        one, two = pure(plain[name], 1.0), pure(body, mass)
        assert np.abs(two - one).max() < 1e-13 * np.abs(one).max(), name  # measured 2.9e-16


def pure(body, mass):
    spin = (0.3, 1.0, -0.5)
    sizes = [body.mass, *body.moments, *np.ravel(body.tensor), body.kinetic_energy(spin)]
    sizes += [*body.angular_momentum(spin)]
    return np.array([*(np.array(sizes) / mass), *body.centre, *np.ravel(body.axes)])

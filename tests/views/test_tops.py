"""Pictures of tops: lines and densities of the same members, turning points, refusals by name."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import rigidmc as rm
from rigidmc.errors import RigidmcError
from rigidmc.views import PICTURES
from rigidmc.views.caps import narrow_cap
from rigidmc.views.figures import new_figure
from rigidmc.views.quadric import Quadric
from rigidmc.views.sphere import curves_at_energy
from tests.tools.axes import faults


@pytest.fixture(scope="module")
def pendulums():
    return rm.simulate(rm.Scene.load("pendulum"), t_end=1.0)


@pytest.fixture(scope="module")
def free():
    scene = rm.Scene.load("dzhanibekov")
    return rm.simulate(scene, members=24, t_end=2.0, every=0.02, save=("omega", "attitude"))


@pytest.mark.parametrize("name", PICTURES)
def test_no_picture_has_faults(pendulums, free, name):
    """Axes with labels and units, no raw names, no cut text, legends in the colours of the lines;
    of one member, a few, and an ensemble, with and without gravity."""
    refused = {  # {picture: those without it}: near the vertical, phi may lose turns
        "poinsot": ["pendulum 1", "pendulum 3", "pendulum 24"],
        "effective_potential": ["dzhanibekov 1", "dzhanibekov 3", "dzhanibekov 24"],
        "angles": ["pendulum 24", "dzhanibekov 24"],
    }
    lacking = []
    for ds in (pendulums, free):
        for members in (1, 3, 24):
            try:
                figure = getattr(ds.isel(member=slice(members)).rigid.plot, name)()
            except ValueError:
                lacking.append(f"{ds.attrs['title']} {members}")
                continue
            assert figure.axes and faults(figure) == [], (ds.attrs["title"], members)
    assert lacking == refused.get(name, [])


def test_faults_are_seen():
    """Each kind of fault, in a picture made for it."""
    figure = new_figure("faults", (4.0, 3.0))
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], color="black", label="start.omega.3")
    axes.plot([], [], color="red", label="start")
    axes.set(xlabel="theta")
    figure.text(0.9, 0.5, "beyond the edge of the figure")
    axes.legend()
    kinds = [fault.partition(":")[0] for fault in faults(figure)]
    assert kinds == ["no label", "cut", "raw name", "no unit", "legend has another colour"]


def test_the_portrait_of_a_pendulum_and_its_separatrix(pendulums):
    one = pendulums.isel(member=[10])
    axes = one.rigid.plot.phase_portrait().axes[0]
    lines = {line.get_label(): line.get_data() for line in axes.lines}
    theta, rate = lines["member 10"]
    scene = rm.Scene.load("pendulum")
    inertia, weight = scene.body.moments[0], scene.body.mass * 9.81 * scene.body.centre[2]
    energy = 0.5 * inertia * rate**2 + weight * np.cos(np.radians(theta))
    assert np.ptp(energy) < 1e-6 * abs(energy).max()  # the Hamiltonian; rk8 keeps it to 1e-9
    theta, rate = lines["separatrix"]
    height = 2.0 * np.sin(0.5 * np.radians(theta)) ** 2
    assert np.allclose(0.5 * inertia * rate**2, abs(weight) * height)


def test_curves_at_an_energy_have_it_on_sphere_and_ellipsoid():
    moments = np.array([1.0, 2.0, 3.0])
    for inverse in (0.35, 0.4, 0.5, 0.7, 0.95):
        for u in curves_at_energy(moments, inverse):
            assert np.abs((u * u / moments).sum(-1) - inverse).max() < 1e-13  # measured 2e-16
            x = Quadric(moments).points(u)
            assert np.abs((moments * x * x).sum(-1) - moments.min()).max() < 1e-13  # 4e-16


@pytest.mark.parametrize(("axis", "side"), [(0, 1), (1, -1), (2, 1)])
def test_narrow_paths_are_drawn_on_a_cap_around_their_axis(axis, side):
    turn = np.linspace(0.0, 2.0 * np.pi, 50)

    def cone(degrees):
        angle = np.radians(degrees)
        across = np.sin(angle) * np.stack([np.cos(turn), np.sin(turn)], -1)
        return np.roll(np.column_stack([across, np.full(50, side * np.cos(angle))]), axis + 1, 1)

    assert narrow_cap([cone(4.9)], 10.0) == (axis, side, 5)
    assert narrow_cap([cone(4.9), cone(1.0)], 10.0) == (axis, side, 5)
    assert narrow_cap([cone(11.0)], 10.0) is None
    assert narrow_cap([cone(31.0)], 60.0) == (axis, side, 45)
    assert narrow_cap([cone(4.9), -cone(4.9)], 10.0) is None
    assert narrow_cap([cone(0.0)], 10.0) is None  # a point
    assert narrow_cap([cone(4.9), np.full((2, 3), np.nan)], 10.0) is None  # at rest


def test_refusals_name_the_rule(pendulums, free):
    one = free.isel(member=[0]).rigid.plot
    for draw, words in (
        (lambda: one.effective_potential(), "needs heavy symmetric tops"),
        (lambda: pendulums.rigid.plot.poinsot(), "needs free bodies"),
        (lambda: one.polhodes(surface="elipsoid"), "did you mean 'ellipsoid'"),
        (lambda: one.polhodes(energies=[1.0]), "the energy is"),
        (lambda: free.rigid.plot.polhodes(surface="ellipsoid"), "select some"),
    ):
        with pytest.raises((RigidmcError, ValueError), match=words):
            draw()


def test_help_lists_the_pictures(free):
    methods = vars(type(free.rigid.plot))
    assert all(methods[name].__doc__.startswith("Draw ") for name in PICTURES)


HEAVY = {"run.t_end": 0.2}
LABELS = (  # what differs, and the labels: more than one number keeps the members
    ({"start.omega": (0.0, rm.grid(-1.5, 1.5, 3), 200.0)}, ["ω₂(0) = −1 rad/s", "ω₂(0) = 0 rad/s"]),
    ({"start.omega": (0.0, 0.0, 200.0), "effects.gravity.g": rm.grid(5.0, 11.0, 3)},
     ["gravity g = 6 m/s²", "gravity g = 8 m/s²"]),
    ({"effects.gravity.g": rm.grid(5.0, 11.0, 3)}, ["member 0", "member 1"]),
    ({"start.omega": (rm.normal(0, 1), rm.normal(0, 1), 200.0)}, ["member 0", "member 1"]),
)  # fmt: skip


@pytest.mark.parametrize(("settings", "labels"), LABELS)
def test_lines_name_the_one_number_by_which_members_differ(settings, labels):
    scene = rm.Scene.load("heavy_top", {**settings, **HEAVY})
    ds = rm.simulate(scene, members=3, every=0.1, save=("omega", "attitude"))
    for name in ("trajectory", "phase_portrait", "effective_potential"):
        axes = getattr(ds.rigid.plot, name)().axes[0]
        assert set(labels) <= set(axes.get_legend_handles_labels()[1])
        assert faults(axes.figure) == []

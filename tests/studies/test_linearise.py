"""Steady motions and their stability against closed forms: Euler, Lagrange, Hughes, DeBra-Delp."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError
from rigidmc.mechanics import rotation
from rigidmc.planning.initial import members_at_start
from rigidmc.studies.linearise import steady, system
from rigidmc.studies.linearise.motions import Problem
from rigidmc.studies.linearise.picture import _with_onsets, eigenvalues
from rigidmc.studies.linearise.stability import jacobians
from rigidmc.studies.linearise.study import table
from rigidmc.studies.linearise.system import find_symmetries

G = 9.81


def own_values(one):
    own = one.origin.values == "motion"
    return one.growth.values[own] + 1j * one.frequency.values[own]


def gap(values, true):
    apart = np.abs(np.asarray(values)[:, None] - np.asarray(true))
    assert apart.shape[0] == apart.shape[1]
    return max(apart.min(0).max(), apart.min(1).max())


def nearest(found, omega):
    return found.isel(motion=int(((found.omega - omega) ** 2).sum("axis").argmin("motion")))


def top(moments=(1.0, 1.0, 0.5), arm=(0.0, 0.0, 0.3), **start):
    body = rm.Body(moments, mass=1.0, centre=arm)
    return rm.Scene(body, rm.Gravity(G), rm.Start(**start))


def test_free_body_has_eulers_rates_about_all_axes():
    moments, l = np.array([1.0, 2.0, 2.5]), 6.0
    start = rm.Start(momentum=(0.1, np.sqrt(l * l - 0.01), 0.0))
    found = rm.linearise(rm.Scene(rm.Body(tuple(moments)), start=start), starts=24)
    assert found.sizes["motion"] == 6
    for axis, (i, j, k) in enumerate(((0, 1, 2), (1, 2, 0), (2, 0, 1))):
        square = (moments[i] - moments[j]) * (moments[k] - moments[i]) / moments[j] / moments[k]
        for sign in (-1.0, 1.0):
            omega = np.zeros(3)
            omega[axis] = sign * l / moments[i]
            one = nearest(found, omega)
            true = np.sqrt(complex(square)) * l / moments[i]
            assert abs(one.omega - omega).max() < 1e-12  # measured 1e-15
            assert gap(own_values(one), [-true, true]) < 1e-12  # measured 2e-15
            assert one.stability.item() == ("saddle" if axis == 1 else "elliptic")
    assert (found.origin == "symmetry").sum("eigenvalue").values.tolist() == [3] * 6


@pytest.mark.parametrize("spin", (6.0, 6.9))
def test_upright_top_has_the_eigenvalues_of_lagrange(spin):
    found = rm.linearise(top(omega=(0.0, 0.0, spin)), starts=1)
    # in space I1 a'' - i I3 spin a' - m g l a = 0; the body turns by spin, and a* is its mirror
    roots = np.roots([1.0, -1j * 0.5 * spin, -G * 0.3]) - 1j * spin
    assert gap(own_values(found.isel(motion=0)), [*roots, *roots.conj()]) < 1e-12
    is_asleep = 0.25 * spin**2 > 4.0 * G * 0.3
    assert found.stability[0].item() == ("elliptic" if is_asleep else "unstable spiral")


def test_a_top_with_a_wrong_arm_has_other_eigenvalues():
    right, wrong = (
        rm.linearise(top(omega=(0.0, 0.0, 6.0), arm=(0.0, 0.0, z)), starts=1).growth_rate[0]
        for z in (0.3, 0.2999)
    )
    assert abs(float(right) - float(wrong)) > 1e-5


def test_pendulum_hangs_with_its_frequencies_and_falls_from_upright():
    found = rm.linearise(top((1.0, 1.3, 0.7), attitude=(0.0, 3.0, 0.4), omega=(0, 0, 0)))
    assert sorted(found.stability.values) == ["elliptic", "saddle"]
    hanging = found.isel(motion=int(found.energy.argmin("motion")))
    roots = np.sqrt(G * 0.3 / np.array([1.3, 1.0]))
    assert gap(own_values(hanging), [*1j * roots, *-1j * roots]) < 1e-12
    upright = found.isel(motion=int(found.energy.argmax("motion")))
    assert gap(own_values(upright), [*roots, *-roots]) < 1e-12


def test_regular_precession_nutates_with_its_frequency():
    tilt, spin, weight = 0.7, 20.0, G * 0.3
    for rate in np.roots([np.cos(tilt), -0.5 * spin, weight]):  # steady precession, I1 = 1
        omega = (0.0, float(rate) * np.sin(tilt), spin)
        found = rm.linearise(top(omega=omega, attitude=(0.0, tilt, 0.0)), starts=1).isel(motion=0)
        # Klein & Sommerfeld: the curvature of the effective potential at the tilt
        lz = np.sin(tilt) ** 2 * rate + 0.5 * spin * np.cos(tilt)
        square = curvature(tilt, lz, 0.5 * spin, weight)
        assert abs(found.omega - np.array([0.0, omega[1], spin])).max() < 1e-10
        assert abs(found.turning.values[2] - rate) < 1e-10
        assert gap(own_values(found), [-1j * np.sqrt(square), 1j * np.sqrt(square)]) < 1e-9
        assert found.origin.values.tolist()[2:] == ["momentum"] * 2 + ["symmetry"] * 2


def curvature(tilt, lz, l3, weight):
    """Return d2/dtilt2 of (L_z - L_3 cos)^2/(2 sin^2) + weight cos, by complex steps of d/dtilt."""
    x = tilt + 1e-30j
    gap = lz - l3 * np.cos(x)
    slope = gap * l3 / np.sin(x) - gap**2 * np.cos(x) / np.sin(x) ** 3 - weight * np.sin(x)
    return slope.imag / 1e-30


def test_staude_rotation_turns_about_the_vertical():
    scene = top((1.0, 1.5, 0.8), (0.2, 0.1, 0.3), omega=(0.5, 1.0, 8.0), attitude=(0.3, 0.5, 0.2))
    found = rm.linearise(scene)
    assert found.sizes["motion"] >= 4
    for k in range(found.sizes["motion"]):
        one = found.isel(motion=k)
        up = rotation.to_body(one.attitude.values, (0.0, 0.0, 1.0))
        w, rate = one.omega.values, one.turning.values[2]
        assert np.abs(w - rate * up).max() < 1e-10
        torque = -G * np.cross((0.2, 0.1, 0.3), up)
        assert np.abs(np.cross((1.0, 1.5, 0.8) * w, w) + torque).max() < 1e-9


SATELLITES = {  # moments along the axes x (outwards), y (along track), z (normal); DeBra-Delp
    "Lagrange": ((1.0, 2.0, 2.5), "elliptic"),
    "DeBra-Delp": ((0.65625, 1.0, 0.60625), "elliptic"),  # k1 = -0.6, k3 = -0.05
    "unstable pitch and more": ((2.45, 1.0, 1.2 * 2.45), "unstable"),
    "unstable pitch": ((2.0, 1.0, 2.5), "unstable"),
}


@pytest.mark.parametrize("name", SATELLITES)
def test_satellite_librates_as_hughes_says(name):
    (a, b, c), word = SATELLITES[name]
    n = 2.0
    pull = rm.GravityGradient(mu=n * n * 8.0, distance=2.0)
    start = rm.Start(omega=(0.0, 0.0, n))  # x along the radius, z along the normal
    found = rm.linearise(rm.Scene(rm.Body((a, b, c)), pull, start), starts=1).isel(motion=0)
    k1, k3 = (c - b) / a, (c - a) / b
    # pitch about the normal; roll and yaw: s^4 + (1 + 3 k3 + k1 k3) s^2 + 4 k1 k3 = 0, s in n
    pitch = np.sqrt(complex(-3.0 * (b - a) / c))
    squares = np.roots([1.0, 1.0 + 3.0 * k3 + k1 * k3, 4.0 * k1 * k3])
    others = np.sqrt(squares.astype(complex))
    true = n * np.array([pitch, -pitch, *others, *-others])
    assert gap(own_values(found), true) < 1e-10
    assert (found.stability.item() == "elliptic") == (word == "elliptic")
    assert (found.origin == "motion").all()


def counts(rng):
    """Return {name: (scene, its number of steady motions by theory)}, at random."""
    while (moments := rng.uniform(0.5, 1.4, 3)).sum() < 2.0 * moments.max():
        pass
    unit = 10.0 ** rng.uniform(-6.0, 6.0)
    omega, angles = rng.normal(size=3), tuple(rng.uniform(0.2, 2.8, 3))
    start = rm.Start(omega=tuple(omega), attitude=angles)
    free = rm.Body(tuple(moments * unit))
    wheel = rng.normal(size=3) * rng.uniform(0.02, 0.6)
    length, rate = rng.uniform(0.05, 0.25), 10.0 ** rng.uniform(-3.0, 1.0)
    pull = rm.GravityGradient(mu=8.0 * rate**2, distance=2.0, anomaly=rng.uniform(0.0, 6.0))
    hung = moments + np.array([1.0, 1.0, 0.0]) * length**2
    heavy = rm.Body(tuple(hung), mass=1.0, centre=(0.0, 0.0, length))
    up = rotation.to_body(rotation.from_euler(angles), (0.0, 0.0, 1.0))
    speed, fast = rng.uniform(0.2, 1.8) * np.sqrt(4.0 * G * 0.3) / 0.5, rng.uniform(-3.0, 3.0)
    slim, rest = rng.uniform(0.1, 1.9), rm.Start(omega=(0.0, 0.0, 0.0), attitude=angles)
    spun = rm.Start(omega=(0.1 * rate, 0.2 * rate, fast * rate), attitude=(0.3, 1.0, 0.2))
    gyrostat = rm.Scene(free, rm.Rotor(tuple(wheel * unit)), start)
    return {
        "free": (rm.Scene(free, start=start), 6),  # both senses of three axes
        "gyrostat": (gyrostat, gyrostat_count(moments, wheel, moments * omega + wheel)),
        "at rest": (rm.Scene(heavy, rm.Gravity(G), rest), 2),  # upright and hanging
        "Staude": (
            rm.Scene(heavy, rm.Gravity(G), start),
            staude_count(hung, G * length, up @ (hung * omega)),
        ),
        # upright, and below Lagrange's spin a precession with the same momenta
        "sleeping top": (top(omega=(0, 0, speed)), 1 + (0.25 * speed**2 < 4.0 * G * 0.3)),
        "precession": (top(omega=tuple(omega), attitude=(0.0, angles[1], 0.0)), 1),
        "orbit": (rm.Scene(free, pull, start), 24),  # Lagrange
        # Likins & Pringle: cylindrical, conical and hyperbolic, by the momentum of the spin
        "spinning satellite": (
            rm.Scene(rm.Body((1.0, 1.0, slim)), pull, spun),
            2 + 2 * (abs(fast * slim) < abs(3.0 * slim - 4.0)) + 2 * (abs(fast * slim) < 1.0),
        ),
    }  # fmt: skip


def gyrostat_count(moments, wheel, whole):
    """Return how many rotations have w = h/(s - I) and |s w| = L: s is a real root."""
    s = np.poly1d([1.0, 0.0])
    squares = [np.poly1d([1.0, -i]) ** 2 for i in moments]
    total = squares[0] * squares[1] * squares[2] * -float(whole @ whole)
    for h, j, k in zip(wheel, (1, 2, 0), (2, 0, 1), strict=True):
        total = total + s * s * squares[j] * squares[k] * float(h * h)
    return int((np.abs(total.roots.imag) < 1e-7 * np.abs(total.roots)).sum())


def staude_count(moments, weight, lz):
    """Return how many rotations about the vertical have L_z, with the centre of mass on axis 3: two
    along it, and two for each u_3 = c with weight (I_j + d c^2)^2 = d L_z^2 c, d = I_3 - I_j."""
    found = 2
    for j in (0, 1):
        d = moments[2] - moments[j]
        wanted = weight * np.poly1d([d, 0.0, moments[j]]) ** 2 - np.poly1d([d * lz * lz, 0.0])
        real = wanted.roots[np.abs(wanted.roots.imag) < 1e-9].real
        found += 2 * int((np.abs(real) < 1.0).sum())
    return found


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 40))]
)
def test_search_finds_as_many_motions_as_theory_counts(seed):
    for name, (scene, count) in counts(np.random.default_rng([seed, 3])).items():
        found = rm.linearise(scene)
        assert found.sizes["motion"] == count, name
        assert found.reached.min() >= 2, name  # measured 3 of 256, for one of the 24 on an orbit
        if name == "orbit":  # of six orientations one is Lagrange's, another may be DeBra-Delp's
            assert (found.full_motion == "stable").sum() == 4


def test_damping_makes_spirals_and_nodes():
    free = rm.Start(omega=(0.1, 0.2, 0.3), attitude=(0.0, 2.8, 0.0))
    body = rm.Body((1.0, 1.0, 0.5), mass=1.0, centre=(0.0, 0.0, 0.3))
    for rate, word in ((0.5, "stable spiral"), (50.0, "stable node")):
        scene = rm.Scene(body, (rm.Gravity(G), rm.ViscousDamping(rate)), free)
        found = rm.linearise(scene)
        hanging = found.isel(motion=int(found.energy.argmin("motion")))
        roots = np.roots([1.0, rate, G * 0.3])
        assert gap(own_values(hanging), [*roots, *roots, -rate]) < 1e-9
        assert hanging.stability.item() == word


@pytest.mark.parametrize("arm", ((0.0, 0.0, 0.0), (0.0, 0.0, 0.3)))
def test_rest_under_quadratic_drag_is_not_decided_by_the_linear_motion(arm):
    """Its damping vanishes at rest, and Newton's method only halves the distance to it."""
    start = rm.Start(omega=(0.3, 1.0, 8.0), attitude=(0.3, 2.8, 0.2))
    body = rm.Body((1.0, 1.5, 0.8), mass=1.0, centre=arm)
    found = rm.linearise(rm.Scene(body, (rm.Gravity(G), rm.QuadraticDrag(0.5)), start))
    rest = found.isel(motion=int(found.energy.argmin("motion")))
    assert abs(rest.omega).max() < 1e-6
    assert (rest.stability.item(), rest.full_motion.item()) == ("undecided", "unknown")
    assert (abs(rest.growth) < 1e-9).all()


def test_words_for_the_full_motion_follow_from_the_energy():
    """A gyroscopic motion is only elliptic: at its saddle of the energy, damping lets it go."""
    for name, word in (("Lagrange", "stable"), ("DeBra-Delp", "unknown")):
        n, (moments, _) = 2.0, SATELLITES[name]
        pull = rm.GravityGradient(mu=n * n * 8.0, distance=2.0)
        start = rm.Start(omega=(0.0, 0.0, n))
        found = rm.linearise(rm.Scene(rm.Body(moments), pull, start), starts=1).isel(motion=0)
        assert (found.stability.item(), found.full_motion.item()) == ("elliptic", word)
    critical = np.sqrt(4.0 * G * 0.3) / 0.5
    for spin, word in ((1.01 * critical, "stable"), (0.99 * critical, "unstable")):
        found = rm.linearise(top(omega=(0.0, 0.0, spin)), starts=1)
        assert found.full_motion[0].item() == word
    free = rm.linearise(rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.1, 3.0, 0.2))))
    unstable = abs(free.omega.sel(axis=2)) > 1.0
    assert (free.full_motion == np.where(unstable, "unstable", "stable")).all()


def test_torques_of_a_potential_and_no_others_are_hamiltonian():
    field, start = (0.3, 0.1, 0.2), rm.Start(omega=(0.3, 1.0, 2.0), attitude=(0.3, 0.5, 0.2))
    body = rm.Body((1.0, 1.5, 0.8), mass=1.0, centre=(0.0, 0.0, 0.1))
    for effects, is_hamiltonian in (
        ((rm.Gravity(G), rm.Rotor((0.1, 0.2, 0.3))), True),
        ((rm.SpaceTorque(field),), False),  # constant in space: its work depends on the way
        ((rm.BodyTorque(field),), False),
        ((rm.Gravity(G), rm.ViscousDamping(1e-9)), False),
        ((rm.QuadraticDrag(0.5),), False),
    ):
        known, *_ = system.mechanics_of(rm.Scene(body, effects, start).model, rm.Run(), 0)
        assert find_symmetries(known).is_hamiltonian == is_hamiltonian


def test_sphere_and_rest_have_nothing_but_symmetries():
    for body, omega in (((1.0, 1.0, 1.0), (0.1, 0.2, 0.3)), ((1.0, 2.0, 2.5), (0.0, 0.0, 0.0))):
        found = rm.linearise(rm.Scene(rm.Body(body), start=rm.Start(omega=omega)), starts=4)
        assert found.stability.values.tolist() == ["neutral"]
        assert not (found.origin == "motion").any()
        assert np.isnan(found.growth_rate).all()


def test_eigenvectors_belong_to_their_eigenvalues():
    scene = top((1.0, 1.5, 0.8), (0.2, 0.1, 0.3), omega=(0.5, 1.0, 8.0), attitude=(0.3, 0.5, 0.2))
    problem = Problem.of(scene.model, scene.run)
    motion = problem.solved(problem.starts(1))[0]
    j = jacobians(motion.system, motion.state)[0]
    own = motion.linear.origins.count("motion")
    values, vectors = motion.linear.values[:own], motion.linear.vectors[:, :own]
    assert own == 4
    assert np.abs(j @ vectors - vectors * values).max() < 1e-12
    # the trace of a flow that conserves volume is 0; the derivatives are exact, not differences
    assert abs(np.trace(j)) < 1e-13


def test_start_and_member_choose_the_motion():
    start = rm.Start(omega=(0.0, rm.uniform(1.0, 2.0), 0.01))
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=start)
    found = [rm.linearise(scene, starts=1, first=member) for member in (0, 7)]
    rates_of_members = [float(one.growth_rate[0]) for one in found]
    spins = members_at_start(scene.model, scene.run, 0, 8)[1]["start_omega"]
    spins = np.sqrt(((spins.T * np.array([1.0, 2.0, 2.5])) ** 2).sum(1)) / 2.0
    true = spins[[0, 7]] * np.sqrt(0.5 / 2.5)
    assert np.abs(rates_of_members - true).max() < 1e-12


@pytest.mark.slow
def test_sleeping_top_wakes_by_a_hamiltonian_hopf_bifurcation():
    scene, critical = top(omega=(0.0, 0.0, 5.0)), np.sqrt(4.0 * G * 0.3) / 0.5
    found = rm.linearise(scene, along=("start.omega.3", 6.0, 7.6), points=6, starts=64)
    assert found.bifurcation_kind.values.tolist() == ["Hamiltonian Hopf"]
    assert found.bifurcation_value.values == pytest.approx([critical], rel=1e-9)  # measured 1e-10
    assert found.bifurcation_frequency.values == pytest.approx([critical * 0.75], rel=1e-4)
    assert found.growing.values.tolist() == [[2, 0]]
    assert found.bifurcation_meets.all()  # regular precession ends there
    text = "\n".join(table(found))
    assert "Hamiltonian Hopf of branch 0, which meets branch 1; frequency of its" in text
    assert "(of the --points, the last before its end at " in text
    figure = eigenvalues(found)  # a branch, a number
    assert {text.get_text() for text in figure.axes[0].texts} == {"0", "1"}


@pytest.mark.slow
def test_hanging_body_leaves_the_vertical_by_pitchforks_as_a_bead_on_a_hoop_does():
    moments, weight = np.array([1.0, 1.3, 0.4]), G * 0.3
    start = {"omega": (0.0, 0.0, 1.0), "attitude": (0.0, np.pi, 0.0)}
    scene = top(tuple(moments), **start)
    found = rm.linearise(scene, along=("start.omega.3", 1.0, 3.5), points=6, starts=64)
    # of a bead omega^2 = g/l; I_j - I_3 is its m l^2
    true = np.sort(np.sqrt(weight / (moments[:2] - moments[2])))
    assert found.bifurcation_kind.values.tolist() == ["pitchfork"] * 2
    assert found.bifurcation_value.values == pytest.approx(true, rel=1e-9)  # measured 2e-10
    assert found.bifurcation_meets.sum("branch").values.tolist() == [3, 3]
    assert (found.bifurcation_frequency == 0.0).all()
    figure = eigenvalues(found)  # two tilts to opposite sides have one energy
    assert "2, 3" in {text.get_text() for text in figure.axes[0].texts}


def test_picture_draws_motions_that_share_eigenvalues_once():
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.1, 3.0, 0.2)))
    axes = eigenvalues(rm.linearise(scene)).axes[0]
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names[0] == "symmetries and momenta"
    assert sorted(names[1:]) == ["elliptic, stable: 2 motions"] * 2 + ["saddle: 2 motions"]


def test_refusals_name_the_effect_the_parameter_and_the_rule():
    with pytest.raises(SceneError, match="periodic_torque changes with time"):
        rm.linearise("driven_pendulum")
    with pytest.raises(SceneError, match="eccentricity = 0"):
        rm.linearise("hyperion")
    with pytest.raises(SceneError, match=r"\[effects\] bath: noise separates"):
        rm.linearise("brownian_rotor")
    with pytest.raises(SceneError, match=r"did you mean 'start\.omega\.3'"):
        rm.linearise("heavy_top", along=("start.omega.4", 1.0, 2.0))
    with pytest.raises(OptionError, match="expected low < high"):
        rm.linearise("heavy_top", along="start.omega.3=2:1")


def test_a_body_in_other_axes_has_the_same_eigenvalues():
    turn = rotation.matrix(rotation.from_rotation_vector((0.3, 0.7, 1.1)))
    tensor = turn @ np.diag([1.0, 1.5, 0.8]) @ turn.T
    arm, omega = np.array([0.2, 0.1, 0.3]), np.array([0.5, 1.0, 8.0])
    plain = rm.linearise(top((1.0, 1.5, 0.8), tuple(arm), omega=tuple(omega)), starts=1)
    body = rm.Body.from_tensor(tensor, mass=1.0, centre=tuple(turn @ arm))
    attitude = tuple(rotation.quaternion_from_matrix(turn.T))
    start = rm.Start(omega=tuple(turn @ omega), attitude=attitude)
    turned = rm.linearise(rm.Scene(body, rm.Gravity(G), start), starts=1)
    assert gap(own_values(turned.isel(motion=0)), own_values(plain.isel(motion=0))) < 1e-9
    assert np.abs(turned.omega[0].values - turn @ plain.omega[0].values).max() < 1e-9


def test_newton_converges_quadratically_and_a_broken_jacobian_does_not(monkeypatch):
    scene = top((1.0, 1.5, 0.8), (0.2, 0.1, 0.3), omega=(0.5, 1.0, 8.0), attitude=(0.3, 0.5, 0.2))
    monkeypatch.setattr(steady, "MOST", 12)

    def left():
        problem = Problem.of(scene.model, scene.run)
        return steady.solve(problem.system, problem.starts(1), problem.held)[1][0]

    assert left() < 1e-14  # measured 2e-16
    right = system.rates_of

    def broken(*given):
        found = right(*given)
        return found._replace(slope=1.3 * found.slope)

    monkeypatch.setattr(steady, "rates_of", broken)
    assert left() > 1e-10


def test_the_picture_has_the_points_where_growth_ends():
    value, rate = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.9, 0.5, 0.0, 0.0])
    grows, onsets = rate > 0.0, np.array([2.3, 3.5, 9.0])  # the second changes no stability
    x, y, thin = _with_onsets(value, rate, grows, onsets)
    assert x.tolist() == [1.0, 2.0, 2.3, 3.0, 4.0] and y.tolist() == [0.9, 0.5, 0.0, 0.0, 0.0]
    assert thin.tolist() == [True, True, False, False, False]
    for broken in (np.full(4, np.nan), np.array([0.9, 0.5, np.nan, np.nan])):  # a branch ends
        assert _with_onsets(value, broken, broken > 0.0, onsets)[0].tolist() == value.tolist()

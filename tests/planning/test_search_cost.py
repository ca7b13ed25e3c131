"""A search for a tolerance costs no more than the run that it plans, and keeps its promise.

The cost is counted in evaluations of the torque, so no load of the machine changes it.
"""

import math

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import facts, is_random
from rigidmc.planning.tolerance import choose, deviation, pilot, search

TURN = 2.0 * math.pi / 2.2  # of a body that starts with about 2.2 rad/s


class Found:
    """A choice, or the reason for none, beside its cost relative to the limit."""

    def __init__(self, monkeypatch, scene, tolerance, **options):
        counters = []

        class Counted(pilot.Effort):
            def __init__(self):
                super().__init__()
                counters.append(self)

        monkeypatch.setattr(pilot, "Effort", Counted)
        self.scene, self.tolerance, self.choice, self.why = scene, tolerance, None, ""
        try:
            self.choice = choose.choose(scene, tolerance, **options)
        except SceneError as error:
            self.why = str(error)
        spent, run = sum(one.spent for one in counters), 0.0
        if self.choice is not None:
            way = self.choice.way
            cost = max(4, scene.known_integrators()[way.integrator].evaluations)
            run = scene.run.members * way.mean_steps * cost
        if self.choice is None:  # the run that half of which the search may cost
            run = max([one.limit / 0.8 for one in counters if math.isfinite(one.limit)], default=0)
        self.ratio = spent / max(run, search.FREE)

    def error(self, members=8):
        """Return the achieved error relative to the tolerance of members beyond the pilots, by
        another integrator in much shorter steps."""
        some = pilot.pilot(self.scene, members, 10_000)._replace(
            member_steps=self.choice.way.turn is not None
        )
        way = self.choice.way
        steps = way.steps
        if some.member_steps:
            steps = math.ceil(some.scene.run.t_end * some.rates.max() / way.turn)
        else:
            steps = some.base * math.ceil(steps / some.base)
        if way.integrator == "closed":
            return None
        mine = pilot.integrate_pilot(some, way.integrator, steps, way.dtype)
        least = pilot.first_steps(some)
        fine = some.base * math.ceil(max(4 * steps, 4 * least) / some.base)
        true = pilot.integrate_pilot(some, "rk8", fine, compensated=True)
        apart = deviation.errors(some, mine, true)["state"]
        return float(np.max(apart) / self.tolerance)


def scene_of(effects, turns, members, seed=1):
    start = rm.Start(
        omega=(rm.normal(0.3, 0.1), rm.normal(0.3, 0.1), rm.normal(2.1, 0.1)), attitude="uniform"
    )
    run = {"t_end": turns * TURN, "members": members, "seed": seed}
    # typical torques of 1 N m make light bodies chaotic within 100 turns
    moments = (0.6, 0.8, 1.0) if turns < 10.0 else (6e3, 8e3, 1e4)
    centre = (0.1, 0.2, 0.6) if isinstance(effects[0], rm.Gravity) else (0.0, 0.0, 0.0)
    body = rm.Body.from_moments(moments, mass=1.0, centre=centre)
    return rm.Scene(body, effects, start).with_run(**run, save=("omega", "attitude"))


DAMPED = (rm.Gravity(0.01), rm.ViscousDamping(1e-4))


@pytest.mark.parametrize("turns", [100.0, 1000.0])
def test_a_search_costs_at_most_the_run(monkeypatch, turns):
    """cf4 is the only other method that takes damping: the reference took 16 times its steps."""
    scene = scene_of(DAMPED, turns, 50)
    found = Found(monkeypatch, scene, 1e-6, integrators=("rk4", "rk8"))
    assert found.choice is not None, found.why
    assert 1e-4 < found.ratio < 1.0, found.ratio
    assert found.error() < 1.0
    assert bool(found.choice.pilots) == (turns == 1000.0)


def registered():
    """Every effect with a torque and no noise, three lengths of time, and other tolerances."""
    chance = np.random.default_rng(5)
    kinds = [kind for kind in EFFECTS.values() if facts(kind).example and not is_random(kind)]
    for kind in kinds:
        for turns in (1.0, 100.0, 10_000.0):
            members = int(chance.choice([1, 50, 300 if turns > 100.0 else 3000]))
            yield kind, turns, members, float(10.0 ** chance.uniform(-9.0, -4.0))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "turns", "members", "tolerance"), list(registered()))
def test_every_effect_over_all_times(monkeypatch, kind, turns, members, tolerance):
    scene = scene_of((kind(*facts(kind).example),), turns, members).with_run(integrator="rk8")
    found = Found(monkeypatch, scene, tolerance)
    error = found.choice and found.error()
    way = found.choice and found.choice.way.with_precision()
    name = f"{kind.__name__} {turns:g} turns, {members} members, {tolerance:.1e}"
    print(f"{name}: cost {found.ratio:.2g}, error {error}, {way} {found.why[:200]}")
    assert found.ratio < 1.0
    assert error is None or error < 1.0


def test_a_state_without_attitude_has_no_error_and_no_warning():
    """Long steps may end in numbers whose squares overflow."""
    q = np.array([[1.0, 0.0, 0.0, 0.0], [1e200] * 4, [math.nan] * 4, [0.0] * 4]).T
    for pair in ((q, q[:, :1].repeat(4, 1)), (q[:, :1].repeat(4, 1), q)):
        with np.errstate(over="ignore"):
            turned = deviation._turned(*pair)
        assert turned[0] == 0.0 and np.isnan(turned[1:]).all()

"""Names of earlier versions, of public objects and of users' own parts, are refused with the new.

Until 1.0: then the tables of old words go, and this file with them.
"""

import importlib
from dataclasses import dataclass
from typing import Any, NamedTuple

import pytest

import rigidmc as rm
from rigidmc import protocols
from rigidmc.physics.dynamics.trials import OLD_ARGUMENTS
from rigidmc.physics.effects import protocol as effects
from rigidmc.physics.integrators import protocol as integrators
from rigidmc.physics.observables import protocol as observables
from rigidmc.scene import scene
from rigidmc.scene.vector_distributions.protocol import OLD_WORDS

BODY = rm.Body.from_moments((1.0, 1.4, 2.0))
RUN = {"dt": 0.1, "t_end": 1.0}
OUTPUTS = {"own": ("1", "own", ())}


class Weight(NamedTuple):
    """An effect as it is written now."""

    size: float = 1.0

    def torque(self, q):
        return self.size * q[1], 0.0, 0.0


class Step(NamedTuple):
    """An integrator as it is written now; its facts follow."""

    order, evaluations, is_reversible, conserves = 1, 0, True, ("|q|", "|L|^2", "T")
    accepts, compensated = "no torque", False

    def step(self, q, l):
        return q, l


class First(NamedTuple):
    """A running observable as it is written now, but for its decorator."""

    def begin(self, l):
        return (l[0],)

    def update(self, state):
        return state

    def results(self, state, steps):
        return {"own": state[0]}


def with_word(base, word):
    """A class with one more fact, of which no more than the name counts."""
    return type("Own", (base,), {word: 1.0})


@pytest.mark.parametrize("old", effects.OLD_WORDS)
def test_old_words_of_effects(old):
    scene = rm.Scene(BODY, with_word(Weight, old)(), rm.Start(omega=(0.1, 1.0, 0.0)))
    with pytest.raises(rm.SceneError, match=rf"Own.{old}: is now called {effects.OLD_WORDS[old]}"):
        rm.prepare(scene, **RUN)
    with pytest.raises(TypeError, match=f"{old} is now called {effects.OLD_WORDS[old]}"):
        effects.effect(**{old: True})


def test_an_effect_with_nothing_but_an_old_word():
    own = type("Own", (tuple,), {"_fields": (), "shake": lambda self, l: l})()
    with pytest.raises(rm.SceneError, match="is now called add_noise"):
        rm.prepare(rm.Scene(BODY, own), **RUN)


@pytest.mark.parametrize("old", integrators.OLD_WORDS)
def test_old_words_of_integrators(old):
    own = with_word(Step, old)()
    with pytest.raises(rm.SceneError, match=f"is now called {integrators.OLD_WORDS[old]}"):
        rm.prepare(rm.Scene(BODY), own, **RUN)


@pytest.mark.parametrize("old", observables.OLD_WORDS)
def test_old_words_of_observables(old):
    own = observables.running(state_size=1, outputs=OUTPUTS)(with_word(First, old))
    with pytest.raises(rm.SceneError, match=f"is now called {observables.OLD_WORDS[old]}"):
        rm.prepare(rm.Scene(BODY), save=(own(),), **RUN)
    with pytest.raises(TypeError, match=f"{old} is now called {observables.OLD_WORDS[old]}"):
        observables.running(outputs=OUTPUTS, **{old: 1})


@pytest.mark.parametrize(("old", "new"), OLD_ARGUMENTS.items())
def test_old_arguments(old, new):
    if old == "kept":
        names = {"update": eval(f"lambda self, {old}: {old}")}
        own = observables.running(state_size=1, outputs=OUTPUTS)(type("Own", (First,), names))
        some, named = (), {"save": (own(),)}
    else:
        own = type("Own", (Step,), {"step": eval(f"lambda self, {old}, q, l: (q, l)")})
        some, named = (own(),), {}
    with pytest.raises(rm.SceneError, match=rf"unknown argument '{old}'.*did you mean '{new}'"):
        rm.prepare(rm.Scene(BODY), *some, **named, **RUN)


LINE = type(
    "Line", (protocols.VectorDistribution,), {"size": 1.0, "__annotations__": {"size": Any}}
)


@pytest.mark.parametrize("old", OLD_WORDS)
def test_old_words_of_distributions(old):
    own = dataclass(frozen=True)(type("Own", (LINE,), {old: ("omega",), "__annotations__": {}}))
    with pytest.raises(rm.SceneError, match=rf"Own.{old}: is now called {OLD_WORDS[old]}"):
        rm.Start(omega=own())


@pytest.mark.parametrize(("value", "old"), [
    (value, old) for value in (BODY, rm.Start(omega=(0.0, 0.0, 1.0))) for old in value._OLD_NAMES
])  # fmt: skip
def test_old_names_of_bodies_and_starts(value, old):
    new, kind = value._OLD_NAMES[old], type(value).__name__
    assert hasattr(value, new)
    with pytest.raises(AttributeError, match=f"{kind}.{old} is now called {new}"):
        getattr(value, old)


@pytest.mark.parametrize("old", scene._GONE)
def test_what_a_scene_had(old):
    with pytest.raises(AttributeError, match=f"Scene.{old} was removed: "):
        getattr(rm.Scene(BODY), old)


@pytest.mark.parametrize("old", rm._OLD_NAMES)
def test_old_names_of_the_package(old):
    new = rm._OLD_NAMES[old]
    assert hasattr(rm, new) and old not in dir(rm)
    with pytest.raises(ImportError, match=f"rigidmc.{old} is now called rigidmc.{new}"):
        getattr(rm, old)


@pytest.mark.parametrize(("old", "new"), protocols._OLD.items())
def test_old_names_of_functions(old, new):
    assert hasattr(protocols, new)
    with pytest.raises(ImportError, match=f"{old} is now called {new}"):
        getattr(importlib.import_module("rigidmc.protocols"), old)


def test_new_words_are_taken():
    scene = rm.Scene(BODY, (), rm.Start(omega=(0.1, 1.0, 0.0)))
    own = observables.running(state_size=1, outputs=OUTPUTS)(First)
    rm.prepare(scene, save=(own(),), **RUN)
    with pytest.raises(AttributeError, match="no attribute 'down'"):
        _ = protocols.down

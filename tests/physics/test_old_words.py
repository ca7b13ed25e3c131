"""Names of earlier versions, of public objects and of users' own parts, are refused with the new.

Until 1.0: then the tables of old words go, and this file with them.
"""

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


def running(kind, **facts):
    return observables.running(**{"state_size": 1, "outputs": OUTPUTS} | facts)(kind)


def prepared(*effects, integrator=None, save=None):
    scene = rm.Scene(BODY, effects, rm.Start(omega=(0.1, 1.0, 0.0)))
    more = {"integrator": integrator, "save": save}
    return rm.prepare(scene, **RUN, **{k: x for k, x in more.items() if x is not None})


def argued(old):
    """Prepare a scene with a part whose method names an old argument."""
    if old == "kept":
        kind = type("Own", (First,), {"update": eval(f"lambda self, {old}: {old}")})
        return prepared(save=(running(kind)(),))
    step = eval(f"lambda self, {old}, q, l: (q, l)")
    return prepared(integrator=type("Own", (Step,), {"step": step})())


LINE = type(
    "Line", (protocols.VectorDistribution,), {"size": 1.0, "__annotations__": {"size": Any}}
)


def started(old):
    own = dataclass(frozen=True)(type("Own", (LINE,), {old: ("omega",), "__annotations__": {}}))
    return rm.Start(omega=own())


def rows():
    """Yield (what is refused, its error, its words) for each old word."""
    for old, new in effects.OLD_WORDS.items():
        own = with_word(Weight, old)()
        yield lambda own=own: prepared(own), rm.SceneError, rf"Own.{old}: is now called {new}"
        one = lambda old=old: effects.effect(**{old: True})  # noqa: E731
        yield one, TypeError, f"{old} is now called {new}"
    alone = type("Own", (tuple,), {"_fields": (), "shake": lambda self, l: l})()
    yield lambda: prepared(alone), rm.SceneError, "is now called add_noise"
    for old, new in integrators.OLD_WORDS.items():
        own = with_word(Step, old)()
        yield lambda own=own: prepared(integrator=own), rm.SceneError, f"is now called {new}"
    for old, new in observables.OLD_WORDS.items():
        own = running(with_word(First, old))()
        yield lambda own=own: prepared(save=(own,)), rm.SceneError, f"is now called {new}"
        one = lambda old=old: observables.running(outputs=OUTPUTS, **{old: 1})  # noqa: E731
        yield one, TypeError, f"{old} is now called {new}"
    for old, new in OLD_ARGUMENTS.items():
        words = rf"unknown argument '{old}'.*did you mean '{new}'"
        yield lambda old=old: argued(old), rm.SceneError, words
    for old, new in OLD_WORDS.items():
        yield lambda old=old: started(old), rm.SceneError, rf"Own.{old}: is now called {new}"
    for value in (BODY, rm.Start(omega=(0.0, 0.0, 1.0))):
        for old, new in value._OLD_NAMES.items():
            assert hasattr(value, new)
            words = f"{type(value).__name__}.{old} is now called {new}"
            yield lambda value=value, old=old: getattr(value, old), AttributeError, words
    for old in scene._GONE:
        one = lambda old=old: getattr(rm.Scene(BODY), old)  # noqa: E731
        yield one, AttributeError, f"Scene.{old} was removed: "
    for old, new in rm._OLD_NAMES.items():
        assert hasattr(rm, new) and old not in dir(rm)
        words = f"rigidmc.{old} is now called rigidmc.{new}"
        yield lambda old=old: getattr(rm, old), ImportError, words
    for old, new in protocols._OLD.items():
        assert hasattr(protocols, new)
        yield lambda old=old: getattr(protocols, old), ImportError, f"{old} is now called {new}"


@pytest.mark.parametrize(("refused", "error", "words"), [*rows()])
def test_old_words_are_refused_with_the_new(refused, error, words):
    with pytest.raises(error, match=words):
        refused()


def test_new_words_are_taken():
    prepared(save=(running(First)(),))
    with pytest.raises(AttributeError, match="no attribute 'down'"):
        _ = protocols.down

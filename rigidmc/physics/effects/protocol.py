"""The protocol of effects: methods and facts, with a default for each missing one.

A parameter of an effect is a number, or a vector if the class states its length in `shapes`. The
last functions turn effects into rows of numbers, in the order of their fields, and back: in a block
each number of each member is a row.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from math import inf
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, TypeGuard, TypeVar, overload

from rigidmc.errors import hint_of, nearest
from rigidmc.physics.dynamics.methods import argument_names, implements, method
from rigidmc.physics.dynamics.so3 import axpy

# Types of parameters: a float, or in a scene an array with one value per member, or a distribution
# such as rigidmc.normal(mean, deviation); a vector is a tuple of these.
Number: TypeAlias = Any
Vector: TypeAlias = Any

Kind = TypeVar("Kind", bound=type)


class Effect(Protocol):
    """A NamedTuple whose fields are its parameters, with one or more of these methods::

        torque(self, [body, t, q, l])       torque on the body, principal axes [N m]
        kick(self, [body, t, h, q, l])      L after its flow over h; splittings need it if the
                                            torque depends on L
        torque_rate(self, [body, t, q, w])  rate of change of the torque while the body turns with
                                            w; chin4 needs it
        add_noise(self, [body, h, l])       L after friction and noise over h; the field `noise`
                                            holds three normal deviates, new ones for each step
        noise_score(self, [body, h, l])     derivatives of ln p by each parameter, with the density
                                            p of L after `add_noise`; l is L before
        energy(self, [body, q])             potential energy [J]
        energy_scale(self, [body])          a bound on |potential energy| [J], or the energy that a
                                            torque without a potential may bring
        slip(self, [body, t, q, l])         angular velocity of the body beyond I^-1 L [rad/s], in
                                            the principal axes, if parts inside hold momentum; for
                                            rk8 and cf4
        add_torque(self, [body, t, q, l, by, onto])  onto + by * torque, if this is cheaper than
                                            `torque`
        state_rate(self, [body, t, q, l])   rates of change of the fields `state`, one number for
                                            each of their numbers
        sample(self, [body, t, q, l, noise])  the fields `memory` after a sample, one number for
                                            each of their numbers; noise holds six normal deviates

    body, q, l : MassProperties, attitude, angular momentum in the principal axes [kg m^2/s]
    t, h, w : time [s], time step [s], angular velocity in the principal axes [rad/s]

    A method names the arguments it depends on and no others
    (`rigidmc.physics.dynamics.methods`). The decorator `effect` states its facts, see
    `EffectFacts`. Two optional members depend on the parameters: the property `conservative` is
    true if the energy of the body is conserved (default: if there is an `energy`), and
    `is_driving(self)` returns whether a damping drives the body instead.
    """

    _fields: ClassVar[tuple[str, ...]]
    _field_defaults: ClassVar[dict[str, Any]]

    def __init__(self, *parameters: Any, **named: Any) -> None: ...

    def __iter__(self) -> Iterator[Any]: ...


# Former names of methods and facts, and their present names; until 1.0.
OLD_WORDS = {
    "impel": "add_torque", "shake": "add_noise", "drives": "is_driving", "damps": "is_damping",
    "keeps_l2": "conserves_l2", "keeps_lz": "conserves_lz", "stochastic": "is_random",
}  # fmt: skip


class EffectFacts(NamedTuple):
    """Facts of a class of effects, from `@effect(...)` or class attributes, with defaults.

    units : of each parameter, "1" if it has none
    shapes : length of each parameter that is a vector
    limits : (least, largest) of each parameter
    in_body : parameters fixed in the body, vectors or symmetric tensors (xx, yy, zz, yz, zx, xy):
        turned from the axes of the scene into the principal axes of each member
    along_axes : parameters with one number for each principal axis, which no turn can express in
        other axes; refused, unless 0, for a body that is described in other axes
    hidden : parameters that the engine fills in, not the user
    shared : hidden parameters copied from another kind of effect in the scene, as
        {"wheel": ("rotor", "momentum")}; the sum over several effects, the default if there is none
    example : parameters of a typical effect, used by the tests
    switches : parameters that are times at which the torque jumps or has a kink; steps end there
    state : parameters that move along with the body by `state_rate`; a scene gives their values at
        the start, and all methods read their values now
    every : the parameter that is the time between two samples [s], "" for none
    after : the parameter that is the time of the first sample [s], "" for 0
    memory : parameters that `sample` writes, constant from sample to sample; a scene gives their
        values before the first
    commands : what memories command, {field: (word of a kind of effect, its field)}: of a vector
        one number for each effect of that kind, first to last, or a whole vector for one
    is_random : whether it needs noise
    is_damping : whether it drives the body if its parameters are negative
    conserves_l2 : whether it conserves |L|
    conserves_lz : whether it conserves L_z
    isotropic : whether it singles out no axis of the body, and no direction but the vertical
    kick_order : order of the rule in `kick`, inf if `kick` is the exact flow
    """

    units: dict[str, str] = {}
    shapes: dict[str, int] = {}
    limits: dict[str, tuple[float, float]] = {}
    in_body: tuple[str, ...] = ()
    along_axes: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    shared: dict[str, tuple[str, str]] = {}
    example: tuple[Any, ...] = ()
    switches: tuple[str, ...] = ()
    state: tuple[str, ...] = ()
    every: str = ""
    after: str = ""
    memory: tuple[str, ...] = ()
    commands: dict[str, tuple[str, str]] = {}
    is_random: bool = False
    is_damping: bool = False
    conserves_l2: bool = False
    conserves_lz: bool = False
    isotropic: bool = False
    kick_order: float = inf


@overload
def effect(cls: Kind, /) -> Kind: ...


@overload
def effect(**stated: Any) -> Callable[[Kind], Kind]: ...


def effect(cls: Any = None, /, **stated: Any) -> Any:
    """Return the decorator that sets some EffectFacts as attributes of a class of effects.

    `@effect` alone states none.
    """
    for name in stated:
        if name in OLD_WORDS:
            raise TypeError(f"@effect: {name} is now called {OLD_WORDS[name]}")
        if name not in EffectFacts._fields:
            known = ", ".join(EffectFacts._fields) + hint_of(nearest(name, EffectFacts._fields))
            raise TypeError(f"@effect: no such fact '{name}'; known: {known}")

    def put(cls: Kind) -> Kind:
        for name, value in stated.items():
            if name in getattr(cls, "_fields", ()):
                rule = f"has a parameter '{name}', which the fact {name} would hide: rename it"
                raise TypeError(f"@effect: {cls.__name__} {rule}")
            setattr(cls, name, value)
        if stated.get("hidden"):
            cls.__repr__ = _shown  # type: ignore[assignment, method-assign]
        return cls

    return put if cls is None else put(cls)


def _shown(effect: Any) -> str:
    """Show an effect as a NamedTuple does, without the parameters that the engine fills in."""
    given = (name for name in effect._fields if name not in effect.hidden)
    words = ", ".join(f"{name}={getattr(effect, name)!r}" for name in given)
    return f"{type(effect).__name__}({words})"


def facts(effect: Effect | type[Effect]) -> EffectFacts:
    """Return the facts of an effect or of its class, with defaults for missing ones."""
    cls = effect if isinstance(effect, type) else type(effect)
    # cached: a run of few members asks 74 times, at 2.6 us each 0.2 ms of its 5 ms; a user may
    # change the facts of a custom class
    return (_facts if cls.__module__.startswith("rigidmc.") else _facts.__wrapped__)(cls)


@cache
def _facts(cls: type[Effect]) -> EffectFacts:
    stated = {name for name in EffectFacts._fields if hasattr(cls, name)} - {*cls._fields}
    facts = EffectFacts(**{name: getattr(cls, name) for name in stated})
    times = *facts.switches, *filter(None, (facts.every, facts.after))
    return facts._replace(units={**dict.fromkeys(times, "s"), **facts.units})


# Methods that decide a motion, and so which of its numbers it needs.
ACTING = "torque", "kick", "add_noise", "sample"  # an effect has one of these
DECIDING = "torque", "kick", "energy", "slip", "state_rate", "sample"


def is_effect(value: object) -> TypeGuard[Effect]:
    """Return whether a value is an effect: a NamedTuple instance with a method that acts."""
    # `shake` is the former name of `add_noise`: a later check rejects the class and gives the name
    acts = any(implements(value, verb) for verb in (*ACTING, "shake"))
    return acts and isinstance(value, tuple) and hasattr(value, "_fields")


def is_random(effect: Effect | type[Effect]) -> bool:
    """Return whether an effect needs noise."""
    return facts(effect).is_random


def takes_noise(effect: Effect | type[Effect]) -> bool:
    """Return whether the engine fills in the field `noise`.

    In an effect that is not random, `noise` is a parameter like any other.
    """
    cls = effect if isinstance(effect, type) else type(effect)
    return "noise" in cls._fields and is_random(cls)


def is_conservative(effect: Effect) -> bool:
    """Return whether kinetic plus potential energy is conserved under an effect."""
    if implements(effect, "conservative"):
        # the property is optional, so the Protocol does not have it
        return bool(effect.conservative)  # type: ignore[attr-defined]
    return implements(effect, "energy")


def depends_on_momentum(effect: Effect | type[Effect]) -> bool:
    """Return whether the torque depends on L, or the effect has its own `kick`.

    Such a kick is not L + h torque(q, t); nor is one with a state, which moves meanwhile.
    """
    is_flow = has_state(effect) or implements(effect, "kick")
    return is_flow or "l" in argument_names(effect, "torque")


def has_memory(effect: Effect | type[Effect]) -> bool:
    """Return whether parameters of an effect are written at samples."""
    return bool(facts(effect).memory)


def has_state(effect: Effect | type[Effect]) -> bool:
    """Return whether parameters of an effect move along with the body."""
    return bool(facts(effect).state)


@method
def torque(effect, body, t, q, l):
    """Return the torque of an effect, principal axes [N m]."""
    return 0.0, 0.0, 0.0


@method
def energy(effect, body, q):
    """Return the potential energy of an effect [J]."""
    return 0.0


@method
def energy_scale(effect, body):
    """Return a bound on |potential energy| [J], by arithmetic that also works on arrays."""
    return 0.0


@method
def kick(effect, body, t, h, q, l):
    """Return L after the flow of an effect over h.

    The default is exact if the torque depends on q alone.
    """
    return axpy(l, h, torque(effect, body, t, q, l))


@method
def state_rate(effect, body, t, q, l):
    """Return the rates of change of the state of an effect; () if it has none."""
    return ()


@method
def sample(effect, body, t, q, l, noise):
    """Return the memory of an effect after a sample; () if it has none.

    noise : six normal deviates, a function of seed, effect, member and number of the sample
    """
    return ()


@method
def add_torque(effect, body, t, q, l, by, onto):
    """Return onto + by * torque, component by component.

    An effect with a custom `add_torque` can multiply its parameters by `by` once, outside the loop
    over steps.
    """
    x, y, z = torque(effect, body, t, q, l)
    return onto[0] + by[0] * x, onto[1] + by[1] * y, onto[2] + by[2] * z


@method
def add_noise(effect, body, h, l):
    """Return L after the friction and noise of an effect over h."""
    return l


@method
def noise_score(effect, body, h, l):
    """Return d ln p/dx for each parameter x, with the density p of L after `add_noise` from l.

    () if the effect does not have it.
    """
    return ()


@method
def slip(effect, body, t, q, l):
    """Return the angular velocity beyond I^-1 L, principal axes [rad/s]; () if there is none."""
    return ()


@method
def torque_rate(effect, body, t, q, w):
    """Return the rate of change of the torque at fixed t while the body turns with w.

    Both vectors are in the principal axes.
    """
    return 0.0, 0.0, 0.0


class NoEffect(NamedTuple):
    """An effect that does nothing, in place of one that is left out."""

    def kick(self, l):
        return l


def masked_effects(effects, mask):
    """Return the effects, with NoEffect in each place where `mask` has OFF."""
    if len(effects) == 0:
        return ()
    if len(mask[0]) == 0:
        return (NoEffect(),) + masked_effects(effects[1:], mask[1:])
    return effects[:1] + masked_effects(effects[1:], mask[1:])


def shape(cls: Effect | type[Effect], field: str) -> int | None:
    """Return the length of a parameter, None for a scalar."""
    return facts(cls).shapes.get(field)


def user_parameters(cls: Effect | type[Effect]) -> tuple[str, ...]:
    """Return the parameters that a user gives; the engine fills in the hidden ones."""
    return tuple(field for field in cls._fields if field not in facts(cls).hidden)


def numbers(effect: Effect) -> list[tuple[str, int | None, Any]]:
    """Return [(field, component, value)] of an effect's numbers; component is None for scalars."""
    values: list[tuple[str, int | None, Any]] = []
    for field, value in zip(effect._fields, effect, strict=True):
        size = shape(effect, field)
        values += (
            [(field, None, value)] if size is None else [(field, i, value[i]) for i in range(size)]
        )
    return values


def parameter_count(*effects: Effect) -> int:
    """Return the total number of numbers in some effects."""
    return sum(shape(e, field) or 1 for e in effects for field in e._fields)


def from_numbers(cls: type[Effect], values: Iterable[Any]) -> Any:
    """Return an effect of a class from a sequence of numbers, each a float, array or stand-in."""
    left = iter(values)
    fields = []
    for field in cls._fields:
        size = shape(cls, field)
        fields.append(next(left) if size is None else tuple(next(left) for _ in range(size)))
    return cls(*fields)


def blank(effects: Iterable[Effect]) -> tuple[Any, ...]:
    """Return the effects with all numbers 0: the types that a kernel is compiled for."""
    return tuple(from_numbers(type(e), [0.0] * parameter_count(e)) for e in effects)

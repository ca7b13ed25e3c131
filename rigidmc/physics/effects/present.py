"""The numbers of effects that change along a run: states, which move, and memories, which are
written at samples.

Both are parameters of an effect: a scene gives their values at the start. Whatever evaluates
effects first puts the present numbers into them. Compiled, all of this only moves numbers, see
`rigidmc.engine.compiler.present`.
"""

from rigidmc.physics.dynamics.methods import word_of
from rigidmc.physics.effects.protocol import facts, shape


def states_of(effects):
    """Return the numbers of the states of all effects, one effect after the other."""
    return tuple(x for effect in effects for x in numbers_of(effect, facts(effect).state))


def memories_of(effects):
    """Return the numbers of the memories of all effects, one effect after the other."""
    return tuple(x for effect in effects for x in numbers_of(effect, facts(effect).memory))


def in_state(effects, states):
    """Return the effects in these states; numbers after the states are not read."""
    left = iter(states)
    return tuple(with_numbers(effect, facts(effect).state, left) for effect in effects)


def in_memory(effects, memories):
    """Return the effects with these memories, and actuators with what these command."""
    left = iter(memories)
    effects = [with_numbers(effect, facts(effect).memory, left) for effect in effects]
    for place, field, target, other, component in commands_of([type(e) for e in effects]):
        command = getattr(effects[place], field)
        value = command if component is None else command[component]
        effects[target] = effects[target]._replace(**{other: value})
    return tuple(effects)


def numbers_of(effect, fields):
    """Return the numbers of some fields of an effect, one after the other."""
    values = (getattr(effect, field) for field in fields)
    return tuple(x for value in values for x in (value if isinstance(value, tuple) else (value,)))


def with_numbers(effect, fields, left):
    """Return an effect with the next numbers of an iterator in some fields."""
    values = {}
    for field in fields:
        size = shape(effect, field)
        values[field] = next(left) if size is None else tuple(next(left) for _ in range(size))
    return effect._replace(**values) if values else effect


def commands_of(classes):
    """Return (place, field, place of the actuator, its field, component) of what effects of these
    classes command; component is None for a whole field.

    A vector commands one number of each actuator of its kind, first to last, or a vector of one.
    """
    words, found = [word_of(cls) for cls in classes], []
    for place, cls in enumerate(classes):
        for field, (word, other) in facts(cls).commands.items():
            targets = [i for i, known in enumerate(words) if known == word]
            is_whole = bool(targets) and shape(cls, field) == shape(classes[targets[0]], other)
            for component, target in enumerate(targets):
                found.append((place, field, target, other, None if is_whole else component))
    return found

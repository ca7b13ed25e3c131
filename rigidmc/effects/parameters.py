"""The parameters of effects: numbers and vectors of numbers, in the order of the fields.

A class tells in `shapes` how many numbers a field has that is a vector; in a block each number is a row.
"""


def shape(kind, field):
    """How many numbers a field of an effect is, None for a plain number."""
    return getattr(kind, "shapes", {}).get(field)


def given(kind):
    """The fields of an effect that a user gives; what is hidden the kernel fills in."""
    return tuple(field for field in kind._fields if field not in getattr(kind, "hidden", ()))


def numbers(effect):
    """[(field, component, value)] of all numbers of an effect; component is None for a plain one, else 0, 1, ..."""
    found = []
    for field, value in zip(effect._fields, effect, strict=True):
        size = shape(effect, field)
        found += (
            [(field, None, value)] if size is None else [(field, i, value[i]) for i in range(size)]
        )
    return found


def parameter_count(*effects):
    """How many numbers some effects have."""
    return sum(shape(e, field) or 1 for e in effects for field in e._fields)


def filled(kind, values):
    """An effect of a class from its numbers in a row: plain ones, arrays, whatever stands for them."""
    left = iter(values)
    fields = []
    for field in kind._fields:
        size = shape(kind, field)
        fields.append(next(left) if size is None else tuple(next(left) for _ in range(size)))
    return kind(*fields)


def blank(effects):
    """The same effects with all numbers 0: what a kernel compiles, whose numbers are rows of a block."""
    return tuple(filled(type(e), [0.0] * parameter_count(e)) for e in effects)

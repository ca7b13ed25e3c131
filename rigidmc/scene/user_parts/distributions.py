"""A user's law, tried before anything is drawn from it: shapes, and that no draw depends on which
members are drawn with it."""

from typing import Any

import numpy as np

from rigidmc.errors import PartError, RigidmcError
from rigidmc.physics.dynamics.methods import implements
from rigidmc.scene.vector_distributions.protocol import Facts, Law

KEYS = ("omega", "momentum", "moments", "attitude")
_COUNT, _LATER = 5, 2  # members that are drawn, and the first of those that are drawn again


def check_user_law(law: Law, at: str) -> Law:
    """A user's law with its parameters checked; PartError with class, method and rule."""
    kind, key = type(law), at.rpartition(".")[2]

    def wrong(name: str, rule: str) -> PartError:
        return PartError.of(kind, rule, at, name)

    if implements(kind, "stand_in"):  # its code is not run
        return law
    if "__dataclass_fields__" not in vars(kind):
        raise wrong("", "expected a frozen dataclass: @dataclass(frozen=True) before its class")
    of = getattr(kind, "of", ())
    if not isinstance(of, tuple) or not of or not set(of) <= set(KEYS):
        raise wrong("of", f"is {of!r}, expected a tuple of some of {', '.join(KEYS)}")
    if key not in of:
        raise wrong("of", f"is a law of {' and '.join(of)}, not of {key}")
    try:
        checked = law.checked(f"{at}.{law.word}")
    except RigidmcError:
        raise
    except Exception as error:  # the user's code may raise anything
        raise wrong("checked", f"raises {type(error).__name__}: {error}") from None
    if type(checked) is not kind:
        raise wrong("checked", f"gives {type(checked).__name__}, expected {kind.__name__}")
    _check_draws(checked, key, wrong)
    return checked


def _check_draws(law: Law, key: str, wrong: Any) -> None:
    size = 4 if key == "attitude" else 3

    def draw(first: int, count: int) -> Any:
        facts = Facts(
            np.ones((3, count)), lambda q: np.zeros(q.shape[1]), np.ones(count), np.ones((4, count))
        )
        try:
            return law.sample(1, f"start.{key}", first, count, facts)
        except RigidmcError:
            raise
        except Exception as error:  # the user's code may raise anything
            raise wrong("sample", f"raises {type(error).__name__}: {error}") from None

    drawn = draw(0, _COUNT)
    if not isinstance(drawn, np.ndarray) or drawn.shape != (size, _COUNT):
        found = f"shape {drawn.shape}" if isinstance(drawn, np.ndarray) else type(drawn).__name__
        raise wrong("sample", f"gives {found}, expected an array ({size}, {_COUNT})")
    if drawn.dtype.kind != "f" or not np.isfinite(drawn).all():
        raise wrong("sample", "gives numbers that are not finite floats")
    if size == 4 and np.abs((drawn**2).sum(0) - 1.0).max() > 1e-9:
        raise wrong("sample", "gives quaternions that are not of norm 1")
    later = draw(_LATER, _COUNT - _LATER)
    if not np.array_equal(later, drawn[:, _LATER:]) or not np.array_equal(draw(0, _COUNT), drawn):
        rule = (
            "gives a member other numbers if others are drawn with it: take random numbers from"
            " draw(quantities, source, name, first, count) alone"
        )
        raise wrong("sample", rule)

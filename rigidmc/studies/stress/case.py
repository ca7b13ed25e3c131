"""One hard case: how it compares an integrator with a truth, and the integrators that claim it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rigidmc.physics.integrators import INTEGRATORS, integrators_for

Claim = Callable[[str], bool]  # name of an integrator -> whether it claims a case


def claims_all(name: str) -> bool:
    """Return True for every integrator."""
    return True


class Comparison(NamedTuple):
    """The comparison of integrators with a truth.

    error : function of (integrator, share) -> error; share < 1 shortens long runs
    truth : the reference for the error
    effects, claims : an integrator claims the case if it supports the effects and claims(name)
        holds
    """

    error: Callable[[str, float], float]
    truth: str
    effects: tuple[Any, ...] = ()
    claims: Claim = claims_all


@dataclass(frozen=True)
class HardCase:
    """One hard case.

    why : the reason why the case is hard
    asked : a bound set by mathematics: a number, or a function of the integrator's name;
        None if the bound of each integrator comes from `bounds.csv`
    truth, claims : in place of the comparison's
    weak : {integrator: why it fails the case although it claims it}
    quick : whether `--quick` includes the case
    group : its group, set by `catalogue`
    """

    name: str
    why: str
    comparison: Comparison
    asked: float | Callable[[str], float | None] | None = None
    truth: str = ""
    claims: Claim | None = None
    weak: dict[str, str] = field(default_factory=dict)
    quick: bool = False
    group: str = ""

    def __post_init__(self) -> None:
        for fact in ("truth", "claims"):
            object.__setattr__(self, fact, getattr(self, fact) or getattr(self.comparison, fact))

    def integrators(self) -> list[str]:
        """Return the names of the integrators that claim the case."""
        claims: Any = self.claims
        return [name for name in integrators_for(self.comparison.effects) if claims(name)]

    def asked_of(self, integrator: str) -> float | None:
        """Return the bound set by mathematics, None if it comes from measurements."""
        return self.asked(integrator) if callable(self.asked) else self.asked


class CaseGroup(NamedTuple):
    """A group of hard cases: its title, and the function that yields them."""

    title: str
    cases: Callable[[], Iterator[HardCase]]


GROUPS: dict[str, CaseGroup] = {}  # filled by `group`, see `rigidmc.studies.stress.groups`


def group(name: str, title: str) -> Callable[..., Callable[[], Iterator[HardCase]]]:
    """Make a function that yields hard cases a group, such as "H16"."""

    def registered(cases: Callable[[], Iterator[HardCase]]) -> Callable[[], Iterator[HardCase]]:
        GROUPS[name] = CaseGroup(title, cases)
        return cases

    return registered


def makes_steps(name: str) -> bool:
    """Return whether an integrator advances in steps: all but the closed form."""
    return name != "closed"


def keeps_free_invariants(name: str) -> bool:
    """Return whether an integrator conserves energy and |L|^2 of a free body to rounding."""
    return makes_steps(name) and {"T", "|L|^2"} <= set(INTEGRATORS[name].conserves)


def loses_free_invariants(name: str) -> bool:
    """Return whether the steps of an integrator change energy and |L|^2 of a free body."""
    return makes_steps(name) and not keeps_free_invariants(name)


def reversible(name: str) -> bool:
    """Return whether a step -h of an integrator undoes a step h."""
    return bool(INTEGRATORS[name].is_reversible and makes_steps(name))


def only(*names: str) -> Claim:
    """Return a claim of the named integrators, for cases that take too long with all."""
    return lambda name: name in names

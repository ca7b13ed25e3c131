"""The closed forms of free and of Lagrange tops, in the place of an integrator."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ClosedForm:
    """No steps at all: the closed form at every save, from the start. For free tops (damped or not) and Lagrange tops.

    Error of rounding only, however long; the time between saves costs nothing. Drifts are looked at where states are saved.
    Source: TdC Examples 3.5 to 3.7; `rigidmc.mechanics` has the formulas and their sources.
    """

    order = float("inf")
    evaluations = 0
    reversible = True
    compensated = False
    conserves = ("|q|", "|L|^2", "T", "L in space")
    accepts = "free tops, Lagrange tops"


INTEGRATORS = {"closed": ClosedForm()}

"""The closed forms of free tops and Lagrange tops, used in place of an integrator."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ClosedForm:
    """No steps: the closed form at every save. For free tops (damped or not) and Lagrange tops.

    The only error is rounding, however long the motion; the time between saves costs nothing.
    Drifts are checked only at the saves.
    Source: TdC Examples 3.5 to 3.7; `rigidmc.mechanics` has the formulas and their sources.
    """

    order = float("inf")
    evaluations = 0
    is_reversible = True
    compensated = False
    conserves = ("|q|", "|L|^2", "T", "L in space")
    accepts = "free tops, Lagrange tops"


INTEGRATORS = {"closed": ClosedForm()}

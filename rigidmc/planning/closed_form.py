"""The closed form of a scene, if one covers it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Bools, Ints
from rigidmc.mechanics.free_top import Motion, analyse_free_top, solve_free_top
from rigidmc.mechanics.lagrange_top import analyse_lagrange_top, solve_lagrange_top
from rigidmc.physics.dynamics.body_axes import with_axes
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.dynamics.so3 import dot, inverse
from rigidmc.physics.effects import label_effects, name_of
from rigidmc.physics.effects.sums import total_energy, total_energy_scale
from rigidmc.physics.observables.compiled import observed
from rigidmc.planning.initial import Source, Start, initial_block
from rigidmc.planning.steps import Clock, physics
from rigidmc.scene.model import Model

COVERED = (
    "the free top (no effects), the free top with viscous_damping, and the Lagrange top (gravity "
    "on a body with two equal moments and its centre of mass on the third axis)"
)
NONE = -1  # the form of a member without a valid body or start: its motion is nan


class ClosedMotion(NamedTuple):
    """Members of a scene as input to closed forms: moments, momentum (n, 3) and attitude (n, 4) at
    the start.

    Each member's form depends on that member alone, so its bits do not depend on other members.

    form : (n,) 0 for a free top, 1 to 3 for a Lagrange top about that axis, NONE for a member
        without a motion
    weight : m g l (n,) about that axis [N m];  damping : rate (n,) of a free top [1/s]
    """

    moments: Array
    momentum: Array
    attitude: Array
    form: Ints
    weight: Array
    damping: Array

    @property
    def name(self) -> str:
        """The kinds of tops among the members, in words."""
        damped = " with viscous damping" if np.any(self.damping[self.form == 0]) else ""
        free = [f"free top{damped}"] if np.any(self.form == 0) else []
        return " and ".join(free + ["Lagrange top"] * bool(np.any(self.form > 0)))

    def parts(self) -> list[tuple[int, Ints, "ClosedMotion"]]:
        """Return [(form, members, their ClosedMotion)] for each form that occurs."""
        parts = []
        for form in np.unique(self.form[self.form != NONE]):
            members = np.flatnonzero(self.form == form)
            chosen = {name: field[members] for name, field in self._asdict().items()}
            parts.append((int(form), members, ClosedMotion(**chosen)))
        return parts

    def motion(self, t: ArrayLike) -> Motion:
        """Compute the Motion of the members at t [s].

        Its arrays are (n, 3), or (m, n, 3) at times (m,); members without a motion have nan.
        """
        t = np.asarray(t, dtype=float)[..., None]
        shape = (*t.shape[:-1], len(self.form))
        motion = Motion(*(np.full((*shape, size), np.nan) for size in (3, 3, 4)))
        for form, members, part in self.parts():
            for everyone, values in zip(motion, _motion(form, part, t), strict=True):
                everyone[..., members, :] = values
        return motion

    def kinds(self) -> list[tuple[Ints, Any]]:
        """Return [(members, their Kind of free motion or Nutation of a Lagrange top)]."""
        return [
            (
                members,
                analyse_lagrange_top(
                    part.moments, part.weight, part.momentum, part.attitude, axis=form
                )
                if form
                else analyse_free_top(part.moments, part.momentum),
            )
            for form, members, part in self.parts()
        ]


def _motion(form: int, case: ClosedMotion, t: Array) -> Motion:
    """Compute the Motion of a ClosedMotion of one form."""
    if form:
        return solve_lagrange_top(
            case.moments, case.weight, case.momentum, case.attitude, t, axis=form
        )
    # L' = L x omega - rate L follows the undamped motion at the time (1 - exp(-rate t))/rate,
    # for either sign of the rate
    rate = case.damping
    with np.errstate(over="ignore", invalid="ignore"):  # a motion that overflows becomes nan
        # where the divisor is 1, the quotient is unused
        passed = np.where(rate == 0.0, t, -np.expm1(-rate * t) / np.where(rate == 0.0, 1.0, rate))
        lost = ~np.isfinite(passed)
        passed = np.where(lost, 0.0, passed)  # solve_free_top warns of times that are not finite
        l, omega, q = solve_free_top(case.moments, case.momentum, case.attitude, passed)
        left = np.where(lost, np.nan, np.exp(-rate * t))[..., None]
        return Motion(left * l, left * omega, q)


def closed_form(model: Model, sampler: Source, first: int, members: int) -> ClosedMotion:
    """Return the ClosedMotion of `members` members from index `first` on.

    Raises SceneError with the reason if no closed form covers them.
    """
    return case_of(model.effects, *initial_block(model, sampler, first, members))


def case_of(effects: Sequence[Any], block: Array, start: Start) -> ClosedMotion:
    """Return the ClosedMotion of an initial block.

    Raises SceneError if no closed form covers one of the healthy members.
    """
    moments = start["moments"].T
    momentum, attitude = block[layout.MOMENTUM : layout.EXTRA].T, block[: layout.MOMENTUM].T
    if uncovered := sorted({name_of(e) for e in effects} - {"gravity", "viscous_damping"}):
        raise _uncovered(f"the scene has {', '.join(uncovered)}")
    g, rate = np.zeros(len(moments)), np.zeros(len(moments))
    for label, effect in label_effects(effects):  # effects of one kind add up
        if name_of(effect) == "gravity":
            g = g + start[f"{label}_g"]
        else:
            rate = rate + start[f"{label}_rate"]
    with np.errstate(all="ignore"):
        at = start.get("principal_centre", start["centre"])
        weight = (g * start["mass"] * at).T
    healthy = block[layout.STATUS] == 0.0
    healthy &= np.isfinite(block[: layout.EXTRA]).all(0) & np.isfinite(weight).all(1)
    heavy = np.abs(weight) > 1e-12 * np.abs(weight).max(1, keepdims=True)
    form = np.where(healthy, np.where(heavy.any(1), heavy.argmax(1) + 1, 0), NONE)
    if np.any(damped := (form > 0) & (rate != 0.0)):
        raise _uncovered(f"a damped heavy top has no closed form{_some(damped)}")
    if np.any(off := healthy & (heavy.sum(1) > 1)):
        centre = ", ".join(f"{x:.4g}" for x in at[:, np.argmax(off)])
        rule = f"its centre of mass ({centre}) m in principal axes lies on none of these axes"
        raise _uncovered(rule + _some(off))
    _refuse_asymmetric(moments, form)
    along = np.take_along_axis(weight, np.maximum(form, 1)[:, None] - 1, 1)[:, 0]
    return ClosedMotion(moments, momentum, attitude, form, np.where(form > 0, along, 0.0), rate)


def _refuse_asymmetric(moments: Array, form: Ints) -> None:
    """Raise SceneError if a heavy top has unequal moments about the other two axes."""
    for axis in (1, 2, 3):
        i, j = (k for k in range(3) if k != axis - 1)
        apart = np.abs(moments[:, i] - moments[:, j])
        if np.any(unequal := (form == axis) & (apart > 1e-12 * moments[:, i])):
            at = int(np.argmax(np.where(unequal, apart, -1.0)))
            rule = (
                f"its centre of mass lies on axis {axis}, but I{i + 1} = {moments[at, i]:.6g} and "
                f"I{j + 1} = {moments[at, j]:.6g} differ"
            )
            raise _uncovered(rule + _some(unequal))


def _some(bad: Bools) -> str:
    """Return how many members are bad, in words, or "" if all are."""
    return "" if bad.all() else f" ({int(bad.sum()):,} of {bad.size:,} members)"


def _uncovered(why: str) -> SceneError:
    return SceneError(f"no closed form covers it: {why}; covered are {COVERED}", at="scene")


def closed_values(
    effects: Sequence[Any],
    observables: Sequence[Any],
    block: Array,
    start: Start,
    times: Array,
    clock: Clock,
    is_described: bool = False,
) -> Array:
    """Compute observables (times, rows, n) at `times`, each of which ends a step of `clock`.

    Final states, drifts and status go into the block. A member that is unhealthy at the start
    stays there. A member that becomes non-finite freezes at its last finite state, as in a kernel.

    is_described : whether observables are of the axes in which the bodies are described, whose
        principal axes `start` has
    """
    motion = case_of(effects, block, start).motion(times)
    q, l = np.moveaxis(motion.attitude, -1, 1), np.moveaxis(motion.momentum, -1, 1)
    # closed forms return their start to rounding only, and drifts are relative to the first row
    q[0], l[0] = block[: layout.MOMENTUM], block[layout.MOMENTUM : layout.EXTRA]  # the start itself
    body, arrays = physics(effects, block)
    with np.errstate(all="ignore"):
        first = _first(body, arrays, q[0], l[0])
        now = np.array(
            [
                (kinetic_energy(body, b) + total_energy(arrays, body, a), dot(b, b))
                for a, b in zip(q, l, strict=True)
            ]
        )
        finite = np.isfinite(now).all(1) & np.isfinite(q).all(1) & np.isfinite(l).all(1)
        # phases beyond 1e15 rad have no correct digits, hence no meaningful sine
        unit = np.abs((q * q).sum(1) - 1.0) < 1e-9
        healthy = np.logical_and.accumulate(finite & unit & (block[layout.STATUS] == 0.0))
        drifts = np.abs(now - now[0]) * np.array(first[1::2])
    last = np.minimum(np.arange(len(times))[:, None], np.maximum(healthy.sum(0) - 1, 0))
    q, l = (np.take_along_axis(x, last[:, None], 0) for x in (q, l))
    fault = np.where(
        finite.all(0), layout.STATUSES["off_unit_quaternion"], layout.STATUSES["non_finite"]
    )
    keeps_status = healthy[-1] | (block[layout.STATUS] > 0.0)
    block[layout.STATUS] = np.where(keeps_status, block[layout.STATUS], fault)
    largest = np.where(healthy[:, None], drifts, 0.0).max(0)
    block[layout.DRIFT : layout.STATUS] = np.where(healthy[0], largest, np.nan)
    block[: layout.MOMENTUM], block[layout.MOMENTUM : layout.EXTRA] = q[-1], l[-1]
    steps = clock.steps(times)
    block[layout.GOOD_STEP] = steps[last[-1]]
    bad_save = np.minimum(healthy.sum(0), len(times) - 1)
    block[layout.FAULT_STEP] = np.where(healthy[-1], -1.0, steps[bad_save])
    if is_described:
        body = with_axes(body, tuple(start["principal_axes"]))
    with np.errstate(all="ignore"):
        rows = [
            [v for o in observables for v in observed(o, body, arrays, t, a, b, first, ())]
            for t, a, b in zip(times, q, l, strict=True)
        ]
    return np.array(rows)


def _first(body: Any, effects: tuple[Any, ...], q: Array, l: Array) -> tuple[Any, ...]:
    """Return (E, 1/scale of E, |L|^2, 1/|L|^2) at the start, as observables use it."""
    kinetic, squared = kinetic_energy(body, l), dot(l, l)
    energy = kinetic + total_energy(effects, body, q)
    scale = np.maximum(np.abs(energy), 1e-3 * (kinetic + total_energy_scale(effects, body)))
    return energy, inverse(scale), squared, inverse(squared)

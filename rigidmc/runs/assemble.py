"""Assemble a plan: the layout of its result, and the program that moves its members."""

from functools import partial
from typing import Any

from rigidmc.engine.compiler.compose import NumbaError, innermost_cause
from rigidmc.engine.cuda.devices import device_number
from rigidmc.engine.inspection import refuse_memory
from rigidmc.engine.machine import UNCOMPILED, is_uncompiled
from rigidmc.engine.program import NO_DERIVATIVES, Derivatives, Program
from rigidmc.errors import PartError, SceneError
from rigidmc.physics.dynamics.trials import RULE
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.observables import is_own
from rigidmc.planning.plan import Plan
from rigidmc.results.layout import Axes, ResultLayout, constant_variables
from rigidmc.results.variables import (
    derivative_variables,
    ensemble_variables,
    flagged_variables,
    member_derivatives,
    member_variables,
    saved_variables,
)
from rigidmc.scene.derivative_names import derivative_unit
from rigidmc.scene.quantities import count_rows
from rigidmc.scene.recording import Recording
from rigidmc.scene.sampling import drawn_through
from rigidmc.scene.scene import Scene


def make_layout(scene: Scene, recorded: Recording, plan: Plan) -> ResultLayout:
    """Return the layout of a result, in the units of the scene."""
    model, run, grid = scene.model, scene.run, plan.grid
    # a selection of the result has rows of its own members only, so store every choice that
    # depended on all members
    settings: dict[str, Any] = {} if plan.has_member_steps else {"dt": grid.dt}
    if run.varied or count_rows(*model.quantities()) is not None:
        settings |= {"turn_rate": plan.turn_rate, **plan.bounds()}
    own = plan.has_member_steps
    steps: dict[str, Any] = {"turn": run.turn} if own else {"dt": grid.dt, "steps": grid.steps}
    if grid.is_shortened and not own:
        steps |= {"last_steps": grid.steps - grid.head, "last_dt": grid.last_dt}
    facts = {
        **steps,
        "dtype": plan.dtype,
        "compensated": int(plan.compensated),
        **plan.bounds(),
        "parts_per_step": len(plan.scheme.substeps) - 1 if plan.scheme else 0,
        **({"drawn": through} if (through := drawn_through(scene.model, scene.run)) else {}),
        **(UNCOMPILED if plan.scheme is not None and is_uncompiled() else {}),
    }
    monitors, units = plan.monitors, tuple(derivative_unit(scene, name) for name in plan.wrt)
    saved, of_flagged = saved_variables(model.effects, recorded), flagged_variables(recorded)
    by_member = member_variables(model, run, recorded, plan.has_attitude)
    axes = plan.times, plan.thinned, plan.labels, monitors.bins, monitors.dims, plan.wrt, units
    return ResultLayout(
        scene=scene,
        settings=settings,
        facts=facts,
        first=plan.first,
        members=plan.members,
        which=plan.which,
        axes=Axes(*axes),
        recording=recorded,
        saved=plan.saved,
        by_member={**by_member, **member_derivatives(by_member, recorded, units)},
        at_saves={**saved, **derivative_variables(saved, units)},
        of_ensemble=ensemble_variables(recorded),
        of_flagged={**of_flagged, **derivative_variables(of_flagged, units)},
        constant=constant_variables(model),
        columns=plan.columns,
    )


def make_program(
    plan: Plan,
    device: str = "cpu",
    compiled: bool = True,
    derivatives: Derivatives | None = None,
) -> Program | None:
    """Return the program that moves the members of a plan, compiled or from the cache; None for
    closed forms.

    compiled : if False, nothing is compiled and the Program lists what is `missing`
    derivatives : that a block has besides its rows, by default those that the plan asks for
    Raises SceneError for custom code that cannot be compiled, and for derivatives where nothing is.
    """
    if plan.scheme is None:
        return None
    effects, derivatives = plan.model.effects, derivatives or _derivatives(plan)
    if compiled and derivatives.at_once and is_uncompiled():
        rule = "derivatives require compiled code, but NUMBA_DISABLE_JIT is set"
        raise SceneError(rule, at="run.wrt", value=", ".join(plan.wrt))
    try:
        refuse_memory(effects)
        events, running, shadow = plan.monitors.compiled
        kind: Any = Program
        if device != "cpu":
            from rigidmc.engine.cuda.program import CudaProgram

            kind = partial(CudaProgram, number=device_number(device))
        found: Program = kind(
            plan.scheme,
            blank(effects),
            tuple(plan.recording.recorded.values()),
            plan.has_attitude,
            plan.compensated,
            plan.dtype,
            tuple(plan.limits),
            plan.works,
            events,
            running,
            shadow,
            ask=not compiled,
            nodes=plan.nodes,
            paired=plan.paired,
            shortens=plan.grid.is_shortened,
            axes=plan.has_axes,
            derivatives=derivatives,
            meanwhile=_import_xarray,
        )
        return found
    except NumbaError as error:
        own = {
            "effects": [e for e in effects if type(e) not in EFFECTS.values()],
            "observables": list(filter(is_own, plan.recording.observables)),
        }
        names = {key: ", ".join(type(one).__name__ for one in ones) for key, ones in own.items()}
        table = ", ".join(table for table, words in names.items() if words)
        if not table:
            raise
        rule = f"cannot be compiled: {innermost_cause(error)}; {RULE}"
        whole = f"{table}.{', '.join(filter(None, names.values()))}"
        raise PartError(rule, at=whole, table=table) from error


def _derivatives(plan: Plan) -> Derivatives:
    """Return the derivatives that the program of a plan computes."""
    if not plan.columns:
        return NO_DERIVATIVES
    of_body = any(name.startswith("body.") for name in plan.wrt)
    # parameters of effects that are fixed in the body turn with its principal axes
    of_effects = any(name.startswith("effects.") for name in plan.wrt) or of_body
    return Derivatives(plan.at_once, plan.passes, of_body, of_effects)


def _import_xarray() -> None:
    """Import what the result needs, while another process compiles: 0.3 s
    (`python -X importtime -c "import xarray"`)."""
    import xarray  # noqa: F401

"""Assemble a plan: the layout of its result, and the program that moves its members."""

from functools import partial
from typing import Any

import numpy as np

from rigidmc.engine.compiler.compose import NumbaError
from rigidmc.engine.cuda.devices import device_number, is_gpu
from rigidmc.engine.inspection import compilation_error, refuse_uncompilable
from rigidmc.engine.machine import UNCOMPILED, is_uncompiled
from rigidmc.engine.program import Program
from rigidmc.engine.program_spec import Derivatives, ProgramSpec
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.observables import value_rows
from rigidmc.physics.observables.saving import thinned_indices
from rigidmc.planning.plan import Plan
from rigidmc.results.layout import Axes, ResultLayout, constant_variables, labels_of_works
from rigidmc.results.variables import describe_variables
from rigidmc.scene.parameters import units_at
from rigidmc.scene.quantities import count_rows
from rigidmc.scene.recording import Recording
from rigidmc.scene.sampling import drawn_through
from rigidmc.scene.scene import Scene


def make_layout(scene: Scene, recorded: Recording, plan: Plan) -> ResultLayout:
    """Return the layout of a result, in the units of the scene."""
    model, run, grid = scene.model, scene.run, plan.grid
    own_steps = plan.has_member_steps
    # a selection of the result has rows of its own members only, so store every choice that
    # depended on all members
    settings: dict[str, Any] = {} if own_steps else {"dt": grid.dt}
    if run.varied or count_rows(*model.quantities()) is not None:
        settings |= {"turn_rate": plan.turn_rate, **plan.bounds()}
    steps: dict[str, Any] = {"dt": grid.dt, "steps": grid.steps}
    if own_steps:
        steps = {"turn": run.turn}
    elif grid.is_shortened:
        steps |= {"last_steps": grid.steps - grid.head, "last_dt": grid.last_dt}
    facts = {
        **steps,
        "dtype": plan.run.dtype,
        "compensated": int(plan.compensated),
        **plan.bounds(),
        "parts_per_step": len(plan.scheme.substeps) - 1 if plan.scheme else 0,
        **({"drawn": through} if (through := drawn_through(model, run)) else {}),
        **(UNCOMPILED if plan.scheme is not None and is_uncompiled() else {}),
    }
    units = units_at(scene.model, plan.wrt)
    is_thinned = "thinned" in recorded.retained.values()
    return ResultLayout(
        scene=scene,
        settings=settings,
        facts=facts,
        axes=Axes(
            times=grid.times,
            thinned=thinned_indices(grid.saves, run.thin) if is_thinned else np.empty(0, int),
            labels=labels_of_works(model.effects, recorded),
            bins=plan.monitors.bins,
            dims=plan.monitors.dims,
            parameters=plan.wrt,
            parameter_units=units,
        ),
        recording=recorded,
        saved=value_rows(recorded.recorded, len(model.effects)),
        **describe_variables(model, run, recorded, units, plan.has_attitude),
        constant=constant_variables(model),
        columns=plan.columns,
    )


def derivatives_on(device: str, plan: Plan) -> Derivatives:
    """Return the derivatives of a plan, in the passes that suit a device."""
    # A thread of a GPU has 255 registers. On an H200 a heavy step with three derivatives costs 29
    # plain steps in one pass and 12 one by one with rk8, 45 and 16 with gbs12; but 3.9 to 7.7 in
    # one pass and 6.4 to 11 one by one with the others (`python -m bench device`).
    integrator = plan.scheme and plan.scheme.integrator
    if is_gpu(device) and getattr(integrator, "has_many_stages", Integrator.has_many_stages):
        return plan.derivatives.one_by_one()
    return plan.derivatives


def make_program(
    plan: Plan, device: str = "cpu", compiled: bool = True, derivatives: Derivatives | None = None
) -> Program | None:
    """Return the program that moves the members of a plan, compiled or from the cache; None for
    closed forms.

    compiled : if False, nothing is compiled and the Program lists what is `missing`
    derivatives : that a block has besides its rows, by default as `derivatives_on` says
    Raises SceneError for custom code that cannot be compiled.
    """
    if plan.scheme is None:
        return None
    effects, derivatives = plan.model.effects, derivatives or derivatives_on(device, plan)
    try:
        refuse_uncompilable(effects)
        kind: Any = Program
        if is_gpu(device):
            from rigidmc.engine.cuda.program import CudaProgram

            kind = partial(CudaProgram, number=device_number(device))
        elif device == "wasm":
            from rigidmc.engine.wasm.program import WasmProgram

            kind = WasmProgram
        events, running, growth = plan.monitors.compiled
        spec = ProgramSpec(
            plan.scheme, blank(effects), tuple(plan.recording.recorded.values()),
            plan.has_attitude, plan.compensated, plan.run.dtype, plan.limits, plan.works, events,
            running, growth, plan.nodes, plan.paired,
            plan.grid.is_shortened or plan.has_cuts, plan.has_axes, derivatives,
        )  # fmt: skip
        program: Program = kind(spec, ask=not compiled, meanwhile=_import_xarray)
        return program
    except NumbaError as error:
        raise compilation_error(error, effects, plan.recording.observables) from error


def _import_xarray() -> None:
    """Import what the result needs, while another process compiles: 0.3 s
    (`python -X importtime -c "import xarray"`)."""
    import xarray  # noqa: F401

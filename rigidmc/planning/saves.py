"""The times of saves that a scene leaves open: saves per turn, and enough saves to plot few
members.

These saves end steps that the run makes anyway: they change no step, and so no motion.
"""

import math

from rigidmc.errors import SceneError
from rigidmc.physics.observables import value_rows
from rigidmc.planning.plan import MOST_SAVES
from rigidmc.planning.steps import make_time_grid
from rigidmc.planning.turns import MOST, shown_rate
from rigidmc.scene.recording import Recording
from rigidmc.scene.save_times import saves_per_turn
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run

FEW_MEMBERS = 20  # of a run that is plotted member by member
POINTS = 400  # saves to plot, if the motion does not require more
PER_TURN = 20  # saves to plot per turn of the fastest saved quantity: lines bend by 18 degrees
MOST_POINTS = 20_000
MOST_BYTES = 64e6  # of the saves to plot of all members
LONGEST_STRIDE = 1000  # steps: `make_time_grid` finds back t_end/every = steps/stride up to here


def settle_saves(scene: Scene) -> Scene:
    """Return the scene with a time between saves in place of saves per turn.

    A turn is one of the saved quantity that turns fastest at the start, see
    `rigidmc.planning.turns.shown_rate`. Raises SceneError if nothing turns.
    """
    run, number = scene.run, saves_per_turn(scene.run.every)
    if number is None:
        return scene
    count = number * run.t_end * shown_rate(scene.model, run) / (2.0 * math.pi)
    if not count > 0.0:
        rule = "nothing turns at the start: give a time between saves"
        raise SceneError(rule, at="run.every", value=run.every)
    if count > MOST_SAVES:
        rule = f"{count:.3g} saves exceed the limit of {MOST_SAVES:,}"
        raise SceneError(rule, at="run.every", value=run.every)
    return scene.with_run(every=_even(run, math.ceil(count)))


def save_to_plot(scene: Scene, recording: Recording, members: int, parameters: int) -> Scene:
    """Return the scene with a time between saves at which lines through the saves of `members`
    members show the motion; the scene itself if that is not possible or not asked for.

    It is asked for if few members save their values in full, and the scene leaves `every` open. It
    is not possible if members have their own steps, which begin again at each save, or if the steps
    or the limits are too coarse for the motion.

    parameters : number of parameters of derivatives
    """
    run, words = scene.run, set(recording.retained.values())
    if run.every is not None or run.turn is not None or run.varied:
        return scene
    if not 0 < members <= FEW_MEMBERS or words != {"full"}:
        return scene
    rows = max(one.stop for one in value_rows(recording.recorded, len(scene.effects)).values())
    numbers = rows * (1 + parameters)
    angle = run.t_end * shown_rate(scene.model, run)
    count = max(POINTS, math.ceil(PER_TURN * angle / (2.0 * math.pi)))
    count = min(count, MOST_POINTS, int(MOST_BYTES / (8 * members * numbers)))
    known = None if run.integrator == "closed" else make_time_grid(run.t_end, run.dt, None)
    if known is not None:
        count = min(count, known.steps)
    if count < 2 or angle > MOST * count:
        return scene
    every = _even(run, count)
    if known is not None:
        made = make_time_grid(run.t_end, run.dt, every)
        if (made.steps, made.dt, made.is_shortened) != (known.steps, known.dt, False):
            return scene
    return scene.with_run(every=every)


def first_and_last(scene: Scene) -> Scene:
    """Return the scene whose saves, if it leaves them open, are the first and the last state,
    however few its members are."""
    return scene if scene.run.every is not None else scene.with_run(every=scene.run.t_end)


def _even(run: Run, count: int) -> float:
    """Return the time between at least `count` even saves [s]; with steps of one length, a whole
    number of these if they are at least as many."""
    if run.integrator in ("auto", "closed") or run.turn is not None:
        return run.t_end / count
    grid = make_time_grid(run.t_end, run.dt, None)
    if count >= grid.steps:
        return run.t_end / count
    most = min(2 * count, grid.steps)
    whole = next((n for n in range(count, most + 1) if grid.steps % n == 0), None)
    if whole is not None:
        return run.t_end / whole
    return grid.dt * min(grid.steps // count, LONGEST_STRIDE)

"""rigidmc rerun, summary, animate."""

import sys
from typing import Annotated

import typer

from rigidmc.cli.common import (
    INVALID,
    AllowCode,
    Every,
    Force,
    Output,
    Plot,
    ResultArgument,
    Save,
    app,
    count_option,
    fail,
    opened,
    plots_module,
    refuse_outputs,
    reported,
    save_picture,
    time_option,
    told,
)


@app.command()
def rerun(
    file: ResultArgument,
    member: Annotated[int, count_option("--member", 0, help="Index of the member.")],
    every: Every = None, save: Save = None, output: Output = None, plot: Plot = None, force: Force = False, allow_code: AllowCode = False,
):  # fmt: skip
    """Integrate one member of a result again, to the same bits, with more saved: all observables unless --save says which."""
    with reported():
        from rigidmc.errors import RigidmcError
        from rigidmc.runs.rerun import rerun as again

        refuse_outputs(force, output, plot)
        wanted = (
            None
            if save is None
            else [word.strip() for word in save.split(",") if word.strip() not in ("", "none")]
        )
        try:
            dataset = again(file, member, every, wanted, allow_code, output=output, force=force)
        except RigidmcError as error:
            error.file = error.file or file
            raise
        if plot is not None:
            save_picture(plots_module().summary(dataset), plot, force)
        times = dataset.sizes["time"]
        print(
            f"{dataset.attrs['title']}: member {member}, {times:,} saves of {', '.join(v for v in dataset.data_vars if 'time' in dataset[v].dims)}"
        )
        print(f"  {dataset.attrs['rerun']}")
        print("\n".join(told([output, plot])), end="\n" * bool(output or plot))
        dataset.close()


@app.command()
def summary(file: ResultArgument):
    """Say what is in a result: flagged members, and of each number that members have its mean with the interval, median and range."""
    with reported():
        from rigidmc.views.summary import summary as lines

        try:
            with opened(file) as dataset:
                print(lines(dataset))
        except ValueError as error:
            fail(error, INVALID)


@app.command()
def animate(
    file: ResultArgument,
    member: Annotated[int, count_option("--member", 0, help="Index of the member.")],
    output: Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="Animation to write (.gif, .mp4, .webm).")],
    seconds: Annotated[float, time_option("--seconds", help="Length of the animation.")] = 10.0,
    fps: Annotated[int, count_option("--fps", 1, 60, help="Frames a second.")] = 25,
    force: Force = False, allow_code: AllowCode = False,
):  # fmt: skip
    """Animate one member of a result: it is integrated again, and drawn turning beside its momentum sphere."""
    with reported():
        from rigidmc.runs.rerun import frames

        refuse_outputs(force, animation=output)
        from rigidmc.views.animation import SMOOTH, check_writer
        from rigidmc.views.animation import animate as written

        try:
            check_writer(output)
        except ValueError as error:
            fail(error, INVALID)
        dataset = frames(
            opened(file, allow_code), member, max(2, round(seconds * fps) - 1) * SMOOTH, allow_code
        )
        if int(dataset.status.values[0]) == 2:
            fail(f"{file}: member {member} never started: it has no such body or start", INVALID)
        made = -(-dataset.sizes["time"] // SMOOTH)
        if made < 0.9 * seconds * fps:
            print(
                f"  it makes {dataset.sizes['time'] - 1} steps only, which are {made} frames",
                file=sys.stderr,
            )
            fps = max(1, round(made / seconds))
        written(dataset, output, fps, force=force)
        end = float(dataset.time.values[-1])
        print(
            f"{dataset.attrs['title']}: member {member}, {-(-dataset.sizes['time'] // SMOOTH)} frames of {end:g} s"
        )
        print(*told([output]))

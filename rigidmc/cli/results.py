"""Commands about a result: rigidmc rerun, reweight, summary, plot, export, animate and view."""

import os
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.app import INVALID, fail, load_result, load_scene
from rigidmc.cli.options import (
    FORMATS,
    AllowCode,
    Force,
    Output,
    Plot,
    ResultArgument,
    ResultOutput,
    SceneArgument,
    Set,
    add_setting_options,
    count_option,
    make_completion,
    time_option,
)
from rigidmc.cli.reporting import (
    plots_module,
    refuse_outputs,
    report_errors,
    report_files,
    save_picture,
)
from rigidmc.errors import OptionError, RigidmcError, in_file, unknown
from rigidmc.files.outputs import refuse_existing
from rigidmc.files.stores import is_folder
from rigidmc.results.labels import count_text
from rigidmc.scene.library import shipped_names
from rigidmc.views import PICTURES
from rigidmc.views import picture as picture_named

if TYPE_CHECKING:
    import xarray as xr

Of = Annotated[
    list[str],
    typer.Option(
        "--of",
        metavar="MEASURE",
        help='Show the estimate and 95 % interval of a measure, as in `map`: "p(flips >= 1)",'
        ' "mean(flip_wait)", "median(megno)", "quantile(megno, 0.9)". Repeatable.',
    ),
]
Member = Annotated[int, count_option("--member", 0, help="Index of the member.")]
OneMember = Annotated[
    int | None,
    count_option("--member", 0, help="Index of the member; not needed if the result has one."),
]


@add_setting_options(
    "every",
    "save",
    words={
        "every": "time between saves [s], times of saves, or 50/turn; by default as in the run",
        "save": "observables to save; by default all",
    },
)
def rerun_command(
    file: ResultArgument,
    member: Member,
    run: dict[str, Any],
    output: ResultOutput = None,
    plot: Plot = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    with report_errors(file):
        from rigidmc.runs.rerun import rerun as integrate_again

        refuse_outputs(force, output, plot)
        dataset = integrate_again(
            file, member, **run, allow_code=allow_code, output=output, force=force
        )
        if plot is not None:
            save_picture(plots_module().summary(dataset), plot, force)
        names = ", ".join(str(v) for v in dataset.data_vars if "time" in dataset[v].dims)
        times = dataset.sizes["time"]
        print(f"{dataset.attrs['title']}: member {member}, {count_text(times, 'save')} of {names}")
        print(f"  {dataset.attrs['rerun']}")
        print("\n".join(report_files([output, plot])), end="\n" * bool(output or plot))
        dataset.close()


def summary_command(file: ResultArgument, of: Of = []) -> None:  # noqa: B006
    with report_errors():
        from rigidmc.views.summary import summary_text as lines

        try:
            with load_result(file) as dataset, in_file(file):
                print(lines(dataset, of=of))
        except RigidmcError:
            raise
        except ValueError as error:
            fail(error, INVALID)


def reweight_command(
    file: ResultArgument,
    scene: SceneArgument,
    of: Of = [],  # noqa: B006
    settings: Set = [],  # noqa: B006
    output: Output = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    with report_errors():
        from rigidmc.results.export import write
        from rigidmc.studies.reweight import reweight, table

        refuse_outputs(force, study=output)
        new = load_scene(scene, settings, allow_code)
        with load_result(file, allow_code) as dataset, in_file(file):
            study = reweight(dataset, new, of, allow_code=allow_code)
        if output is not None:
            write(study, output, force)
        print("\n".join([*table(study), *report_files([output])]))


def plot_command(
    file: ResultArgument,
    output: Annotated[
        str,
        typer.Option("-o", "--output", metavar="FILE", help="Picture to write (.png, .pdf, .svg)."),
    ],
    picture: Annotated[
        str, typer.Option(help=f"Kind of picture: {', '.join(PICTURES)}; with a bath also gibbs.")
    ] = "summary",
    surface: Annotated[
        str | None,
        typer.Option(help="Of polhodes: sphere (of the momentum) or ellipsoid (of inertia)."),
    ] = None,
    energies: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="Of polhodes: other energies [J], e.g. 0.5,0.6."),
    ] = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    with report_errors():
        options = _polhode_options(picture, surface, energies)
        if picture not in (*PICTURES, "gibbs"):
            raise unknown(
                "picture", (*PICTURES, "gibbs"), at="picture", value=picture, error=OptionError
            )
        refuse_outputs(force, picture=output)
        try:
            with load_result(file, allow_code) as dataset:
                if picture == "gibbs":
                    from rigidmc.views.gibbs import gibbs

                    save_picture(gibbs(dataset, allow_code), output, force)
                else:
                    save_picture(picture_named(picture)(dataset, **options), output, force)
        except RigidmcError:
            raise
        except ValueError as error:
            fail(error, INVALID)
        print(*report_files([output]))


def _polhode_options(picture: str, surface: str | None, energies: str | None) -> dict[str, Any]:
    """Return the options of the picture polhodes; OptionError for options of other pictures."""
    texts = {"surface": surface, "energies": energies}
    options: dict[str, Any] = {name: text for name, text in texts.items() if text is not None}
    for name, text in options.items():
        if picture != "polhodes":
            raise OptionError("is for --picture polhodes", at=name, value=text)
    if energies is not None:
        try:
            options["energies"] = [float(word) for word in energies.split(",")]
        except ValueError:
            rule = "expected energies [J] separated by commas, e.g. 0.5,0.6"
            raise OptionError(rule, at="energies", value=energies) from None
    return options


def export_command(
    file: ResultArgument,
    output: Annotated[str, typer.Option("-o", "--output", metavar="FILE", help=f"{FORMATS}.")],
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    with report_errors():
        from rigidmc.results.export import write

        refuse_outputs(force, output)
        with load_result(file, allow_code) as dataset:
            write(dataset, output, force)
        print(*report_files([output]))


def animate_command(
    file: ResultArgument,
    output: Annotated[
        str,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Animation to write (.gif, .mp4, .webm)."
        ),
    ],
    member: OneMember = None,
    seconds: Annotated[float, time_option("--seconds", help="Length of the animation.")] = 10.0,
    fps: Annotated[int, count_option("--fps", 1, 60, help="Frames per second.")] = 25,
    until: Annotated[
        float | None, time_option("--until", help="Show the motion up to this time.")
    ] = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    with report_errors():
        from rigidmc.runs.frames import frames

        refuse_outputs(force, animation=output)
        from rigidmc.processes.progress import reporter
        from rigidmc.views.animation import SMOOTH, between_frames, check_writer
        from rigidmc.views.animation import animate as draw

        check_writer(output)
        steps = max(2, round(seconds * fps) - 1) * SMOOTH
        result = load_result(file, allow_code)
        member = _only_member(result) if member is None else member
        dataset = frames(result, member, steps, allow_code, until)
        if int(dataset.status.values[0]) == 2:
            fail(f"{file}: member {member} never started: impossible body or start", INVALID)
        count = -(-dataset.sizes["time"] // SMOOTH)
        if count < 0.9 * seconds * fps:
            made = count_text(dataset.sizes["time"] - 1, "step")
            line = f"  the member makes only {made}, enough for {count_text(count, 'frame')}"
            print(line, file=sys.stderr)
            fps = max(1, round(count / seconds))
        with reporter(True, count, 1, "frames") as report:

            def show(done: int, _: int) -> None:
                report.done = done
                report.poll()

            draw(dataset, output, fps, show, force)
        end = float(dataset.time.values[-1])
        print(f"{dataset.attrs['title']}: member {member}, {count} frames of {end:g} s")
        if note := between_frames(dataset):
            print(f"  {note}", file=sys.stderr)
        print(*report_files([output]))


def _only_member(result: "xr.Dataset") -> int:
    """Return the index of the member of a result with one member; OptionError for others."""
    members = result.member.values if "member" in result.coords else []
    if len(members) != 1:
        rule = f"the result has {count_text(len(members), 'member')}: choose one, e.g. --member 0"
        raise OptionError(rule, at="member")
    return int(members[0])


MEMBERS = 500  # to run for the page of a scene

Source = Annotated[
    str,
    typer.Argument(
        metavar="FILE|RUN|SCENE",
        help="A result (.nc, .zarr), a run directory, a map, or a scene.",
        autocompletion=make_completion(shipped_names),
    ),
]
Shown = Annotated[
    str | None,
    typer.Option(
        "--members",
        metavar="LIST",
        help="Members to show, e.g. 0,7,42; by default four. With --live: how many.",
    ),
]
Page = Annotated[
    str | None,
    typer.Option(
        "-o", "--output", metavar="FILE", help="Page to write (.html); by default NAME.html."
    ),
]
Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]


def view_command(
    source: Source,
    members: Shown = None,
    output: Page = None,
    until: Annotated[
        float | None, time_option("--until", help="Show the motion up to this time.")
    ] = None,
    settings: Set = [],  # noqa: B006
    is_live: Annotated[
        bool, typer.Option("--live", help="The page computes the scene itself, while sliders move.")
    ] = False,
    sliders: Annotated[
        list[str],
        typer.Option(
            "--slider",
            metavar="NAME[=LOW:HIGH]",
            help="A number to move with --live, e.g. body.moments.2=1:3; repeatable.",
        ),
    ] = [],  # noqa: B006
    others: Annotated[
        list[str],
        typer.Option(
            "--with", metavar="SCENE", help="Another scene on the page of --live; repeatable."
        ),
    ] = [],  # noqa: B006
    show: Open = False,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    with report_errors(source):
        if sliders and not is_live:
            raise OptionError("is for --live", at="slider", value=sliders[0])
        if others and not is_live:
            raise OptionError("is for --live", at="with", value=others[0])
        chosen = _indices(members)
        stem = os.path.splitext(os.path.basename(source.rstrip(os.sep)))[0]
        name = output or f"{stem}.html"
        refuse_existing(name, force, "pages")
        if is_live and until is not None:
            rule = "a live page has no end: leave it out with --live"
            raise OptionError(rule, at="until", value=f"{until:g} s")
        if is_live:
            _live_page(source, others, settings, allow_code, name, members, sliders, force)
        else:
            plots_module()
            from rigidmc.views.viewer.page import view as page_of

            dataset = _result(source, settings, allow_code)
            page_of(dataset, name, chosen, until, force, allow_code)
            dataset.close()
        print(*report_files([name]))
        if show:
            webbrowser.open(Path(name).absolute().as_uri())


def _live_page(
    source: str,
    others: list[str],
    settings: list[str],
    allow_code: bool,
    name: str,
    members: str | None,
    sliders: list[str],
    force: bool,
) -> None:
    """Write the page that computes a scene."""
    from rigidmc.views.live.page import live

    if is_folder(source) or source.lower().endswith((".nc", ".zarr")):
        raise OptionError("a live page computes a scene, not a result", at="live", value=source)
    count = None
    if members is not None:
        count = _indices(members)
        if count is None or len(count) != 1:
            rule = "with --live, give how many members the page can show"
            raise OptionError(rule, at="members", value=members)
    scenes = [load_scene(source, settings, allow_code)]
    scenes += [load_scene(other, [], allow_code) for other in others]
    asked = dict(map(_slider, sliders)) if sliders else None
    shown = {scene.title: scene for scene in scenes} if others else scenes[0]
    live(shown, name, asked, count[0] if count else None, force)


def _slider(text: str) -> tuple[str, tuple[str, str] | None]:
    """Read NAME or NAME=LOW:HIGH; OptionError. A unit beside HIGH alone is the unit of both."""
    from rigidmc.inputs.measured import as_measured, quantity_text

    name, has_ends, ends = text.partition("=")
    if not has_ends:
        return name, None
    low, colon, high = ends.partition(":")
    if not (low and colon and high) or ":" in high:
        rule = (
            "expected NAME or NAME=LOW:HIGH, e.g. body.moments.2=1:3 or"
            " start.attitude.theta=0deg:60deg"
        )
        raise OptionError(rule, at="slider", value=text)
    if quantity_text(high) and not quantity_text(low):
        low = f"{low} {as_measured(high).unit}"
    return name, (low, high)


def _indices(text: str | None) -> list[int] | None:
    """Read the indices in a list such as 0,7,42; OptionError."""
    if text is None:
        return None
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        rule = "expected indices separated by commas, e.g. 0,7,42"
        raise OptionError(rule, at="members", value=text) from None


def _map(source: str) -> "xr.Dataset | None":
    """Open the map in a file or a run directory; None for other sources, for `load_result`."""
    from rigidmc.studies.stability_map.stored import is_map, open_map

    return open_map(source) if is_map(source) else None


def _result(source: str, settings: list[str], allow_code: bool) -> "xr.Dataset":
    """Open a result, or run the first MEMBERS members of a scene."""
    if is_folder(source) or source.lower().endswith((".nc", ".zarr")):
        if settings:
            raise OptionError(
                "is for scenes; a result is already computed", at="set", value=settings[0]
            )
        stored = _map(source)
        return stored if stored is not None else load_result(source, allow_code)
    from rigidmc.runs.simulate import simulate

    scene = load_scene(source, settings, allow_code)
    few = min(scene.run.members, MEMBERS)
    return simulate(scene.with_run(members=few, save=("momentum",), keep="full"), progress=True)

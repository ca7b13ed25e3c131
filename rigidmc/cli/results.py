"""rigidmc rerun."""

from typing import Annotated

import typer

from rigidmc.cli.common import AllowCode, Every, Force, Output, Plot, Save, app, check_suffix, plots_module, reported


@app.command()
def rerun(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A result (.nc).")],
    member: Annotated[int, typer.Option(help="Index of the member.")],
    every: Every = None, save: Save = None, output: Output = None, plot: Plot = None, force: Force = False, allow_code: AllowCode = False,
):  # fmt: skip
    """Integrate one member of a result again, to the same bits, with more saved: all observables unless --save says which."""
    with reported():
        from rigidmc.errors import SceneError
        from rigidmc.rerun import rerun as again
        from rigidmc.storage import refuse_existing

        for path in (output, plot):
            if path is not None:
                refuse_existing(path, force)
        if plot is not None:
            check_suffix(plot)
        wanted = None if save is None else [word.strip() for word in save.split(",") if word.strip() not in ("", "none")]
        try:
            dataset = again(file, member, every, wanted, allow_code, output=output, force=force)
        except SceneError as error:
            error.file = error.file or file
            raise
        times = dataset.sizes["time"]
        print(
            f"{dataset.attrs['title']}: member {member}, {times:,} saves of {', '.join(v for v in dataset.data_vars if 'time' in dataset[v].dims)}"
        )
        print(f"  {dataset.attrs['rerun']}")
        if plot is not None:
            plots = plots_module()
            plots.save(plots.summary(dataset), plot)
        dataset.close()
        for path in (output, plot):
            if path is not None:
                print(f"  wrote {path}")

"""`ds.rigid`: the physics of a result, on its Dataset; and scenes and bodies as HTML in notebooks.

`rigidmc.views.register` imports this module together with xarray. Methods import modules at first
use, so that this import stays quick.
"""

import html
from collections.abc import Callable, Iterable
from html import escape
from os import PathLike
from typing import TYPE_CHECKING, Any

import xarray as xr

from rigidmc.errors import nearest
from rigidmc.views import PICTURES, picture
from rigidmc.views.states import ResultStates

if TYPE_CHECKING:
    from rigidmc.scene.body import Body
    from rigidmc.scene.scene import Scene


class Pictures:
    """Pictures of a result as methods, `ds.rigid.plot.trajectory()`; each returns a Figure.

    Up to 20 members are lines, more are a density. `savefig` writes .png, .pdf or .svg; the command
    `rigidmc plot RESULT --picture NAME -o FILE` draws the same.

    Examples
    --------
    >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
    >>> len(ds.rigid.plot.polhodes(surface="ellipsoid").axes)
    1
    """

    def __init__(self, result: "Rigid") -> None:
        self._result = result

    def __getattr__(self, name: str) -> Callable[..., Any]:
        close = nearest(name, PICTURES)
        hint = f"; did you mean '{close}'?" if close else ""
        raise AttributeError(f"no picture '{name}'; known: {', '.join(PICTURES)}{hint}")


def _method(name: str) -> Callable[..., Any]:
    """Return the method that draws a picture."""

    def draw(self: Pictures, *args: Any, **options: Any) -> Any:
        return picture(name)(self._result._dataset, *args, **options)

    module, words = PICTURES[name]
    words = words.replace("|L|^2", "``|L|^2``")  # bars are a reference in reStructuredText
    draw.__name__, draw.__qualname__ = name, f"Pictures.{name}"
    draw.__doc__ = f"Draw {words}. It takes the arguments of `rigidmc.views.{module}.{name}`."
    return draw


for _name in PICTURES:
    setattr(Pictures, _name, _method(_name))


@xr.register_dataset_accessor("rigid")
class Rigid(ResultStates):
    """The physics of a result, as `ds.rigid`: energy, drift, polhodes, reruns, pictures, a summary.

    Parameters
    ----------
    dataset : xarray.Dataset
        a result of `simulate` or `rigidmc.open`

    Examples
    --------
    >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
    >>> ds.rigid.scene().title
    'dzhanibekov'
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        super().__init__(dataset)
        self.plot = Pictures(self)

    def __getattr__(self, name: str) -> Any:
        rule = f"ds.rigid has no '{name}'"
        if not name.startswith("_"):  # copies look for their own methods before there is a Dataset
            from rigidmc.physics.observables import saveable_names

            saves = [word for word in saveable_names() if f"{name}_".startswith(f"{word}_")]
            close = nearest(name, [word for word in dir(self) if not word.startswith("_")])
            if name in self._dataset:
                rule += f"; it is a variable of the result: ds.{name}"
            elif saves:
                rule += f', and it was not saved: run with save=("{max(saves, key=len)}",)'
            elif close:
                rule += f"; did you mean '{close}'?"
        raise AttributeError(rule)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"

    def rerun(self, member: int, **options: Any) -> xr.Dataset:
        """Rerun one member and save more of it.

        Parameters
        ----------
        member : int
            index of the member
        **options : object
            options of `rerun`

        Returns
        -------
        xarray.Dataset
            the Dataset of `rerun`

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> ds.rigid.rerun(2, every=0.25).sizes["time"]
        5
        """
        from rigidmc.runs.rerun import rerun

        result: xr.Dataset = rerun(self._dataset, member, **options)
        return result

    def export(self, path: str | PathLike[str], force: bool = False) -> None:
        """Write the result in the format given by the file extension, completely or not at all.

        Parameters
        ----------
        path : path_like
            .nc, .zarr, or a table with one row per member: .csv or .parquet
        force : bool, optional
            replace an existing file

        Raises
        ------
        OptionError
            for another extension, or if the package for this format is not installed
        OutputExists
            if the file exists

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> ds.rigid.export("members.csv")
        >>> import pandas as pd
        >>> len(pd.read_csv("members.csv"))
        4
        """
        from rigidmc.results.export import write

        write(self._dataset, path, force)

    def summary(self, of: str | Iterable[str] = ()) -> str:
        r"""Summarise a result in a few lines of text.

        Parameters
        ----------
        of : str or iterable of str, optional
            measures to report instead, such as "p(flips >= 1)"

        Returns
        -------
        str
            the flagged members; for each quantity with one value per member, the mean with its
            confidence interval, the median, the middle 90 %, and the number of members without a
            value; for an event that has not occurred in all members, the median time; or the
            measures with their intervals

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> print("\n".join(ds.rigid.summary().splitlines()[:2]))
        dzhanibekov: 4 members to 1 s with rk4, dt = 0.01 s
          flagged: none
        """
        from rigidmc.views.summary import summary_text

        return summary_text(self._dataset, of=of)

    def measure(self, of: str, by: str | None = None, confidence: float = 0.95) -> Any:
        """Estimate a measure of the good members.

        Parameters
        ----------
        of : str
            a measure such as "p(flips >= 1)" or "mean(flip_wait | flips >= 2)", see
            `rigidmc.statistics.measures`
        by : str, optional
            a variable with one value per member; members with equal values form a group
        confidence : float, optional
            confidence level of the intervals

        Returns
        -------
        Estimate or xarray.Dataset
            value, low, high; and as attributes `without`, the fraction of the members without a
            value, and `until`, the end of the run if the event has not occurred in all members: a
            quantile beyond it is inf. With `by`, a Dataset over the groups, with the `members` and
            `without` of each. low and high are nan if the members are not independent draws, as on
            a grid

        Raises
        ------
        OptionError
            if the result lacks the measure, for an unknown `by`, and for the mean time of an event
            that has not occurred in all members

        Examples
        --------
        >>> scene = rm.Scene.load("dzhanibekov").with_run(dt=0.02, t_end=6.0)
        >>> ds = rm.simulate(scene, members=64, save=("flips",))
        >>> ds.rigid.measure("p(flips >= 2)").value
        0.734375
        >>> ds.rigid.measure("mean(flip_first)", by="flips").members.values.tolist()
        [17, 47]
        """
        from rigidmc.statistics.estimates import estimate, estimate_by

        if by is None:
            return estimate(self._dataset, of, confidence)
        return estimate_by(self._dataset, of, by, confidence)

    def view(self, output: Any = None, **options: Any) -> Any:
        """Make an HTML page in which members turn, see `rigidmc.views.viewer.page.view`.

        Parameters
        ----------
        output : path_like, optional
            HTML file to write
        **options : object
            members, until, force and allow_code

        Returns
        -------
        Page
            the page, which a notebook displays

        Examples
        --------
        >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
        >>> page = ds.rigid.view(members=[0])
        >>> page.text.startswith("<!doctype html>")
        True
        """
        from rigidmc.views.viewer.page import view

        return view(self._given, output, **options)


LABEL = 13  # characters of the label of a line


def scene_html(scene: "Scene") -> str:
    """Describe a scene as HTML: body, start, effects with their operations, conserved quantities,
    steps and saves."""
    from rigidmc.views.descriptions import outline

    title, *lines = outline(scene)
    return _table(title, lines)


def body_html(body: "Body") -> str:
    """Describe a body as HTML: mass, centre of mass, principal moments, and the stability of
    rotations."""
    from rigidmc.scene.quantities import is_shared
    from rigidmc.views.descriptions import body_lines, describe_body

    if not is_shared(*body.quantities()):
        return _table("body, different for each member", body_lines(body))
    title, *lines = describe_body(body, "body")
    return _table(title, lines)


def _table(title: str, lines: list[str]) -> str:
    """Turn lines of label and text into table rows; a line without label continues the previous
    row."""
    rows = list[list[str]]()
    for line in lines:
        label, text = line[:LABEL].strip(), line[LABEL:]
        if line[:2] == "  " and rows:
            rows[-1][1] += f"\n{line.removeprefix(' ' * LABEL)}"
        else:
            rows.append([label, text] if line[LABEL - 1 : LABEL] == " " else ["", line])
    cell = 'style="text-align: left; vertical-align: top; white-space: pre-wrap'
    body = "".join(
        f'<tr><th {cell}">{html.escape(label)}</th>'
        f'<td {cell}; font-family: monospace">{html.escape(text)}</td></tr>'
        for label, text in rows
    )
    return f"<table><caption>{html.escape(title)}</caption>{body}</table>"


def install(shell: Any) -> None:
    """Install HTML formatters for scenes and bodies in a notebook, without importing either now."""
    formatter = shell.display_formatter.formatters["text/html"]
    formatter.for_type_by_name("rigidmc.scene.scene", "Scene", scene_html)
    formatter.for_type_by_name("rigidmc.scene.body", "Body", body_html)

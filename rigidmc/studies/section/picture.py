"""The picture of a Poincare section."""

import re

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rigidmc.errors import OptionError, nearest
from rigidmc.figures import COLOURS, INK, LIGHT, figure_of, new_figure
from rigidmc.mechanics.rotation import euler
from rigidmc.results.labels import label_of, with_units

EULER = ("phi", "theta", "psi")
FEW = len(COLOURS)  # most members with separate colours
POINTS = 400_000  # most points drawn; they fill the picture
_NAME = re.compile(r"(?P<name>\w+)(\[(?P<component>\w+)\])?")


def section_points(
    study: xr.Dataset, x: str | None = None, y: str | None = None, figure: Figure | None = None
) -> Figure:
    """Draw the points of a section in the plane of two quantities.

    study : the Dataset of `rigidmc.section`
    x, y : such as "momentum[2]" or an Euler angle "theta"; by default the two other components of
        the vector that defines the section, or two of the angular velocity or momentum

    Up to ten members have separate colours. Raises OptionError for a quantity that the section does
    not have.
    """
    names = _chosen(study, x, y)
    values = [_values(study, name) for name in names]
    way = {"rises": ", rising", "falls": ", falling"}.get(study.attrs["way"], "")
    title = f"{study.attrs['title']}: {study.attrs['at']}{way}"
    figure = figure or new_figure(title, (7.0, 5.6))
    axes = figure.add_subplot()
    members = study.member.values
    every = max(1, -(-members.size // POINTS))
    size = float(np.clip(3000.0 / max(1, members.size), 0.15, 6.0))
    own = np.unique(members)
    groups = [members == one for one in own] if own.size <= FEW else [np.full(members.size, True)]
    for k, group in enumerate(groups):
        colour = COLOURS[k] if len(groups) > 1 else INK
        across, up = (one[group][::every] for one in values)
        axes.scatter(across, up, s=size, color=colour, linewidths=0.0, rasterized=True)
    across, up = (
        with_units(f"Euler angle {name}", "rad") if name in EULER else label_of(study, name)
        for name in names
    )
    axes.set(xlabel=across, ylabel=up)
    axes.grid(True, lw=0.3, color=LIGHT)
    axes.set_axisbelow(True)
    return figure_of(axes)


def _chosen(study: xr.Dataset, x: str | None, y: str | None) -> tuple[str, str]:
    """Return the names of both axes."""
    match = _NAME.match(study.attrs["at"])
    name = match["name"] if match else ""
    vector = name if name in study and study[name].dims[:1] == ("axis",) else ""
    vector = vector or ("omega" if "omega" in study else "momentum")
    crossed = match["component"] if match and vector == name else "3"
    first, second = (f"{vector}[{i}]" for i in (1, 2, 3) if str(i) != crossed)
    return x or first, y or second


def _values(study: xr.Dataset, text: str) -> NDArray[np.float64]:
    """Return the values of one axis; OptionError."""
    if text in EULER and "attitude" in study:
        return euler(study.attitude.transpose("point", "quat").values)[:, EULER.index(text)]
    match = _NAME.fullmatch(text.strip())
    name, component = (match["name"], match["component"]) if match else (text, None)
    known = [*(str(n) for n, v in study.data_vars.items() if "point" in v.dims), *EULER]
    if name not in known:
        rule = f"is not a quantity of the section; known: {', '.join(known)}; --save adds others"
        raise OptionError(rule, at="x and y", value=text, nearest=nearest(name, known))
    one = study[name]
    if one.ndim == 2:
        labels = [str(label) for label in one[one.dims[0]].values]
        if component not in labels:
            rule = f"expected one of the components {', '.join(labels)}, as in {name}[{labels[0]}]"
            raise OptionError(rule, at="x and y", value=text)
        one = one[labels.index(component)]
    elif component is not None:
        raise OptionError(f"{name} has no components", at="x and y", value=text)
    values: NDArray[np.float64] = one.values
    return values

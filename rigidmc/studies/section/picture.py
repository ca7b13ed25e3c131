"""The picture of a Poincare section."""

import re
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.errors import OptionError, nearest
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import euler
from rigidmc.results.labels import axis_label, in_symbols, label_of, with_degrees, with_units
from rigidmc.views.figures import COLOURS, INK, LIGHT, VALUES, add_title, figure_of, new_figure

EULER = ("phi", "theta", "psi")
FEW = len(COLOURS)  # most members with separate colours
SAME, KEPT = 1e-6, 0.01  # energies that are equal, relative; kept, relative to their differences
POINTS = 400_000  # most points drawn; they fill the picture
_NAME = re.compile(r"(?P<name>\w+)(\[(?P<component>\w+)\])?")


def section_points(
    study: xr.Dataset, x: str | None = None, y: str | None = None, figure: Figure | None = None
) -> Figure:
    """Draw the points of a section in the plane of two quantities.

    study : the Dataset of `rigidmc.section`
    x, y : such as "momentum[2]" or an Euler angle "theta"; by default the two other components of
        the vector that defines the section, or two of the angular velocity or momentum; theta in
        place of a component that does not vary

    Curves of one energy do not cross. If each member keeps its energy and these differ, colours
    show the energies; else up to ten members have separate colours. Raises OptionError for a
    quantity that the section does not have.
    """
    study = with_degrees(study, *map(str, study.data_vars))
    names = _chosen(study, x, y)
    values = [_values(study, name) for name in names]
    way = {"rises": ", rising", "falls": ", falling"}.get(study.attrs["way"], "")
    title = f"{study.attrs['title']}: {in_symbols(study.attrs['at'])}{way}"
    figure = figure or new_figure(title, (7.0, 5.6))
    axes = figure.add_subplot()
    members = study.member.values
    every = max(1, -(-members.size // POINTS))
    size = float(np.clip(3000.0 / max(1, members.size), 0.15, 6.0))
    style: dict[str, Any] = {"s": size, "linewidths": 0.0, "rasterized": True}
    shown = np.unique(members)
    if differ_in_energy(study):
        across, up, energy = (x[::every] for x in (*values, study.energy.values))
        dots = axes.scatter(across, up, c=energy, cmap=VALUES, **style)
        figure.colorbar(dots, ax=axes).set_label(axis_label(study.energy))
        add_title(axes, "colours: energies; curves of different energies may cross")
    elif shown.size <= FEW:
        for k, member in enumerate(shown):
            there = np.flatnonzero(members == member)[::every]
            axes.scatter(*(x[there] for x in values), color=COLOURS[k], **style)
        add_title(axes, "colours: members")
    else:
        axes.scatter(*(x[::every] for x in values), color=INK, **style)
    axes.set(**{
        key: with_units(in_symbols(name), "deg") if name in EULER else label_of(study, name)
        for key, name in zip(("xlabel", "ylabel"), names, strict=True)
    })  # fmt: skip
    axes.grid(True, lw=0.3, color=LIGHT)
    axes.set_axisbelow(True)
    return figure_of(axes)


def differ_in_energy(study: xr.Dataset) -> bool:
    """Return whether each member keeps its energy at all points, and these energies differ."""
    if "energy" not in study or not study.sizes["point"]:  # of a result without it
        return False
    energy = study.energy.values
    place = np.unique(study.member.values, return_inverse=True)[1]
    low, high = np.full(place.max() + 1, np.inf), np.full(place.max() + 1, -np.inf)
    np.minimum.at(low, place, energy)
    np.maximum.at(high, place, energy)
    apart = float(np.ptp(low))
    return apart > SAME * np.abs(energy).max() and float((high - low).max()) < KEPT * apart


def _chosen(study: xr.Dataset, x: str | None, y: str | None) -> tuple[str, str]:
    """Return the names of both axes; by default of components that vary, else of angles."""
    match = _NAME.match(study.attrs["at"])
    name = match["name"] if match else ""
    vector = name if name in study and study[name].dims[:1] == ("axis",) else ""
    vector = vector or ("omega" if "omega" in study else "momentum")
    crossed = match["component"] if match and vector == name else "3"
    components = [f"{vector}[{i}]" for i in (1, 2, 3) if str(i) != crossed]
    values = np.stack([_values(study, name) for name in components])
    size = SAME * np.abs(values).max(initial=0.0)
    vary = [name for name, x in zip(components, values, strict=True) if x.size and np.ptp(x) > size]
    first, second = (vary[0], "theta") if len(vary) == 1 else components
    return x or first, y or second


def _values(study: xr.Dataset, text: str) -> Array:
    """Return the values of one axis; OptionError."""
    if text in EULER and "attitude" in study:
        return np.degrees(
            euler(study.attitude.transpose("point", "quat").values)[:, EULER.index(text)]
        )
    match = _NAME.fullmatch(text.strip())
    name, component = (match["name"], match["component"]) if match else (text, None)
    names = [*(str(n) for n, v in study.data_vars.items() if "point" in v.dims), *EULER]
    if name not in names:
        rule = f"is not a quantity of the section; known: {', '.join(names)}; --save adds others"
        raise OptionError(rule, at="x and y", value=text, nearest=nearest(name, names))
    variable = study[name]
    if variable.ndim == 2:
        labels = [str(label) for label in variable[variable.dims[0]].values]
        if component not in labels:
            rule = f"expected one of the components {', '.join(labels)}, as in {name}[{labels[0]}]"
            raise OptionError(rule, at="x and y", value=text)
        variable = variable[labels.index(component)]
    elif component is not None:
        raise OptionError(f"{name} has no components", at="x and y", value=text)
    return np.asarray(variable.values)

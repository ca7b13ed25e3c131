"""Pictures, read back: axes and legends without words, units or room, and colours that differ."""

import re

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.legend import Legend
from matplotlib.text import Text

# how matplotlib writes powers of ten
_NUMBER = re.compile(r"(\$?\\mathdefault\{?|10|\^|[-+\N{MINUS SIGN}0-9.e]|\\times|[{}$ ])*")
# a dotted path or an identifier, which is no word of a reader
_RAW = re.compile(r"[A-Za-z]\w*\.[a-z]\w+|[A-Za-z]{2,}_[A-Za-z0-9]")
# words of numbers without a unit
_PURE = (
    "drift", "member", "fraction", "probability", "steps", "density", "level", "index", "per bin",
    "log₁₀", "parameter", "ε", "√", "isotropic", "kT", "p(", "derivative of", "cost", "error",
    "reached", "MEGNO", "number of", "residual/noise", "I₁/I",
)  # fmt: skip
SLACK = 1.0  # pixels that a letter may reach beyond the figure


def faults(figure):
    """What a reader would stumble over, in words; [] for a good picture."""
    figure.canvas.draw()
    return [
        *(f"no label: {texts}" for texts in _unlabelled(figure)),
        *(f"cut: {text!r}" for text in _cut(figure)),
        *(f"raw name: {text!r}" for text in _words(figure) if _RAW.search(text)),
        *(f"no unit: {text!r} (or add to _PURE)" for text in _without_unit(figure)),
        *(f"legend has another colour: {text!r}" for text in _other_colours(figure)),
    ]


def _unlabelled(figure):
    """Texts of the ticks of each axis that has numbers and no label."""
    # axes that share ticks show them, and their label, once
    return [
        numbers
        for _, axis in _drawn_axes(figure)
        if (numbers := _numbers(axis)) and not axis.get_label_text().strip()
    ]


def _drawn_axes(figure):
    return [
        (axes, axis)
        for axes in figure.axes
        if axes.axison and axes.get_visible()
        for axis in (axes.xaxis, axes.yaxis)
        if axis.get_visible()
    ]


def _ticks(axis):
    """The labels of the ticks in view."""
    place = axis.get_transform().transform
    low, high = sorted(place(axis.get_view_interval()))
    slack = 1e-9 * (high - low)
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    ticks = [t for t in ticks if low - slack <= place(t.get_loc()) <= high + slack]
    labels = [one for t in ticks for one in (t.label1, t.label2)]
    return [one for one in labels if one.get_visible() and one.get_text().strip()]


def _numbers(axis):
    """The texts of the ticks that a picture shows, if they are numbers."""
    texts = [one.get_text() for one in _ticks(axis)]
    return texts if all(map(_NUMBER.fullmatch, texts)) else []


def _texts(figure):
    """The texts that a picture shows."""
    shown = [one for _, axis in _drawn_axes(figure) for one in (*_ticks(axis), axis.label)]
    for part in (figure, *figure.axes):
        ticks = {id(one) for axis in (_axes_of(part)) for one in axis.findobj(Text)}
        shown += [one for one in part.findobj(Text) if id(one) not in ticks]
    own = {id(one) for axes in figure.axes for axis in _axes_of(axes) for one in axis.findobj(Text)}
    drawn = {id(one) for _, axis in _drawn_axes(figure) for one in (*_ticks(axis), axis.label)}
    shown = {id(one): one for one in shown if id(one) not in own or id(one) in drawn}
    return [one for one in shown.values() if one.get_visible() and one.get_text().strip()]


def _axes_of(part):
    return [part.xaxis, part.yaxis] if hasattr(part, "xaxis") else []


def _cut(figure):
    """Texts that reach beyond the figure."""
    width, height = figure.canvas.get_width_height()
    for text in _texts(figure):
        box = text.get_window_extent()
        ends = box.x0, box.y0, width - box.x1, height - box.y1
        if min(ends) < -SLACK:
            yield text.get_text()


def _words(figure):
    """Labels of axes, and texts of ticks and legends."""
    for _, axis in _drawn_axes(figure):
        yield axis.get_label_text()
        yield from (one.get_text() for one in _ticks(axis))
    for legend in figure.findobj(Legend):
        yield from (one.get_text() for one in legend.get_texts())


def _without_unit(figure):
    """Labels of axes with numbers that have neither a unit nor a word of a pure number."""
    for _, axis in _drawn_axes(figure):
        label = axis.get_label_text()
        is_pure = "[" in label or any(word in label for word in _PURE)
        if label and _numbers(axis) and not is_pure:
            yield label


def _other_colours(figure):
    """Texts of legends in colours that nothing drawn has; images have colours of their own."""
    for legend in figure.findobj(Legend):
        if legend.axes is None and any(axes.images for axes in figure.axes):
            continue
        own = {id(one) for one in legend.findobj()}
        drawn = set()
        for axes in figure.axes:  # a legend may stand above other axes than its lines
            drawn.add(to_hex(axes.get_facecolor()))
            for artist in (*axes.lines, *axes.collections, *axes.patches, *axes.containers):
                if id(artist) not in own:
                    drawn |= _colours(artist, only_drawn=True)
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            if not _colours(handle) & drawn:
                yield text.get_text()


def _colours(artist, only_drawn=False):
    """The colours of an artist; none of a line without points."""
    if isinstance(artist, tuple):  # a container
        return set().union(*(_colours(one, only_drawn) for one in artist if one is not None))
    if hasattr(artist, "get_xdata"):
        places = np.atleast_1d(np.asarray(artist.get_xdata(), float))
        if only_drawn and not np.isfinite(places).any():
            return set()
        marker = [artist.get_markerfacecolor()] if artist.get_marker() not in ("", "None") else []
        colours = (artist.get_color(), *marker)
        return {to_hex(one) for one in colours if not isinstance(one, str) or one != "none"}
    found = []
    for name in ("get_facecolor", "get_edgecolor"):
        if hasattr(artist, name):
            rows = np.atleast_2d(getattr(artist, name)())
            found += [to_hex(one) for one in rows if rows.size and one[-1] > 0.0]
    return set(found)

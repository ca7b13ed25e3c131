"""The axes of pictures, read back: which of them show numbers and do not say of what."""

import re

# how matplotlib writes powers of ten
_NUMBER = re.compile(r"(\$?\\mathdefault\{?|10|\^|[-+\N{MINUS SIGN}0-9.e]|\\times|[{}$ ])*")


def unlabelled(figure):
    """Texts of the ticks of each axis that has numbers and no label."""
    figure.canvas.draw()
    # axes that share ticks show them, and their label, once
    return [
        numbers
        for axes in figure.axes
        if axes.axison
        for axis in (axes.xaxis, axes.yaxis)
        if (numbers := _numbers(axis)) and not axis.get_label_text().strip()
    ]


def _numbers(axis):
    """The texts of the ticks that a picture shows, if they are numbers."""
    shown = [tick.get_text() for tick in axis.get_ticklabels() if tick.get_visible()]
    texts = [text for text in shown if text]
    return texts if axis.get_visible() and all(map(_NUMBER.fullmatch, texts)) else []

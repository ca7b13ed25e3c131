"""How integrators look in pictures: derived from their registry, so that a new one has a style."""

from typing import NamedTuple

from rigidmc.integrators import INTEGRATORS
from rigidmc.views.figure import COLOURS, DASHES, MARKERS


class Style(NamedTuple):
    """How the line of an integrator looks."""

    color: str
    marker: str
    dash: str


def styles() -> dict[str, Style]:
    """{integrator: Style} from the registry.

    One colour for integrators of one family (the file that defines them) and order, dashes within
    it; each integrator has its own marker, up to len(MARKERS) of them.
    """
    families: dict[tuple[str, float], int] = {}  # {(file, order): members so far}
    table = {}
    for place, (name, kind) in enumerate(INTEGRATORS.items()):
        family = type(kind).__module__, kind.order
        before = families.setdefault(family, 0)
        colour = COLOURS[list(families).index(family) % len(COLOURS)]
        table[name] = Style(colour, MARKERS[place % len(MARKERS)], DASHES[before % len(DASHES)])
        families[family] += 1
    return table


STYLES = styles()


def style_of(name: str) -> Style:
    """The style of an integrator; those of the user's own share one."""
    return STYLES.get(name, Style("0.15", "*", "-"))

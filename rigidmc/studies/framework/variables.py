"""The variables of a study, declared once: they make its Dataset, and the section Returns of its
docstring. Tables and pictures take their labels from the attributes."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import xarray as xr

from rigidmc.results.labels import units_text
from rigidmc.scene.scene import Scene
from rigidmc.statistics.intervals import Interval
from rigidmc.studies.framework.options import wrapped
from rigidmc.version import VERSION

ENDS = {"": "", "_low": ": lower end of its interval", "_high": ": upper end of its interval"}


class StudyVariable(NamedTuple):
    """A variable of the Dataset of a study.

    dims : names of its dimensions, separated by spaces; "" for a number
    units : CF units, or a function of the units of the measure that is asked for; ""
        for words, and for numbers in several units
    text : its long name; {NAME} stands for an attribute of the Dataset
    more : addition to `text` in the docstring
    has_interval : whether it is an Interval, with the variables NAME_low and NAME_high
    attrs : other attributes
    """

    name: str
    dims: str
    units: str | Callable[[str], str]
    text: str
    more: str = ""
    has_interval: bool = False
    attrs: Mapping[str, Any] = {}

    def documented(self) -> str:
        """Return its line of the section Returns."""
        dims = f" ({', '.join(self.dims.split())})" if self.dims else ""
        ends = f", with `{self.name}_low` and `{self.name}_high`" if self.has_interval else ""
        units = "units of the measure" if callable(self.units) else units_text(self.units)
        text = re.sub(r"\{(\w+)\}", r"`\1`", self.text) + (f"; {self.more}" if self.more else "")
        return wrapped(f"- `{self.name}`{dims}{f' [{units}]' if units else ''}{ends}: {text}", "  ")

    def made(self, value: Any, attrs: Mapping[str, Any], units: str) -> dict[str, Any]:
        """Return {name: (dimensions, values, attributes)} of the variable and of its ends."""
        units = self.units(units) if callable(self.units) else self.units
        about = {"units": units} if units else {}
        about |= {**self.attrs, **getattr(value, "attrs", {})}
        text, dims = self.text.format_map(attrs), self.dims.split()
        values = value if self.has_interval else (getattr(value, "values", value),)
        return {
            f"{self.name}{end}": (dims, x, {"long_name": f"{text}{more}", **about})
            for (end, more), x in zip(ENDS.items(), values, strict=False)
        }


def make_dataset(
    variables: Sequence[StudyVariable],
    values: Mapping[str, Any],
    coordinates: Mapping[str, Any],
    attrs: Mapping[str, Any],
    units: str = "1",
) -> xr.Dataset:
    """Return the Dataset of a study, without what `describe` writes.

    values : of each of the variables: an array, an Interval, or a DataArray, whose attributes
        replace those declared
    units : of the measure that is asked for
    """
    assert [variable.name for variable in variables] == list(values), (
        "other variables than declared"
    )
    made = (x.made(values[x.name], attrs, units) for x in variables)
    return xr.Dataset({name: x for part in made for name, x in part.items()}, coordinates, attrs)


def describe(dataset: xr.Dataset, scene: Scene) -> xr.Dataset:
    """Return the Dataset of a study with the title and the text of its scene, unless it has its
    own, and with the version that computed it."""
    about = {"source": f"rigidmc {VERSION}", **dataset.attrs}
    if "scene" not in about:
        about = {"title": scene.title, **about, "scene": scene.dumps()}
    dataset.attrs = about
    return dataset


def returned(variables: Sequence[StudyVariable]) -> str:
    """Return the section Returns of a docstring."""
    about = "    the variables, with their dimensions and the ends of their intervals:\n"
    items = (variable.documented() for variable in variables)
    return "\n".join(["Returns\n-------\nxarray.Dataset", about, *items])


def interval_of(study: xr.Dataset, name: str) -> Interval:
    """Return a number of a study with the ends of its interval."""
    return Interval(*(float(study[f"{name}{end}"]) for end in ENDS))

"""Estimate measures of an existing result, for all members or for groups, with intervals.

A measure uses one number per member: a variable, or a component of one, such as "omega[1]".
"""

import re
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, nearest
from rigidmc.files.reading import toml
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.physics.dynamics.methods import argument_names
from rigidmc.physics.observables import bare_observables, own
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.scene.recording import Recording
from rigidmc.scene.sampling import is_sample_of
from rigidmc.scene.toml.read import scene_text
from rigidmc.statistics.intervals import Estimate
from rigidmc.statistics.measures import Measure, measure

MOST_GROUPS = 10_000


def why_no_interval(dataset: xr.Dataset) -> str:
    """Return the reason why the spread of the members gives no interval for a measure; "" if it
    does, as for members that are drawn independently."""
    tables = toml(scene_text(dataset))
    points = tables["run"].get("points", "independent")
    if points != "independent":
        return (
            f"members are {points} points, whose spread gives no interval: use"
            " rigidmc.estimate_rqmc"
        )
    if not is_sample_of(tables):
        return "nothing is random: the members are not a sample, so there are no intervals"
    return ""


def estimate(dataset: xr.Dataset, text: str, confidence: float = 0.95) -> Estimate:
    """Estimate a measure of the good members with its confidence interval.

    low and high are nan if the members are not independent draws, as on a grid. Raises OptionError
    if the result lacks the measure, and for the mean time of an event that has not occurred in all
    members.
    """
    asked = _asked(dataset, text)
    who = asked.asks(dataset)
    interval = _interval(dataset, asked, asked.values(dataset), who, confidence).each(float)
    asked.refuse_unknown(interval)
    return interval


def estimate_by(dataset: xr.Dataset, text: str, by: str, confidence: float = 0.95) -> xr.Dataset:
    """Estimate a measure for each group of good members with equal values of `by`.

    Returns a Dataset over `by` of value, low, high, members, and `without`, the fraction of members
    without a value. The mean time of an event is nan in groups in which the event has not occurred
    in all members. Raises OptionError for an unknown `by`, and for more than MOST_GROUPS groups.
    """
    asked, good = _asked(dataset, text), dataset.status.values == 0
    labels, who = _labels(dataset, by), asked.asks(dataset)
    some = (good | who) & (labels == labels)
    groups, group = np.unique(labels[some], return_inverse=True)
    if groups.size > MOST_GROUPS:
        rule = f"has {groups.size:,} different values; at most {MOST_GROUPS:,} groups are possible"
        raise OptionError(rule, at="by", value=by)
    order, counts = np.argsort(group, kind="stable"), np.bincount(group, minlength=groups.size)
    values = np.full((groups.size, counts.max(initial=0)), np.nan, asked.dtype)
    there = np.arange(values.shape[1]) < counts[:, None]
    values[there] = asked.values(dataset)[some][order]
    there[there] = who[some][order]
    intervals = _interval(dataset, asked, values, there, confidence)
    units = asked.units(dataset.data_vars)
    attrs = {"long_name": text, "units": units, "confidence": confidence}
    variables: dict[str, Any] = {
        name: ((by,), numbers, attrs)
        for name, numbers in zip(intervals._fields, intervals, strict=True)
    }
    about = {"long_name": "fraction of the selected members without a value", "units": "1"}
    variables["without"] = ((by,), intervals.without, about)
    counts = np.bincount(group[good[some]], minlength=groups.size)
    members = ((by,), counts, {"long_name": "good members of the group"})
    return xr.Dataset({**variables, "members": members}, {by: groups})


def _asked(dataset: xr.Dataset, text: str) -> Measure:
    return measure(text, dataset.data_vars, may_save_more=False)


def _labels(dataset: xr.Dataset, by: str) -> NDArray[np.generic]:
    by_member = [str(name) for name, v in dataset.variables.items() if v.dims == ("member",)]
    if by not in by_member:
        rule = f"no such variable with one value per member; known: {', '.join(by_member)}"
        raise OptionError(rule, at="by", value=by, nearest=nearest(by, by_member))
    labels: NDArray[np.generic] = dataset[by].values
    return labels


def _interval(
    dataset: xr.Dataset, asked: Measure, values: NDArray[Any], who: Bools, confidence: float
) -> Estimate:
    interval = asked.interval(values, who, confidence)
    if not why_no_interval(dataset):
        return interval
    unknown = np.full(np.shape(interval.value), np.nan)
    return Estimate(interval.value, unknown, unknown, interval.without, interval.until)


NAME = r"(?P<name>[A-Za-z_]\w*)(\[(?P<component>\w+)\])?"


class StateComponent(NamedTuple):
    """An observable at save times, or one of its components.

    row : index of the component
    """

    name: str
    row: int

    def values(self, result: xr.Dataset) -> Array:
        """Return its values (time, member) in a result."""
        return rows_in_time(result, self.name)[:, self.row]


def rows_in_time(result: xr.Dataset, name: str) -> Array:
    """Return an observable of a result as (time, component, member)."""
    values: Array = result[name].transpose("time", ..., "member").values
    return values.reshape(values.shape[0], -1, values.shape[-1])


def component_of(recording: Recording, text: str, key: str) -> StateComponent:
    """Parse a text such as "omega[1]"; OptionError that names the option `key`."""
    text = text.strip()
    match = re.fullmatch(NAME, text)
    if match is None:
        raise OptionError("expected an observable: NAME or NAME[3]", at=key, value=text)
    name, component = match["name"], match["component"]
    names = dict.fromkeys((*bare_observables(), *own(recording.observables), *recording.recorded))
    of_state = [word for word in names if of_the_state(recording, word)]
    if name not in of_state:
        rule = f"no such observable of the state at save times; known: {', '.join(of_state)}"
        raise OptionError(rule, at=key, value=text, nearest=nearest(name, of_state))
    dims = recording.observable(name).dims
    labels = [str(label) for label in DIMENSIONS[dims[0]].labels] if dims else []
    if (component is None) == bool(labels) or (labels and component not in labels):
        rule = f"has the components {', '.join(labels)}" if labels else "has no components"
        example = f": expected one, as in {name}[{labels[0]}]" if labels else ""
        raise OptionError(f"{name} {rule}{example}", at=key, value=text)
    return StateComponent(name, labels.index(component) if labels else 0)


def of_the_state(recording: Recording, name: str) -> bool:
    """Whether an observable depends only on state and time, not on the start."""
    observable = recording.observable(name)
    needs = argument_names(observable, "value")
    return not needs & {"start", "works"} and "effect" not in observable.dims

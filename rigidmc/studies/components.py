"""One number of the state over time: an observable, or a component of it, such as "omega[1]"."""

import re
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.dynamics.methods import argument_names
from rigidmc.errors import OptionError, nearest
from rigidmc.observables import OBSERVABLES, own
from rigidmc.observables.protocol import DIMENSIONS
from rigidmc.scene.scene import Scene

Array = NDArray[np.float64]
NAME = r"(?P<name>[A-Za-z_]\w*)(\[(?P<component>\w+)\])?"


class Component(NamedTuple):
    """An observable at save times, or a component of it.

    row : of the component among the numbers of the observable
    """

    name: str
    row: int

    def values(self, result: xr.Dataset) -> Array:
        """Its values (time, member) in a result."""
        return rows(result, self.name)[:, self.row]


def rows(result: xr.Dataset, name: str) -> Array:
    """An observable of a result as (time, numbers, member)."""
    values: Array = result[name].transpose("time", ..., "member").values
    return values.reshape(values.shape[0], -1, values.shape[-1])


def component_of(scene: Scene, text: str, key: str) -> Component:
    """The Component of a text such as "omega[1]"; OptionError that names the option `key`."""
    match = re.fullmatch(rf"\s*{NAME}\s*", text)
    if match is None:
        raise OptionError("", key, text, "expected an observable: NAME or NAME[3]")
    name, component = match["name"], match["component"]
    names = dict.fromkeys((*OBSERVABLES, *own(scene.observables), *scene.recorded()))
    known = [word for word in names if of_the_state(scene, word)]
    if name not in known:
        rule = f"no such observable of the state at save times; known: {', '.join(known)}"
        raise OptionError("", key, text, rule, nearest(name, known))
    dims = scene.observable(name).dims
    labels = [str(label) for label in DIMENSIONS[dims[0]].labels] if dims else []
    if (component is None) == bool(labels) or (labels and component not in labels):
        rule = f"has the components {', '.join(labels)}" if labels else "has no components"
        example = f": expected one, as in {name}[{labels[0]}]" if labels else ""
        raise OptionError("", key, text, f"{name} {rule}{example}")
    return Component(name, labels.index(component) if labels else 0)


def of_the_state(scene: Scene, name: str) -> bool:
    """Whether an observable follows from the state and the time, and not from the start too."""
    observable = scene.observable(name)
    needs = argument_names(observable, "value")
    return not needs & {"start", "works"} and "effect" not in observable.dims

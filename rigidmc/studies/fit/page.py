"""The page of a fit: the body of each record turns beside its readings."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.files.outputs import Path
from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import in_symbols, with_units
from rigidmc.runs.simulate import simulate
from rigidmc.scene.parameters import with_parameters
from rigidmc.scene.scene import Scene
from rigidmc.scene.varied import variables
from rigidmc.studies.fit.parameters import record_of
from rigidmc.views.viewer.data import to_base64
from rigidmc.views.viewer.page import MOST, view


def save_page(study: xr.Dataset, path: Path, force: bool) -> bool:
    """Write the page, of at most MOST records."""
    records = range(min(MOST, int(study.record.max())))
    parts = [study.isel(sample=study.record.values == 1 + member) for member in records]
    readings = [list(_readings(part)) for part in parts]
    view(motion(study), path, members=records, force=force, readings=readings)
    return True


def motion(study: xr.Dataset) -> xr.Dataset:
    """Return the motion of the best answer: its members are the records."""
    scene, records = Scene.loads(study.attrs["fitted"]), int(study.record.max())
    known, rows = variables(scene.model), dict[str, Array]()
    for name, value in zip(study.parameter.values, study.value.values[0], strict=True):
        key, record = record_of(name)
        rows.setdefault(key, np.empty(records))[record - 1 if record else slice(None)] = value
    values: dict[str, Any] = {}
    for key, row in rows.items():
        vector, _, last = key.rpartition(".")
        if last.isdecimal() and vector in known:
            values[vector] = (*values.get(vector, ()), row)
        elif key in known:  # not a nuisance of a sensor
            values[key] = row
    scene = scene.with_model(with_parameters(scene.model, values, "free", known))
    scene = replace(scene, title=f"{scene.title}: readings and fitted motion")
    end = float(study.sample_time.max())
    return simulate(scene, members=records, t_end=end, every=end, save="omega")


def _readings(part: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the data of each observable of a record: its channels at all times of any of them."""
    part = part.assign(residual=(part.data - part.model) / part.noise)
    observables = np.array([word.partition("[")[0] for word in part.channel.values])
    for name in np.unique(observables):
        own = part[["data", "model", "residual"]].isel(sample=observables == name)
        unit, own = str(own.channel_unit.values[0]), own.drop_vars(["record", "channel_unit"])
        whole = own.set_index(sample=["sample_time", "channel"]).unstack("sample")
        yield {
            "name": in_symbols(name),
            "upward": with_units(in_symbols(name), unit),
            "names": [in_symbols(word) for word in whole.channel.values],
            "t": to_base64(whole.sample_time),
            **{str(key): [to_base64(row) for row in x.transpose("channel", ...)]
               for key, x in whole.items()},
        }  # fmt: skip

"""Where the results of blocks go as they are done: one Dataset in memory, or a netCDF file."""

import numpy as np
import xarray as xr

from rigidmc.engine.layout import whole_lanes
from rigidmc.engine.memory import aligned
from rigidmc.observables import OBSERVABLES, rows_of
from rigidmc.observables.keep import flagged_values, joined, kept_values
from rigidmc.storage import Writer, open_result
from rigidmc.storage.schema import (
    attributes,
    coordinates,
    ensemble_variables,
    flagged_variables,
    length,
    member_variables,
    saved_variables,
)


def _split(scene, values, names):
    """{name: view} of the value rows (time, row, member) of the named observables."""
    parts, row = {}, 0
    for name in names:
        size = rows_of(scene.effects, name)
        parts[name] = values[:, row : row + size] if OBSERVABLES[name].dims else values[:, row]
        row += size
    return parts


class Counts:
    """The histograms of a scene, block by block."""

    def __init__(self, scene):
        self.of = scene.histograms()
        self.found: dict[str, np.ndarray] = {}

    def add(self, job, parts, status):
        """Count the members of a block that are well; parts : its values by name, at all times."""
        well = status[: job.size] == 0
        for label, one in self.of:
            values = parts[one.name][..., : job.size]
            counts = one.counts((values[:, one.component] if values.ndim == 3 else values)[:, well])
            self.found[label] = self.found.get(label, 0) + counts

    def variables(self):
        """{name: counts} of the results."""
        made: dict[str, np.ndarray] = {}
        for label, _ in self.of:
            counts = self.found[label]
            made |= {
                label: counts[:, 1:-1],
                f"{label}_below": counts[:, 0],
                f"{label}_above": counts[:, -1],
            }
        return made


class Memory:
    """Collects blocks in one Dataset; the kernel writes saved values straight to their place, where all of them are kept."""

    def __init__(self, scene, plan, more, direct=True):
        """direct : whether blocks may write there themselves"""
        self.scene, self.plan, self.more = scene, plan, more
        self.counts, self.flagged = Counts(scene), list[dict[str, np.ndarray]]()
        self.rows = rows_of(scene.effects, *scene.recorded())
        self.direct = (
            direct and scene.recorded() == scene.saved() and set(scene.kept().values()) <= {"full"}
        )
        self.width = whole_lanes(plan.members)
        self.out = aligned(
            plan.times.size * self.rows * self.width if self.direct else 0, float, np.empty
        )
        self.variables = member_variables(scene, plan.carried)
        kept = {} if self.direct else saved_variables(scene)
        self.arrays = {
            name: np.empty([length(d, plan) for d in v.dims], v.dtype)
            for name, v in {**self.variables, **kept}.items()
            if name not in plan.constant
        }

    def room(self, low, count):
        if self.direct:
            return self.out, self.width if self.rows else 0, low
        return buffer(self.scene, self.plan, count)

    def take(self, job, results):
        low = job.first - self.plan.first
        part = slice(low, low + job.size)
        if self.rows and (self.counts.of or not self.direct):
            values = job.out.reshape(self.plan.times.size, self.rows, -1)[
                ..., job.column : job.column + job.size
            ]
            parts = _split(self.scene, values, self.scene.recorded())
            self.counts.add(job, parts, results["status"])
            self.flagged.append(
                flagged_values(self.scene, job.first, parts, results["status"][: job.size])
            )
            for name, kept in (
                {} if self.direct else kept_values(self.scene, self.plan, parts).items()
            ):
                self.arrays[name][..., part] = kept
        for name in self.variables:
            if name not in self.arrays:  # the same for all members: one column serves
                column = results[name][..., :1]
                self.arrays[name] = np.broadcast_to(
                    column.copy(), (*column.shape[:-1], self.plan.members)
                )
            elif name not in self.plan.constant:
                self.arrays[name][..., part] = results[name][..., : job.size]

    def values(self):
        """{variable: array} of the result."""
        arrays = {**self.arrays, **self.counts.variables(), **joined(self.flagged)}
        if self.direct:
            values = self.out.reshape(self.plan.times.size, self.rows, self.width)[
                ..., : self.plan.members
            ]
            arrays |= _split(self.scene, values, self.scene.saved())
        return arrays

    def finish(self):
        arrays = self.values()
        saved = {
            **saved_variables(self.scene),
            **ensemble_variables(self.scene),
            **flagged_variables(self.scene),
        }
        variables = {
            name: (v.dims, arrays[name], v.attrs) for name, v in {**self.variables, **saved}.items()
        }
        return xr.Dataset(
            variables, coordinates(self.plan), {**attributes(self.scene, self.plan), **self.more}
        )

    def discard(self):
        self.out = np.empty(0)


def buffer(scene, plan, count):
    """(array, width, column) for what a block of so many members saves."""
    values, width = rows_of(scene.effects, *scene.recorded()), whole_lanes(count)
    return aligned(plan.times.size * values * width, float, np.empty), width if values else 0, 0


class File:
    """Writes blocks to a netCDF file as they are done."""

    def __init__(self, path, scene, plan, force, more=None):
        self.scene, self.plan, self.path = scene, plan, path
        self.counts, self.rows = Counts(scene), rows_of(scene.effects, *scene.recorded())
        self.names, self.flagged = (
            set(member_variables(scene, plan.carried)),
            list[dict[str, np.ndarray]](),
        )
        self.writer = Writer(path, scene, plan, force, more)

    def room(self, low, count):
        return buffer(self.scene, self.plan, count)

    def take(self, job, results):
        values = {k: v for k, v in results.items() if k in self.names}
        if self.rows:
            parts = _split(
                self.scene,
                job.out.reshape(self.plan.times.size, self.rows, job.width),
                self.scene.recorded(),
            )
            self.counts.add(job, parts, results["status"])
            self.flagged.append(
                flagged_values(self.scene, job.first, parts, results["status"][: job.size])
            )
            values |= kept_values(self.scene, self.plan, parts)
        self.writer.write(job.first, job.size, values)

    def finish(self):
        self.writer.write_all({**self.counts.variables(), **joined(self.flagged)})
        self.writer.finish()
        return open_result(self.path, made=True)

    def discard(self):
        self.writer.discard()

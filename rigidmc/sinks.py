"""Where the results of blocks go as they are done: one Dataset in memory, or a netCDF file."""

import numpy as np
import xarray as xr

from rigidmc.observables import OBSERVABLES, rows_of
from rigidmc.planning import whole_lanes
from rigidmc.storage import Writer, open_result
from rigidmc.storage.schema import attributes, coordinates, length, member_variables, saved_variables


def _split(scene, values):
    """{name: view} of the value rows (time, row, member) of each observable."""
    parts, row = {}, 0
    for name in scene.saved():
        size = rows_of(scene.effects, name)
        parts[name] = values[:, row : row + size] if OBSERVABLES[name].dims else values[:, row]
        row += size
    return parts


class Memory:
    """Collects blocks in one Dataset; the kernel writes saved values straight to their place."""

    def __init__(self, scene, plan, more):
        self.scene, self.plan, self.more = scene, plan, more
        self.width = whole_lanes(plan.members)
        self.values = rows_of(scene.effects, *scene.run.save)
        self.out = np.empty(plan.times.size * self.values * self.width)
        self.variables = member_variables(scene, plan.carried)
        self.arrays = {
            name: np.empty([length(d, plan) for d in v.dims], v.dtype)
            for name, v in self.variables.items()
            if name not in plan.constant
        }

    def room(self, low, count):
        return self.out, self.width if self.values else 0, low

    def take(self, job, results):
        part = slice(job.first - self.plan.first, job.first - self.plan.first + job.size)
        for name in self.variables:
            if name not in self.arrays:  # the same for all members: one column serves
                column = results[name][..., :1]
                self.arrays[name] = np.broadcast_to(column.copy(), (*column.shape[:-1], self.plan.members))
            elif name not in self.plan.constant:
                self.arrays[name][..., part] = results[name][..., : job.size]

    def finish(self):
        saved = saved_variables(self.scene)
        values = self.out.reshape(self.plan.times.size, self.values, self.width)[..., : self.plan.members]
        arrays = {**self.arrays, **_split(self.scene, values)}
        variables = {name: (v.dims, arrays[name], v.attrs) for name, v in {**self.variables, **saved}.items()}
        return xr.Dataset(variables, coordinates(self.plan), {**attributes(self.scene, self.plan), **self.more})

    def discard(self):
        self.out = np.empty(0)


class File:
    """Writes blocks to a netCDF file as they are done."""

    def __init__(self, path, scene, plan, force, more):
        self.scene, self.plan, self.path = scene, plan, path
        self.values = rows_of(scene.effects, *scene.run.save)
        self.names = set(member_variables(scene, plan.carried))
        self.writer = Writer(path, scene, plan, force, more)

    def room(self, low, count):
        width = whole_lanes(count)
        return np.empty(self.plan.times.size * self.values * width), width if self.values else 0, 0

    def take(self, job, results):
        values = {k: v for k, v in results.items() if k in self.names}
        if self.values:
            values |= _split(self.scene, job.out.reshape(self.plan.times.size, self.values, job.width))
        self.writer.write(job.first, job.size, values)

    def finish(self):
        self.writer.finish()
        return open_result(self.path)

    def discard(self):
        self.writer.discard()

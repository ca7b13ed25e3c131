"""Sinks of files: a netCDF file written block by block, and formats written at the end."""

from collections.abc import Mapping
from typing import Any

import xarray as xr

from rigidmc.files.netcdf import open_trusted
from rigidmc.files.outputs import Path
from rigidmc.results.export import write
from rigidmc.results.layout import ResultLayout, Selection
from rigidmc.results.sinks import (
    Arrays,
    HistogramCounts,
    MemorySink,
    Sink,
    concat_flagged,
    flagged_values,
    kept_values,
)
from rigidmc.results.writer import Writer, round_digits


class ExportSink(MemorySink):
    """A sink that collects blocks in one Dataset, and writes it as zarr or a table at the end."""

    def __init__(
        self,
        path: Path,
        layout: ResultLayout,
        members: Selection,
        force: bool,
        more: Mapping[str, Any],
    ) -> None:
        super().__init__(layout, members, more)
        self.path, self.force = path, force

    def finish(self) -> xr.Dataset:
        """Write the result and return it, rounded to the digits of a netCDF file."""
        dataset, digits = super().finish(), self.layout.scene.run.digits
        for name in self.layout.at_saves:
            if digits is not None and self.layout.is_rounded(name):
                variable = dataset[name]
                variable.values = round_digits(variable.values, digits)
                variable.attrs["significant_digits"] = digits
        write(dataset, self.path, self.force)
        return dataset


class FileSink(Sink):
    """A sink that writes finished blocks to a netCDF file."""

    def __init__(
        self,
        path: Path,
        layout: ResultLayout,
        members: Selection,
        force: bool,
        more: Mapping[str, Any] = {},
    ) -> None:
        self.layout, self.path = layout, path
        self.counts, self.flagged = HistogramCounts(layout.recording.histograms), list[Arrays]()
        self.writer = Writer(path, layout, members, {**layout.attributes(), **more}, force)

    def gather(self, job: Any, results: Arrays) -> tuple[int, int, Arrays, Arrays, Arrays]:
        """Return place and size of a finished block, its kept values, its counts and its flagged
        values."""
        layout, counts, flagged = self.layout, Arrays(), Arrays()
        values = {name: array for name, array in results.items() if name in layout.by_member}
        if layout.values:
            parts = layout.split(layout.saves(job.out, job.width))
            counts = self.counts.of(job, parts, results["status"])
            status = results["status"][: job.size]
            flagged = flagged_values(layout, job.members, parts, status)
            values |= kept_values(layout, parts)
        return job.first, job.size, values, counts, flagged

    def take(self, gathered: tuple[int, int, Arrays, Arrays, Arrays]) -> None:
        first, size, values, counts, flagged = gathered
        self.counts.add(counts)
        self.flagged.append(flagged)
        self.writer.write(first, size, values)

    def finish(self) -> xr.Dataset:
        self.writer.write_all({**self.counts.variables(), **concat_flagged(self.flagged)})
        self.writer.finish()
        return open_trusted(self.path)

    def discard(self) -> None:
        self.writer.discard()

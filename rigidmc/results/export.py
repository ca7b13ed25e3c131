"""Files of results, written block by block or at the end: netCDF and zarr in full, and tables with
one row per member.

    .nc, .zarr       the Dataset, as `xarray.open_dataset` reads it
    .csv, .parquet   `member_table`: variables with one value per member; of saves over time, only
                     the last one

All numbers keep their bits. `pandas.read_csv` before version 3.1 reads the last bit only with
float_precision="round_trip".
"""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from rigidmc.files.netcdf import open_trusted
from rigidmc.files.outputs import PartialFile, Path, naming_the_path, refuse_existing, write_bytes
from rigidmc.files.reading import harmless
from rigidmc.results.layout import ResultLayout, Selection
from rigidmc.results.sinks import Arrays, MemorySink, ResultSink, kept_values
from rigidmc.results.writer import Writer, netcdf_bytes, round_digits
from rigidmc.scene.derivatives import EACH

if TYPE_CHECKING:
    import pandas as pd

TIMES = {"time": "", "thinned_time": "_thinned"}  # {dimension: end of the names of variables}


def is_streamed(path: Path) -> bool:
    """Whether a run writes this file format block by block."""
    return _ending(path) == ".nc"


def write(dataset: xr.Dataset, path: Path, force: bool = False) -> None:
    """Write a result, completely or not at all, in the format given by the file extension.

    Raises OptionError for another extension or a missing package, and OutputExists.
    """
    refuse_existing(path, force)
    ending = _ending(path)
    if ending == ".nc":
        write_bytes(path, netcdf_bytes(dataset), force)
        return
    with PartialFile(path, force, folder=ending == ".zarr") as part, naming_the_path(path, part):
        if ending == ".zarr":
            # all readers support version 2; version 3 lacks fixed-length text so far
            plain = dataset.drop_encoding()
            plain.to_zarr(part, mode="w", zarr_format=2, write_empty_chunks=True)
        elif ending == ".csv":
            rows = member_table(dataset)
            for name in rows.select_dtypes(["object", "string"]):
                rows[name] = rows[name].map(harmless)
            rows.rename(columns=harmless).to_csv(part, index=False, lineterminator="\n")
        else:
            member_table(dataset).to_parquet(part, index=False)


def member_table(dataset: xr.Dataset) -> "pd.DataFrame":
    """Return a result as a table with one row per member.

    Columns are the variables with one value per member, and the components of vectors, such as
    start_omega_1 and attitude_final_w. Variables saved over time contribute their last save, as
    omega_final_1. `attrs` contains the attributes of the result and the units of the columns.
    """
    import pandas as pd

    columns: dict[str, Any] = {"member": dataset.member.values}
    units = {"member": "1"}
    for key, variable in dataset.data_vars.items():
        name = str(key)
        for time, ending in TIMES.items():
            if time in variable.dims and "member" in variable.dims:
                name = f"{name.removesuffix(ending)}_final"
                variable = variable.isel({time: -1})
        several = variable.ndim > 2 and "parameter" not in variable.dims
        if "member" not in variable.dims or several:
            continue
        for label, part in _parts(name, variable):
            columns[label] = part.values
            units[label] = _units(part)
    frame = pd.DataFrame(columns)
    frame.attrs = {key: _plain(value) for key, value in dataset.attrs.items()} | {"units": units}
    return frame


def _parts(name: str, variable: xr.DataArray) -> list[tuple[str, xr.DataArray]]:
    """Return (column, values) of a variable, or of each of its components."""
    others = [dim for dim in variable.dims if dim != "member"]
    if not others:
        return [(name, variable)]
    dim = others[0]
    labels = variable[dim].values if dim in variable.coords else range(1, variable.sizes[dim] + 1)
    return [
        part
        for i, label in enumerate(labels)
        for part in _parts(f"{name}_{label}", variable.isel({dim: i}))
    ]


def _units(part: xr.DataArray) -> str:
    """Return the units of a column; of a derivative, with the unit of its parameter."""
    units = str(part.attrs.get("units", "1"))
    if units.endswith(EACH):
        return f"{units.removesuffix(EACH)}per {part.parameter_unit.item()}"
    return units


def _plain(value: Any) -> Any:
    """Convert the value of an attribute for JSON."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _ending(path: Path) -> str:
    return os.path.splitext(path)[1].lower()


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


class FileSink(ResultSink):
    """A sink that writes finished blocks to a netCDF file."""

    def __init__(
        self,
        path: Path,
        layout: ResultLayout,
        members: Selection,
        force: bool,
        more: Mapping[str, Any] = {},
    ) -> None:
        super().__init__(layout, members)
        self.path = path
        self.writer = Writer(path, layout, members, {**layout.attributes(), **more}, force)

    def gather(self, job: Any, results: Arrays) -> tuple[Arrays, Arrays, int, int, Arrays]:
        """Return counts and flagged values of a finished block, its place, size and kept values."""
        layout, counts, flagged = self.layout, Arrays(), Arrays()
        values = {name: array for name, array in results.items() if name in layout.by_member}
        if layout.values:
            parts, counts, flagged = self.saved(job, results["status"])
            values |= kept_values(layout, parts)
        return counts, flagged, job.first, job.size, values

    def take(self, gathered: Any) -> None:
        super().take(gathered)
        self.writer.write(*gathered[2:])

    def finish(self) -> xr.Dataset:
        self.writer.write_all(self.of_ensemble())
        self.writer.finish()
        return open_trusted(self.path)

    def discard(self) -> None:
        self.writer.discard()

"""Write one netCDF4 file block by block under a temporary name, and rename it when complete."""

import contextlib
import math
import os
from collections.abc import Callable, Mapping
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.files.locks import refuse_lockless
from rigidmc.files.netcdf import close_once, in_netcdf_thread, naming_failures
from rigidmc.files.outputs import PartialFile, Path, refuse_existing
from rigidmc.results.layout import ResultLayout, Selection
from rigidmc.results.sinks import Arrays
from rigidmc.results.variables import Variable


def netcdf_bytes(dataset: xr.Dataset) -> bytes:
    """Return a Dataset as the bytes of a netCDF file, made in memory, because a full disk crashes
    the C library."""
    words = {name: {"dtype": "S1"} for name, v in dataset.variables.items() if v.dtype.kind in "UO"}
    return bytes(dataset.to_netcdf(engine="netcdf4", encoding=words))


def round_digits(values: NDArray[Any], digits: int) -> NDArray[Any]:
    """Round values to a number of digits: the last bits become zeros, which compress well. netCDF's
    own rounding turns inf into -0."""
    drop = 52 - math.ceil(digits * math.log2(10.0))
    if drop < 1:
        return values
    bits = (np.ascontiguousarray(values).view("i8") + (1 << (drop - 1))) & -(1 << drop)
    return np.where(np.isfinite(values) & np.isfinite(bits.view("f8")), bits.view("f8"), values)


class Writer:
    """A result file that grows by blocks of members, in constant memory."""

    def __init__(
        self,
        path: Path,
        layout: ResultLayout,
        members: Selection,
        attrs: Mapping[str, Any],
        force: bool = False,
        named: Callable[[str], str] | None = None,
    ) -> None:
        """attrs : of the file

        named : for shards, returns the final path of a finished file. Every chunk then has a
            checksum, so that reading a flipped bit is an error.
        """
        if named is None:
            refuse_existing(path, force, "netCDF files")
        # without locks the C library only reports "Permission denied"
        refuse_lockless(os.path.dirname(os.path.abspath(path)))
        self.path, self._named = path, named
        self._file: Any = None
        self.layout, self.members, self._digits = layout, members, dict[str, int]()
        self._part = PartialFile(path, force)
        try:
            with naming_failures(self.path):
                in_netcdf_thread(self._begin, attrs)
        except BaseException:
            self.discard()
            raise

    def _begin(self, attrs: Mapping[str, Any]) -> None:
        self._file = netCDF4.Dataset(self._part.path, "w", format="NETCDF4", clobber=True)
        self._file.set_fill_off()
        self.variables = variables = self.layout.variables
        # indices are written together with the members, to save memory
        coordinates = self.layout.axes.coordinates()
        sizes = self.layout.axes.lengths(self.members.size)
        used = [dim for dims, *_ in (*coordinates.values(), *variables.values()) for dim in dims]
        for dim in dict.fromkeys(used):
            self._file.createDimension(dim, sizes[dim])
        for name, (dims, values, about) in coordinates.items():
            self._define_coordinate(name, dims, values, about)
        for name, variable in variables.items():
            self._define(name, variable, sizes)
        self._file.setncatts(attrs)

    def _define_coordinate(
        self, name: str, dims: tuple[str, ...], values: NDArray[Any], attrs: dict[str, Any]
    ) -> None:
        file = self._file
        if values.dtype.kind == "U":
            # as characters: netCDF 4.10.1 crashes when it reopens a file with strings
            letters = np.char.encode(values, "utf-8")
            size = letters.itemsize
            dims, attrs = (*dims, f"string{size}"), {**attrs, "_Encoding": "utf-8"}
            if dims[-1] not in file.dimensions:
                file.createDimension(dims[-1], size)
            variable = file.createVariable(name, "S1", dims)
            variable.set_auto_chartostring(False)
            values = netCDF4.stringtochar(letters)
        else:
            variable = file.createVariable(name, values.dtype, dims)
        variable.setncatts(attrs)
        if name != "member":
            variable[:] = values

    def _define(self, name: str, of: Variable, sizes: Mapping[str, Any]) -> None:
        (dims, dtype, attrs), layout, run = of, self.layout, self.layout.scene.run
        # a chunk holds a block of members and up to 128 times: cheap to write, and to read by
        # member or by time
        most = {"member": self.members.block, "parameter": 1}
        chunks = [min(sizes[dim] or 32, most.get(dim, 128)) for dim in dims]
        same = name in layout.constant
        # equal values compress faster without shuffled bytes: 0.6 instead of 0.4 GB/s
        packed: dict[str, Any] = {"compression": "zlib", "complevel": 1, "shuffle": not same}
        if not (run.compress or run.digits is not None or same):
            packed = {}
        if (digits := run.digits) is not None and layout.is_rounded(name):
            self._digits[name] = digits
            attrs = {**attrs, "significant_digits": digits}
        variable = self._file.createVariable(
            name, dtype, dims, chunksizes=chunks, fletcher32=self._named is not None, **packed
        )
        if "parameter" in dims:
            attrs = {**attrs, "coordinates": "parameter_unit"}
        variable.setncatts(attrs)
        variable.set_auto_maskandscale(False)  # a third of the time of a write

    def write(self, first: int, count: int, values: Arrays) -> None:
        """Write {name: array, members last} for `count` members from place `first` on."""
        low = first - self.members.first
        some = {name: array[..., :count] for name, array in values.items()}
        self._put({"member": self.members.indices(first, count), **some}, slice(low, low + count))

    def write_all(self, values: Arrays) -> None:
        """Write {name: array} of variables without a member dimension."""
        self._put(values, slice(None))

    def _put(self, values: Arrays, part: slice) -> None:
        """Write {name: array} to a part of the last dimension."""

        def put() -> None:
            for name, array in values.items():
                self._file.variables[name][..., part] = self._rounded(name, array)

        with naming_failures(self.path):
            in_netcdf_thread(put)

    def _rounded(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        digits = self._digits.get(name)
        return values if digits is None else round_digits(values, digits)

    def finish(self) -> str:
        """Close the file, make it durable and rename it; return its path."""
        with naming_failures(self.path):
            in_netcdf_thread(self._close)
        final = os.fspath(self.path) if self._named is None else self._named(self._part.path)
        self._part.finish(final)
        return final

    def discard(self) -> None:
        """Close and delete the partial file."""
        with contextlib.suppress(RuntimeError):
            in_netcdf_thread(self._close)
        self._part.discard()

    def _close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            close_once(file)


def write_columns(
    path: Path,
    columns: Arrays,
    attrs: Mapping[str, str] = {},
    named: Callable[[str], str] | None = None,
) -> str:
    """Write {name: array} as a separate small file and return its path; dimensions are named by
    their lengths.

    named : returns the final path for the path of the written file
    """

    def write_to(part: str) -> None:
        file = netCDF4.Dataset(part, "w", format="NETCDF4")
        try:
            file.setncatts(attrs)
            for name, values in columns.items():
                dims = [f"{size}" for size in values.shape]
                for dim, size in zip(dims, values.shape, strict=True):
                    if dim not in file.dimensions:
                        file.createDimension(dim, size)
                file.createVariable(name, values.dtype, dims)[:] = values
        finally:
            close_once(file)

    part = PartialFile(path)
    try:
        with naming_failures(path):
            in_netcdf_thread(write_to, part.path)
        final = os.fspath(path) if named is None else named(part.path)
        part.finish(final)
        return final
    except BaseException:
        part.discard()
        raise

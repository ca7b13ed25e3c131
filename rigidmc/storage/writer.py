"""One netCDF4 file: written block by block under a temporary name, renamed when whole."""

import contextlib
import ctypes
import math
import os
import shutil
import threading
import warnings
from typing import Any

import netCDF4
import numpy as np
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

from rigidmc.engine.threads import threads_of
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.files.outputs import Part, refuse_existing, refuse_lockless, write_bytes
from rigidmc.files.trial import refuse_unreadable
from rigidmc.storage.border import ROWS, as_result
from rigidmc.storage.schema import (
    attributes,
    coordinates,
    ensemble_variables,
    flagged_variables,
    is_rounded,
    length,
    member_variables,
    saved_variables,
)

_opening = threading.Lock()


def alone(function, *arguments):
    """Call a function that calls the C library, which is not made for threads, while no one else does.

    xarray holds its lock while it reads values and when it closes what was dropped, which happens in any thread and at any time; it does
    not while it opens a file, so that `open_result` holds another. Without them a run crashed within a second of results being dropped,
    or opened, beside it.

    The main thread has it done by another one: a signal interrupts the main thread anywhere, between taking a lock and knowing that it has it too, and
    a run then waited for itself for ever (once in some 60 runs with two signals). So it only stops waiting, and what comes next waits for the call to end.
    """

    def called():
        with _opening, NETCDF4_PYTHON_LOCK:
            return function(*arguments)

    if threading.current_thread() is threading.main_thread():
        return threads_of("netCDF", 1).submit(called).result()
    return called()


def _close(file):
    """Close a file once: where that fails, the C library keeps a number for what it has freed, and crashes when it is closed again."""
    try:
        file.close()
    except BaseException:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(file))  # the collector would close it again
        raise


@contextlib.contextmanager
def _naming(path):
    """The C library tells that something went wrong, and neither with what file nor why."""
    try:
        yield
    except RuntimeError as error:
        free = shutil.disk_usage(os.path.dirname(os.path.abspath(path))).free
        raise OSError(
            f"{path}: could not be written, with {free / 1e9:.2f} GB free there: {error}"
        ) from None


def write(dataset, path, force=False):
    """Write a Dataset whole or not at all."""
    refuse_existing(path, force)
    write_bytes(path, encoded(dataset), force)


def encoded(dataset):
    """The bytes of a Dataset as a netCDF file. They are made in memory: after a full disk the C library crashes."""
    words = {name: {"dtype": "S1"} for name, v in dataset.variables.items() if v.dtype.kind in "UO"}
    return dataset.to_netcdf(engine="netcdf4", encoding=words)


class Writer:
    """A result file that grows by blocks of members; memory does not grow with it."""

    def __init__(self, path, scene, plan, force=False, more=None, attrs=None, named=None):
        """attrs : in the place of the attributes of a result;  named : of shards, the path that a finished file has to have: each of its chunks
        then has a sum, so that a flipped bit is an error to whoever reads it"""
        if named is None:
            refuse_existing(path, force)
        refuse_lockless(
            os.path.dirname(os.path.abspath(path))
        )  # without locks the C library only says "Permission denied"
        self.path, self._named = path, named
        self._file: Any = None
        self._part = Part(path, force)
        self._first, self._digits = plan.first, dict[str, int]()
        try:
            with _naming(self.path):
                alone(
                    self._begin,
                    scene,
                    plan,
                    attributes(scene, plan) if attrs is None else attrs,
                    more or {},
                )
        except BaseException:
            self.discard()
            raise

    def _begin(self, scene, plan, attrs, more):
        self._file = netCDF4.Dataset(self._part.path, "w", format="NETCDF4", clobber=True)
        self._define(scene, plan, attrs)
        self._file.setncatts(more)

    def _define(self, scene, plan, attrs_of_all):
        file = self._file
        file.set_fill_off()
        variables = {
            **member_variables(scene, plan.carried),
            **saved_variables(scene),
            **ensemble_variables(scene),
        }
        self.variables = variables = variables | flagged_variables(scene)
        known = coordinates(
            plan._replace(members=0)
        )  # which they are is written with the members: memory does not grow with them
        used = [*known, *(dim for v in variables.values() for dim in v.dims)]
        for dim in dict.fromkeys(used):
            file.createDimension(dim, length(dim, plan))
        for name, (dims, values, attrs) in known.items():
            if (
                values.dtype.kind == "U"
            ):  # as characters: netCDF 4.10.1 crashes when a file with strings is opened once more
                letters = np.char.encode(values, "utf-8")
                dims, attrs, size = (
                    (*dims, f"string{letters.itemsize}"),
                    {**attrs, "_Encoding": "utf-8"},
                    letters.itemsize,
                )
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
        for name, (dims, dtype, attrs) in variables.items():
            sizes = [length(d, plan) for d in dims]
            # one chunk holds a block of members and up to 128 times: cheap to write, and to read by member or by time
            chunks = [
                min(size or 32, plan.block if d == "member" else 128)
                for d, size in zip(dims, sizes, strict=True)
            ]
            small, same = scene.run.compress or scene.run.digits is not None, name in plan.constant
            # of what is the same for all, to sort bytes by their places takes longer than to compress them: 0.4 against 0.6 GB/s
            packed: dict[str, Any] = (
                {"compression": "zlib", "complevel": 1, "shuffle": not same}
                if small or same
                else {}
            )
            if is_rounded(scene, dims, dtype):
                self._digits[name] = scene.run.digits
                attrs = {**attrs, "significant_digits": scene.run.digits}
            variable = file.createVariable(
                name, dtype, dims, chunksizes=chunks, fletcher32=self._named is not None, **packed
            )
            variable.setncatts(attrs)
            variable.set_auto_maskandscale(False)  # a third of the time of a write
        file.setncatts(attrs_of_all)

    def write(self, first, count, values):
        """Write {name: array with the member dimension last} for members first ... first + count - 1."""
        part = slice(first - self._first, first - self._first + count)

        def put():
            self._file.variables["member"][part] = np.arange(first, first + count)
            for name, array in values.items():
                self._file.variables[name][..., part] = self._rounded(name, array[..., :count])

        with _naming(self.path):
            alone(put)

    def write_all(self, values):
        """Write {name: array} of variables that are not by members."""

        def put():
            for name, array in values.items():
                self._file.variables[name][:] = self._rounded(name, array)

        with _naming(self.path):
            alone(put)

    def _rounded(self, name, values):
        """Values as they are kept: of those with so many digits the last bits are zeros, which compresses them. netCDF's own way makes -0 of inf."""
        digits = self._digits.get(name)
        if digits is None:
            return values
        drop = 52 - math.ceil(digits * math.log2(10.0))
        if drop < 1:
            return values
        bits = (np.ascontiguousarray(values).view("i8") + (1 << (drop - 1))) & -(1 << drop)
        return np.where(np.isfinite(values) & np.isfinite(bits.view("f8")), bits.view("f8"), values)

    def finish(self):
        """Close, make durable and give the file its name."""
        with _naming(self.path):
            alone(self._close)
        self._part.finish(None if self._named is None else self._named(self._part.path))

    def discard(self):
        """Leave nothing behind."""
        with contextlib.suppress(RuntimeError):
            alone(self._close)
        self._part.discard()

    def _close(self):
        file, self._file = self._file, None
        if file is not None:
            _close(file)


def read(path, *names, mark=None):
    """{name: array} of variables of a file as they were written, of all if none are named. SceneError for a shard of another mark,
    a damaged file and a missing variable."""

    def values():
        with netCDF4.Dataset(path) as file:
            if mark is not None and str(getattr(file, "run", None)) != mark:
                raise SceneError(
                    "",
                    "shard",
                    None,
                    "is of another run: another scene, seed, rows or code",
                    file=path,
                )
            file.set_auto_mask(False)
            file.set_auto_scale(False)
            file.set_auto_chartostring(False)
            return {name: file[name][:] for name in names or file.variables}

    try:
        return alone(values)
    except (OSError, RuntimeError, IndexError) as error:
        if (
            isinstance(error, OSError) and (error.errno or 0) > 0
        ):  # an error of the system; those of the library are negative
            raise
        raise SceneError(
            "", "file", None, f"is damaged, or is not what it should be: {error}", file=path
        ) from None


def write_columns(path, columns):
    """Write {name: array}, members last, as a small file of its own."""

    def write_to(part):
        file = netCDF4.Dataset(part, "w", format="NETCDF4")
        try:
            for name, values in columns.items():
                dims = [f"{size}" for size in values.shape[:-1]] + ["member"]
                for dim, size in zip(dims, values.shape, strict=True):
                    if dim not in file.dimensions:
                        file.createDimension(dim, size)
                file.createVariable(name, values.dtype, dims)[:] = values
        finally:
            _close(file)

    with Part(path) as part, _naming(path):
        alone(write_to, part)


def scene_of(source, settings=(), allow_code=False):
    """The scene of a result, a file or a Dataset, with its columns where it had one row per member; `allow_code` as of `rigidmc.scene.file.loads`."""
    from rigidmc.scene.file import loads

    if isinstance(source, str):
        with open_result(
            source
        ) as file:  # by xarray: netCDF4 1.7.5 crashes when it opens once more what xarray has open
            return scene_of(file, settings, allow_code)
    file = source.encoding.get("source", "result")

    def stored(name):
        if name not in source.variables or source[name].dims[-1:] != ("member",):
            return None
        members, rows = (
            source.member.values,
            source[name].values,
        )  # any selection, in any order: members between have no rows, and need none
        count = int(members.max()) + 1
        if count > max(ROWS, 100 * members.size):
            rule = f"has the rows of {members.size:,} members only, up to member {count - 1:,}: open the whole result"
            raise SceneError("", "member", None, rule, file=file)
        whole = np.repeat(rows[..., :1], count, axis=-1)
        whole[..., members] = rows
        return whole

    return loads(scene_text(source), file, settings, stored, allow_code=allow_code)


def scene_text(dataset):
    """The TOML text of the scene of a result; SceneError for a Dataset that is none."""
    text = dataset.attrs.get("scene")
    if not isinstance(text, str):
        file = dataset.encoding.get("source")
        raise SceneError(
            "",
            "scene",
            None,
            "not a result of rigidmc: it has no attribute 'scene' with the text of one",
            file=file,
        )
    return text


def open_result(path, made=False):
    """A result as an xarray Dataset, read lazily; SceneError where the file is no result of rigidmc, see `rigidmc.storage.border`.

    made : whether this process has just written the file, which then needs no checks
    """
    import xarray as xr

    if os.path.isdir(path):
        raise SceneError("", "file", None, "is a folder, and no result of rigidmc", file=path)
    if made:
        with _opening:
            return xr.open_dataset(path, engine="netcdf4")
    refuse_unreadable(path)
    try:
        with _opening:  # undecoded: attributes of a file are not to be trusted
            dataset = xr.open_dataset(path, engine="netcdf4", decode_cf=False)
    except (ValueError, TypeError, RuntimeError, KeyError, IndexError) as error:
        raise SceneError(
            "", "file", None, f"is damaged, or no result of rigidmc: {error}", file=path
        ) from None
    try:
        scene_text(dataset)
        if "status" not in dataset:
            rule = "a map, not a result with members; rigidmc.views.maps.stability_map(xarray.open_dataset(...)) draws it"
            raise SceneError("", "file", None, rule, file=path)
        found, strange = as_result(dataset, os.fspath(path))
    except BaseException:
        dataset.close()
        raise
    if strange:
        names = ", ".join(strange[:5]) + (
            f" and {len(strange) - 5:,} more" if len(strange) > 5 else ""
        )
        warnings.warn(
            f"{path}: left out variables that no result of its scene has: {names}",
            SceneWarning,
            stacklevel=3,
        )
    found.set_close(dataset.close)
    found.encoding["source"] = dataset.encoding.get("source", os.path.abspath(path))
    return found

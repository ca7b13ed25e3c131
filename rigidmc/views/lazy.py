"""Functions of arrays, applied to what a result holds: lazily, where the result is read lazily."""

from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

import xarray as xr

Dims = Sequence[str]


def apply_lazily(
    function: Callable[..., Any],
    given: Sequence[tuple[xr.DataArray, Dims]],
    out: Dims = (),
    sizes: Mapping[str, int] = MappingProxyType({}),
) -> xr.DataArray:
    """A function of arrays, whose last dimensions are named, of DataArrays.

    given : (DataArray, its last dimensions) each;  out : the last dimensions of the values
    sizes : of those among them that are new

    With dask what is lazy stays lazy, and is computed block by block when it is asked for; without
    dask it is computed now.
    """
    arrays = [_lazy(array) for array, _ in given]
    made: xr.DataArray = xr.apply_ufunc(
        function,
        *arrays,
        input_core_dims=[list(dims) for _, dims in given],
        output_core_dims=[list(out)],
        dask="parallelized",
        output_dtypes=[float],
        dask_gufunc_kwargs={
            "allow_rechunk": True,
            "output_sizes": dict(sizes),
        },
    )
    return made


def _lazy(array: xr.DataArray) -> xr.DataArray:
    """What is not in memory as an array of dask, in blocks as the file has them."""
    if array.chunks is not None or array.variable._in_memory or find_spec("dask") is None:
        return array
    return array.chunk({})

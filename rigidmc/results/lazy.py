"""Apply functions of arrays to the variables of a result: lazily if the result is lazy."""

from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

import xarray as xr

Dims = Sequence[str]


def apply_lazily(
    function: Callable[..., Any],
    arguments: Sequence[tuple[xr.DataArray, Dims]],
    out: Dims = (),
    sizes: Mapping[str, int] = MappingProxyType({}),
) -> xr.DataArray:
    """Apply a function of arrays to DataArrays.

    arguments : a (DataArray, its last dimensions) for each argument of the function
    out : last dimensions of the result;  sizes : {dimension: size} of new dimensions

    With dask, lazy variables stay lazy, and dask computes them block by block on demand; without
    dask, the function runs now.
    """
    arrays = [_lazy(array) for array, _ in arguments]
    made: xr.DataArray = xr.apply_ufunc(
        function,
        *arrays,
        input_core_dims=[list(dims) for _, dims in arguments],
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
    """Make an array that is not in memory a dask array, in the blocks of the file."""
    if array.chunks is not None or array.variable._in_memory or find_spec("dask") is None:
        return array
    return array.chunk({})

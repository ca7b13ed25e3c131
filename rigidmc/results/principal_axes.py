"""Axes of a result: from those in which the body is described to its principal axes, and back.

With a the quaternion of the principal axes in the described axes (`principal_axes` of the result):

    v_principal = A^T v,   q_principal = q a

Functions of arrays are applied lazily if the result is lazy.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.physics.dynamics.so3 import conjugate, into_body, multiply

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
        dask_gufunc_kwargs={"allow_rechunk": True, "output_sizes": dict(sizes)},
    )
    return made


def _lazy(array: xr.DataArray) -> xr.DataArray:
    """Make an array that is not in memory a dask array, in the blocks of the file."""
    if array.chunks is not None or array.variable._in_memory or find_spec("dask") is None:
        return array
    return array.chunk({})


# vectors of the body that a result may have, besides the momenta of rotors
_VECTORS = ("omega", "momentum", "start_omega", "start_momentum", "centre")
_ATTITUDES = ("attitude", "start_attitude")


def is_described(ds: xr.Dataset) -> bool:
    """Return whether a result is in axes that differ from the principal axes of its bodies."""
    return ds.attrs.get("body_axes") == "described" and "principal_axes" in ds


def principal(ds: xr.Dataset, name: str) -> xr.DataArray:
    """Return a vector of the body, or its attitude, in the principal axes.

    name : variable of the result; lazy if the result is lazy
    """
    if not is_described(ds):
        return ds[name]
    if "quat" in ds[name].dims:
        return _by_components(ds, name, "quat", multiply)
    return _by_components(ds, name, "axis", lambda v, a: into_body(a, v))


def described(ds: xr.Dataset, values: xr.DataArray) -> xr.DataArray:
    """Return a vector of the body, or its attitude, in the axes of the result, from the principal
    axes."""
    if not is_described(ds):
        return values
    named = ds[["principal_axes"]].assign(values=values)
    if "quat" in values.dims:
        return _by_components(named, "values", "quat", lambda q, a: multiply(q, conjugate(a)))
    return _by_components(named, "values", "axis", lambda v, a: into_body(conjugate(a), v))


def in_principal_axes(ds: xr.Dataset) -> xr.Dataset:
    """Return a result with its states, centres and rotors in the principal axes."""
    if not is_described(ds):
        return ds
    rotors = [
        name
        for name in map(str, ds.data_vars)
        if name.endswith("_momentum") and name not in _VECTORS
        if "axis" in ds[name].dims and "parameter" not in ds[name].dims
    ]
    names = [name for name in (*_VECTORS, *_ATTITUDES, *rotors) if name in ds]
    turned = ds.assign({name: principal(ds, name) for name in names})
    return turned.assign_attrs(body_axes="principal")


def _by_components(
    ds: xr.Dataset, name: str, dim: str, turn: Callable[[Any, Any], tuple[Any, ...]]
) -> xr.DataArray:
    """Apply a function of (components, components of a), with dimensions kept in their order."""
    variable = ds[name]

    def turned(v: Any, a: Any) -> Any:
        parts = turn(tuple(np.moveaxis(v, -1, 0)), tuple(np.moveaxis(a, -1, 0)))
        return np.stack(np.broadcast_arrays(*parts), -1)

    made = apply_lazily(turned, [(variable, [dim]), (ds.principal_axes, ["quat"])], [dim])
    # a vector that all members share differs between them in other axes
    dims = [*variable.dims, *(d for d in made.dims if d not in variable.dims)]
    made = made.transpose(*dims).assign_coords(variable.coords)
    return made.rename(variable.name).assign_attrs(variable.attrs)

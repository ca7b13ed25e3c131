"""Variables of members by name: a Dataset, or the arrays of a block of members."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import xarray as xr
from numpy.typing import NDArray


class Column(NamedTuple):
    """A variable of a block of members: values (n,) or (3, n), and attributes.

    It has what measures use of a variable of a Dataset. To make a Dataset of each block would cost
    more than the sums over its members.
    """

    values: NDArray[Any]
    attrs: Mapping[str, Any]

    def sel(self, axis: int) -> "Column":
        """Return component 1, 2 or 3 of a vector."""
        return Column(self.values[axis - 1], self.attrs)


Columns = xr.Dataset | Mapping[str, Column]

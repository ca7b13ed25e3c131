"""The prior of a posterior, and the coordinates z in which draws move.

A parameter has a flat prior between its limits. It is its own coordinate, or x = low + exp(z) above
a limit. Second moments J_i move as z_i = ln J_i. Their shares J_i/S of the sum S have a flat prior:
all shapes of bodies are equally likely, and with them all ratios I_i/(2 S) = (1 - J_i/S)/2. ln S
has a flat prior. Readings that show ratios alone leave S unknown: then S is that of the scene, and
all draws are bodies of this size. The derivatives of x by z make the density of z

    ln p = z (above a limit) + sum of z_i - 3 ln S (of a body) - 4 ln |q| (of a quaternion)

Pooled parameters differ between records: the z of each is from a normal distribution. Its mean m
has a flat prior, its spread t the positive half of a normal distribution, of scale 1 above a limit,
else of the largest value that a record alone has. A value moves as e = (z - m)/t, or as z itself if
its record alone shows it more closely than the values differ: draws of e would then follow a thin
curved sheet. Source: Betancourt & Girolami, arXiv:1312.0906.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import OptionError, unknown
from rigidmc.studies.fit.parameters import EXTREME, MOMENTS, FitParameters
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.visible import TAKES_PART, Seen, in_words

LOOSE = 0.1  # spread of ln S where S is given, and of ln |q|: they change no draw
TINY = 1e-30  # a step along the imaginary axis: derivatives without rounding


class Pool(NamedTuple):
    """A component that the records draw from one normal distribution: its places, whether z of a
    record moves, not e, the places of m and of ln t, and the scale of the prior of t."""

    name: str
    places: NDArray[np.int64]
    is_centred: NDArray[np.bool_]
    mean: int
    spread: int
    scale: float


class Prior:
    """The prior and the coordinates of draws. ln_sum : ln S where the readings do not show it"""

    def __init__(
        self, parameters: FitParameters, x: Array, shown: Seen, pooled: Sequence[str] = ()
    ) -> None:
        """x : coordinates of the best answer;  shown : what the readings show there;  pooled :
        names of parameters

        Raises OptionError where the readings leave more unknown than the size of the body.
        """
        self.parameters, self.unit, self.moments = parameters, shown.unit, parameters.moments
        self.has_limit = np.isfinite(parameters.low) & ~np.isfinite(parameters.high)
        self.ln_sum: float | None = None
        if len(shown.unseen):
            places = self.moments.ravel()
            # not of coordinates: that of a second moment of 0 may do anything
            part = shown.unseen @ parameters.slopes(x)[places].T / parameters.values(x)[places]
            is_size = part.shape == (1, 3) and shown.shares[0, places].max() > TAKES_PART
            if not is_size or np.ptp(part) > 1e-3 * np.abs(part).max():
                lines = "; ".join(in_words(parameters, x, shown))
                raise OptionError(f"{lines}. Draws would repeat the prior there", at="posterior")
            self.ln_sum = float(np.log(0.5 * parameters.nominal[MOMENTS].sum()))
        self.pools, self.is_flat, self.size = list[Pool](), self.has_limit.copy(), parameters.size
        self.is_flat[self.moments] = False
        own = [c.name for c in parameters.columns if c.stream < 0 and not c.is_shared]
        own = [name for name in own if name != MOMENTS and not name.startswith("start.")]
        deviation = np.sqrt(np.diag(shown.inverse)) / np.diag(self.slopes(self.inverse(x))[0])
        for name in pooled:
            if name not in own:
                raise unknown("number of --each", own, at="pool", value=name, error=OptionError)
            every = parameters.places_of(name)
            for k, places in enumerate(every.T):
                word = f"{name}.{k + 1}" if every.shape[1] > 1 else name
                is_centred = deviation[places] < np.std(self.inverse(x)[places])
                # of a number with a limit, x is its logarithm: 1 is a factor e, in any unit
                scale = float(np.maximum(np.abs(x[places]), deviation[places]).max())
                scale = 1.0 if self.has_limit[places[0]] else scale
                self.pools.append(Pool(word, places, is_centred, self.size, self.size + 1, scale))
                self.is_flat[places] = False
                self.size += 2

    def of(self, z: Any) -> tuple[Any, Any]:
        """Return (coordinates of the fit (trials, n), logarithm of the prior) of draws z (trials,
        size), real or complex."""
        x, ln = np.array(z[:, : self.parameters.size]), np.zeros(z.shape[0], z.dtype)
        for pool in self.pools:
            mean, ln_t, each = z[:, [pool.mean]], z[:, [pool.spread]], z[:, pool.places]
            x[:, pool.places] = np.where(pool.is_centred, each, mean + np.exp(ln_t) * each)
            apart = np.where(pool.is_centred, (each - mean) * np.exp(-ln_t), each)
            ln += ln_t[:, 0] * (1 - np.count_nonzero(pool.is_centred))
            ln -= 0.5 * (np.exp(ln_t[:, 0]) / pool.scale) ** 2 + 0.5 * (apart**2).sum(1)
        ln += x[:, self.is_flat].sum(1)
        x[:, self.has_limit] = self.parameters.low[self.has_limit] + np.exp(x[:, self.has_limit])
        for places in self.moments:
            total = np.log(np.exp(x[:, places]).sum(1))
            ln += x[:, places].sum(1) - 3.0 * total
            if self.ln_sum is not None:
                ln -= 0.5 * ((total - self.ln_sum) / LOOSE) ** 2
                x[:, places] += (self.ln_sum - total)[:, None]
        for places in self.parameters.quaternions:
            length = 0.5 * np.log((x[:, places] ** 2).sum(1))
            ln -= 4.0 * length + 0.5 * (length / LOOSE) ** 2
        return x, ln

    def inverse(self, x: Array) -> Array:
        """Return the draw at coordinates x of the fit, or beside x where it is on a limit."""
        z, some = np.concatenate([x, np.zeros(self.size - x.size)]), np.flatnonzero(self.has_limit)
        inside = np.maximum(x - self.parameters.low, 0.1 * self.unit)
        z[some] = np.log(inside[some])
        least = self.parameters.low[self.moments] + 0.5 * EXTREME
        z[self.moments] = np.maximum(z[self.moments], least)  # a plate has a second moment of 0
        for pool in self.pools:
            each = z[pool.places]
            z[pool.mean], spread = each.mean(), max(float(each.std()), 1e-3 * pool.scale)
            z[pool.spread] = np.log(spread)
            z[pool.places] = np.where(pool.is_centred, each, (each - z[pool.mean]) / spread)
        return z

    def slopes(self, z: Array) -> tuple[Array, Array]:
        """Return the derivatives of the coordinates of the fit (n, size) and of the logarithm of
        the prior (size,) by z (size,)."""
        x, ln = self.of(z + 1j * TINY * np.eye(z.size))
        return x.imag.T / TINY, ln.imag / TINY

    def names(self) -> list[tuple[str, str]]:
        """Return (name, parameter with the same unit, "" for a pure number) of the quantities."""
        names = self.parameters.names
        found = [(name, name) for name in names]
        for *some, last in self.moments:
            found += [(f"{names[i]}/{names[last]}", "") for i in some]
        for pool in self.pools:
            like, own = names[pool.places[0]], self.has_limit[pool.places[0]]
            found += [(f"{pool.name} mean", like), (f"{pool.name} spread", "" if own else like)]
        return found

    def quantities(self, z: Array) -> Array:
        """Return all parameters, ratios of moments, means and spreads (draws, number) of draws z
        (draws, size)."""
        values = np.stack([self.parameters.values(x) for x in self.of(z)[0]])
        more, middle = [values[:, p[:2]] / values[:, p[2:]] for p in self.moments], np.array(z)
        for pool in self.pools:
            middle[:, pool.places] = np.where(pool.is_centred, z[:, [pool.mean]], 0.0)
        centre = self.of(middle)[0]
        for pool in self.pools:
            more.append(np.column_stack([centre[:, pool.places[0]], np.exp(z[:, pool.spread])]))
        return np.concatenate([values, *more], axis=1)

"""The sums of a fit, computed from the saves of members: see
`rigidmc.engine.kernel.normal_equations`."""

from types import SimpleNamespace

import numpy as np

from rigidmc.engine.compile_time import announce_compiling
from rigidmc.engine.compiler.kernels import (
    KernelKey,
    call_kernel,
    compile_kernel,
    config,
    is_compiled,
)
from rigidmc.engine.kernel.normal_equations import RECORD, Samples, add_samples
from rigidmc.engine.program import fill_record

_KEY = KernelKey(add_samples, (), "float64", 0, "r", RECORD)


def sum_samples(samples: Samples) -> None:
    """Add the samples of a stream to the sums of members, in place."""
    with announce_compiling("a fit", () if is_compiled(_KEY) else ("sums",)):
        compiled, _alive = compile_kernel(_KEY)
    empty = SimpleNamespace() if config.DISABLE_JIT else np.zeros(1, RECORD)
    call_kernel(compiled, "p", fill_record(empty, samples))

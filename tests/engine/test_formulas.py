"""Formulas over arrays give the values of the plain function, in packed machine code.

For any number of elements, threads and rows.
"""

import math
import platform
import re
from typing import NamedTuple

import numpy as np
import pytest

from rigidmc.engine.compiler.kernels import WIDTH, KernelKey, config
from rigidmc.engine.formulas import FILL, MAX_CALL, evaluate, fill
from rigidmc.engine.kernel.layout import LANES
from rigidmc.mechanics.free_orbit import FreeStateFormula
from rigidmc.mechanics.lagrange_orbit import LagrangeStateFormula
from rigidmc.physics.dynamics.principal_axes import Principal
from tests.tools.assembly import assembly_of_key


class Product(NamedTuple):
    """a b + c and a square root: a formula of this file, compiled in this process only."""

    a: float
    b: float
    c: float

    def values(self):
        return self.a * self.b + self.c, math.sqrt(self.a)


@pytest.mark.parametrize("count", [1, LANES - 1, LANES, LANES + 1, 2 * MAX_CALL + 5])
def test_values_are_those_of_the_plain_function_for_any_count_and_threads(count):
    columns = np.random.default_rng(count).uniform(0.5, 1.0, (3, count))
    one, two = (evaluate(Product, 2, columns, threads=threads) for threads in (1, 2))
    assert (one == two).all()
    plain = np.array([Product(*column).values() for column in columns[:, :50].T]).T
    assert np.abs(one[:, :50] - plain).max() < 3e-16  # 1.1e-16: fused multiply-add


def test_an_elements_bits_do_not_depend_on_its_neighbours():
    columns = np.random.default_rng(1).uniform(0.5, 1.0, (6, 100))
    whole, part = (evaluate(Principal, 12, each) for each in (columns, columns[:, 37:80]))
    assert (whole[:, 37:80] == part).all()


def test_fields_come_from_a_table_by_index():
    table, index = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([1, 0, 1])
    last = np.array([[0.5, 0.25, 0.125]])
    assert evaluate(Product, 2, last, table, index)[0].tolist() == [12.5, 2.25, 12.125]


@pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="reads x86-64 assembly"
)
@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
def test_closed_forms_are_packed_arithmetic():
    words = "vdivpd", "vdivsd", "vmulpd", "vmulsd"
    for formula in (FreeStateFormula, LagrangeStateFormula):
        parts = (formula(),)
        code = assembly_of_key(KernelKey(fill, parts, "float64", WIDTH, FILL))
        packed, scalar, multiplied, one_by_one = (
            len(re.findall(rf"\b{word}\b", code)) for word in words
        )
        assert packed > 30  # 37 and 55: eleven doublings with one or two arctangents
        assert multiplied > 300  # 325 and 381
        assert scalar == one_by_one == 0

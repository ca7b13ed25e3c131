"""Tests of rigidmc: `pytest`, and `pytest -m slow` for those that take minutes."""

import os

# Before NumPy: the threads of its linear algebra wait for each other by turning round. Beside a
# second worker the eigenvalues of a matrix of 400 rows take 800 ms of a processor, not 20.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

"""Benchmarks of rigidmc: `python -m bench [names]`. Rows go to bench/results/*.json.

`problems` has what benches solve, and `tools` what is no bench: `python -m bench.readme` draws the
tables of README, `python -m bench.house` counts the lines of the package.
"""

from pathlib import Path

__path__ = [*__path__, str(Path(__file__).parent / "tools")]  # `python -m bench.house` is short

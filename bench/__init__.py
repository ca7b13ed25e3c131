"""Benchmarks of rigidmc: `python -m bench [names]`, rows in bench/results/*.json, README's tables from `python -m bench.readme`."""

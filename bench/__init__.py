"""Benchmarks of rigidmc, run by `python -m bench [names]`.

The rows go to bench/results/*.json; `python -m bench.readme` draws README's tables from them.
"""

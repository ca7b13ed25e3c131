"""Benchmarks of rigidmc; run them with `python -m bench [names]`.

Rows go to bench/results/*.json; `python -m bench.readme` draws README's tables from them.
"""

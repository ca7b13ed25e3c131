"""Results: the contents and layout of a run's Dataset, its files, and statistics of its members.

The layout of a result is known before its first member: every variable with its dimensions, type,
units and name. A Dataset in memory, a netCDF file and a run directory have the same layout. A
result contains the text of its scene, so that every member can be rerun.

Reading order: `variables` (single variables), `layout` (all variables of a run), `frames` (from the
axes of a result to its principal axes), `lazy` (functions of dask arrays), `sinks` (where blocks of
members go: memory), `file_sinks` (files), `writer` (a netCDF file, block by block), `export` (other
formats), `reader` (checks a file against its scene), `run_facts` (run.json), `run_directory` (its
shards), `checkpoint` (arrays of an unfinished shard), `labels` (counts and numbers as text); then
the statistics: `measures` ("p(flips >= 1)") of `columns` (variables by name), `estimates` (of
existing results), `intervals` (of probabilities, means, quantiles), `spread` (means and quantiles
in bounded memory), `sums` (means of blocks in any order), `censored` (times of events that have not
occurred).

Two things must never change: names, units and meanings of variables, because results of earlier
versions stay readable; and flagged members are counted, never dropped silently.
"""

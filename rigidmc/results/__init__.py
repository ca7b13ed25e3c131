"""Results: what a Dataset of a run contains, how it is laid out, written and read, and what it
says.

The layout of a result is known before its first member: every variable with its dimensions, type,
units and name. A Dataset in memory, a netCDF file and a run directory have the same layout, and a
result carries the text of its scene, so that each member can be integrated again.

Reading order: `variables` (what a variable is), `layout` (all of them, for a run), `sinks` (where
blocks of members go: memory or a file), `writer` (a netCDF file, block by block), `export` (other
formats), `reader` (a file from outside, checked against its scene), `run_directory` (run.json and
shards), `checkpoint` (arrays of an unfinished shard), `labels` (counts and numbers for people);
then what an ensemble says: `measures` ("p(flips >= 1)"), `estimates` (of a result that exists),
`intervals` (of probabilities, means, quantiles), `censored` (times of events that have not come).

What must never change: names, units and meanings of variables, since results of earlier versions
are read; and that flagged members are counted, never dropped in silence.
"""

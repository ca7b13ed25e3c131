"""Results: the contents and layout of a run's Dataset, and its files.

The layout of a result is known before its first member: every variable with its dimensions, type,
units and name. A Dataset in memory, a netCDF file and a run directory have the same layout. A
result contains the text of its scene, so that every member can be rerun.

Reading order: `variables` (single variables), `layout` (all variables of a run), `principal_axes`
(from the axes of a result to the axes of its bodies; functions of dask arrays), `sinks` (where
blocks of members go: memory), `writer` (a netCDF file, block by block), `export` (files of any
format), `reader` (checks a file against its scene), `labels` (counts and numbers as text).

Names, units and meanings of variables must never change, because results of earlier versions stay
readable.
"""

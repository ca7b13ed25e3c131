"""Long runs: a directory that grows shard by shard and loses nothing when its process is killed.

run.json and scene.toml say what the run is and never change; each shard is a netCDF file with the
members of one range, a pure function of the run and its number. So a shard may be computed on any
machine, in any order, twice, or again after a repair, and has the same bits.

Reading order: `create` (a new directory), `load` (one that exists, checked, as a `PreparedRun`),
`shards` (computed and written in order), `checkpoints` (states of unfinished shards), `resume`
(after a kill, and more members), `cluster` (on the workers of dask), `gather` (verify, repair,
merge, consolidate), `dataset` (all shards as one Dataset), `tasks` (directories of studies, which
have tasks in place of members).

What must never change: run.json of earlier versions is read; no complete shard is changed; one
process writes a directory at a time, which a lock ensures.
"""

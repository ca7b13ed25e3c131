"""Long runs: a directory that grows shard by shard and loses nothing if its process is killed.

run.json and scene.toml define the run and never change. Each shard is a netCDF file with the
members of one range, a pure function of the run and the shard number. So any machine may compute
any shard, in any order, twice, or again after a repair, with the same bits.

Reading order: `facts` (run.json), `folder` (its shards), `create` (a new directory), `load` (an
existing one, checked, as a `PreparedRun`), `shards` (computed and written in order), `checkpoints`
(states of unfinished shards), `resume` (after a kill, and with more members), `cluster` (on the
workers of dask), `gather` (verify, repair, merge, consolidate), `dataset` (all shards as one
Dataset), `tasks` (directories of studies, with tasks instead of members).

Invariants: run.json of earlier versions can be read; a complete shard never changes; a lock lets
only one process write a directory at a time. A store has no locks: there, processes may put the
same shards twice, and whatever changes a run is refused.
"""

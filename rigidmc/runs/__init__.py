"""Runs: prepare a scene once, then run its members any number of times.

`prepare` returns a `PreparedRun`: checked, with units, step and integrator chosen and all names
resolved. `prepared.run(...)` integrates members and returns a Dataset; `simulate` does both.

Reading order: `simulate`, `prepare`, `settled` (what is settled before the first step, and which
members a run has), `assemble` (the result layout and program of a plan), `blocks` (members built at
their start, moved by the engine on threads, handed to a sink; derivatives by the end of a run),
`resources` (threads, memory and disk), `price` (the cost of a run, measured on its first members),
`rerun` (recompute members of a result, to the same bits), `frames` (recompute one for an
animation), `segments` (move members one part of the run at a time, for studies that branch them),
and the subpackage `directory` for runs of hours.

Invariant: a member's bits depend only on scene, seed and index, not on threads, device, blocks or
other members.
"""

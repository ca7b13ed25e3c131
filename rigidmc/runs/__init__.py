"""Runs: a scene is prepared once, and then its members run as often as one likes.

`prepare` makes a `PreparedRun`: checked, with units, step and integrator chosen and all names
resolved. `prepared.run(...)` takes members through it and returns a Dataset; `simulate` is both.

Reading order: `simulate`, `prepare`, `members` (which ones a run has), `assemble` (the layout and
the program of a plan), `blocks` (members at their start, moved by the engine on threads, handed to
a sink), `resources` (threads, memory and disk), `price` (what a run will cost, measured on its
first members), `precompile` (code compiled ahead), `rerun` (members of a result once more, to the
same bits), `segments` (members moved a part of the run at a time, for studies that branch them),
and the room `directory` for runs of hours.

What must never change: a member's bits follow from scene, seed and index alone, whatever the
threads, the device, the blocks, and the members beside it.
"""

"""Studies: each takes a scene to a Dataset that answers one question about it.

A study is a folder. study.py has the function that users call, which makes the members that the
question needs, runs them as any run, and reduces them to the answer; picture.py draws it, and
alone imports matplotlib. Command, run directory, resume and price are those of the framework.

Reading order: `framework` (members in batches, tasks in run directories); `ftle` as the shortest
example, then `basins`, `sensitivity`, `frequencies`, `section` (members of a design),
`stability_map` (parameters against measures), `rare` and `multilevel` (tasks), `accuracy` and
`stress` (integrators against truths). Three files are verbs, not studies: `until` (an ensemble
grows until a measure is known), `closed_form` (one top beside its formula), `bits` (processors
compared).

What must never change: an answer carries its interval, or says why it has none; and it is the same
for any number of threads, batches and restarts.
"""

"""Planning: from a scene to a `Plan`, with everything settled that can be known before the first
step.

A plan is a value: it knows no thread, device or block, since no bit of a result depends on them.
`rigidmc.runs.prepare` calls each step once, in a straight line, and no step reads a later one.

Reading order: `check` (what makes a scene impossible), `units` (those of integration), `initial`
(members at their start, and the pilot: the first of them), `monitors` (what every step records),
`steps` (the grid of times; steps of members' own), `scheme` (how the integrator is compiled),
`limits` (what flags a member), `closed_form` (a motion that needs no steps), `turns` (how dense
saves must be), `plan` (all of this in one value), `notes` (what a user should know), and the room
`tolerance` (integrator and step for a given accuracy).

What must never change: a plan is a function of the scene alone, so that a run that is resumed,
extended or computed elsewhere has the same bits. Where a plan reads drawn members, these are the
first ones of the scene, whatever members are run.
"""

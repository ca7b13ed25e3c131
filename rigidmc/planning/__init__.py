"""Planning: turn a scene into a `Plan`, which settles everything that is known before the first
step.

A plan is a value. It does not depend on threads, device or blocks, and neither do results.
`rigidmc.runs.prepare` calls each step once, in a straight line, and no step reads a later one.

Reading order: `check` (reject impossible scenes), `unit_scale` (the units of integration),
`initial` (members at their start, and the pilot: the first of them), `orbit_start` (starts relative
to an orbit), `monitors` (quantities recorded at every step), `steps` (the time grid and per-member
steps), `switches` (steps that effects cut), `scheme` (how the integrator is compiled, and bounds
that flag a member), `closed_form` (motions that need no steps), `saves` (how dense saves must be,
and their times that a scene leaves open), `plan` (all of this in one value), `tangents`
(derivatives of the members at their start), `notes` and `model_notes` (hints to the user), and the
subpackage `tolerance` (integrator and step for a given accuracy).

Invariant: a plan is a function of the scene alone, so that a run that is resumed, extended or
computed elsewhere has the same bits. Where a plan reads drawn members, it reads the first members
of the scene, whichever members the run computes.
"""

"""Choose the integrator and step that keep a tolerance at the least cost.

A few hundred members, the pilot, are integrated by several candidates: an integrator, a precision
and a step. Each candidate has an error, measured against a reference, and a cost, measured on this
machine.

Reading order: `pilot` (the members that every candidate integrates), `search` (how many of them,
and how far; kernels compiled ahead), `truth` (the reference: a closed form, or the agreement of two
integrators), `deviation` (errors of a candidate), `costs` (a candidate, costs of its steps, and the
choice), `ladder` (the candidates to try), `choose` (the cheapest one that keeps the tolerance).
"""

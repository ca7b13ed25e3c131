"""The integrator and the step that keep a tolerance at the least cost.

A few hundred members, the pilot, are integrated in several ways; each way has an error, measured
against a truth, and a cost, measured on this machine.

Reading order: `pilot` (the members that every way follows), `truth` (a closed form, or what two
integrators agree on), `deviation` (how far a way errs), `costs` (what its steps cost), `ladder`
(which ways and steps are tried), `choose` (the cheapest way that keeps the tolerance).
"""

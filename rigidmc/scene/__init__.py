"""Scenes: the description of a run as data. A body, effects, a start, observables, and settings.

A scene computes and stores nothing. Each of its parameters is a quantity: a number, a distribution,
a grid, or an array with a row per member. A member's values depend only on seed, name and index.

Reading order: `scene` (a scene, from Python or from a file), `model` (body, effects and start),
`body_numbers`, `body_makers`, `body_changes`, `body_readers` and `body` (bodies, and the ways to
make one), `inertia_about` (inertias about the centre of mass), `stated` (bodies as scenes state
them), `shape` (solids that pictures draw), `start` and `start_tables` (conventions of attitudes),
`settings` (the table [run], which defines keywords and options), `save_times` (its setting
`every`), `units` (the conversion of "10 deg/s" to SI), `validation` (of effects and observables),
`recording` (saved and monitored variables), `quantities`, `distributions`, `mixtures` (members),
`sampling` (sources of uniform numbers), `parameter`, `body_parameters` and `parameters` (one
catalogue of the numbers of a model: name, units, derivative, and where each enters), `varied`
(parameters that change between runs of a prepared scene), `derivatives` (parameters by which a run
differentiates), `reparametrise` (derivatives of drawn numbers), `drifts` (how drifts grow); and the
packages `vector_distributions`, `body_files` (readers of robots and drawings), `toml` (scene
files), `user_parts` (users' classes) and `library` (shipped scenes).

Invariants: the names and meanings in scene files, and the random stream of each name: a new
distribution draws from its own streams.
"""

"""Scenes: what is to be run, as data. A body, effects, a start, observables, and the settings of a
run.

A scene computes nothing and keeps nothing. Each of its numbers is a quantity: one number, a
distribution, a grid, or an array with a row per member; the numbers of a member are a function of
seed, name and index alone.

Reading order: `scene` and `parts` (a scene, from Python or from a file), `model` (what moves),
`body`, `body_makers` and `body_changes` (a body, and those made of others), `shape` (solids that
pictures draw), `start`, `settings` (the table [run], from which keywords and options follow),
`amounts` (1e6, "1h30m"), `validation` (parts that a user gives), `recording` (what is saved and
monitored), `quantities` and `distributions` (how members differ), `sampling` (where uniform numbers
come from), `parameters` (numbers of a scene by their names), `varied` (those that a prepared run
takes anew), `drifts` (by what law drifts grow);
and the rooms `vector_distributions`, `toml` (scene files), `user_parts` (classes that users wrote)
and `library` (shipped scenes).

What must never change: names and meanings in scene files, and the stream of numbers that belongs to
a name: a new distribution draws from streams of its own.
"""

"""Scene files: TOML text to the parts of a scene, and back.

A file holds data and executes nothing. Each error names the file, the table and the key, and the
nearest right word. Reading order: `read` (tables as parts), `values` (numbers, distributions, grids
and columns of tables in them), `write` (a scene as text, from which `read` makes the same scene).

What must never change: a file that was read once is read for ever, with the same members.
"""

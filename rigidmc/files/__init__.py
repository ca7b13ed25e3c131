"""Files: written whole or not at all, and read with care when they come from outside.

Anyone may hand a user a scene, a result or a run directory. So a file from outside is data that is
checked before a library opens it: nothing in it is executed, no link is followed, no pipe blocks,
and what claims too much is refused. A file of ours appears under its name only when it is complete.

Reading order: `outputs` (parts that are renamed when whole), `opening` (regular files in folders
that others can write to), `reading` (text, TOML, JSON and CSV), `netcdf` (results,
also in zarr stores), `trial` (a helper process opens a doubtful file first), `processes` and
`helper_main` (how helpers start, and what forks share), `locks`, `user_code` (Python files that a
user allowed).

What must never change: no file is replaced unless a user says so; the C library of netCDF is called
by one thread; a helper imports nothing from the working directory.
"""

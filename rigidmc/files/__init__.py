"""Files: written completely or not at all, and checked before reading if untrusted.

A scene, a result or a run directory may come from anyone. The package therefore treats such a file
as data and checks it before a library opens it: it executes nothing in it, follows no link, waits
for no pipe, and refuses files that claim too much data. Our own files get their names only when
complete.

Reading order: `outputs` (partial files, renamed when complete), `opening` (regular files in folders
that others can write to), `reading` (text, TOML and JSON), `kinds` (what a file is, by its name),
`tables` (CSV), `netcdf` (results, including zarr stores), `hdf5` and `chunks` (plain reads of many
shards), `trial` (a helper process opens an untrusted file first), `helper_main` (start of
helpers), `locks`, `stores` (objects at a URL), `user_code`
(Python files that a user allowed).

Invariants: no file is replaced unless the user requests it; only one thread at a time calls the
netCDF C library; a helper imports nothing from the working directory.
"""

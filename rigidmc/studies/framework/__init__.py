"""Building blocks of studies: `study` defines the record and builds its function; `options`, the
options; `members`, `tasks` and `direct`, the three kinds of work. `rigidmc.cli.studies` builds the
commands."""

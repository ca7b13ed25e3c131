"""Building blocks of studies: `study` defines the record and builds its function; `options` and
`variables` declare what it takes and returns; `work`, `members` and `tasks` are the three kinds of
work. `rigidmc.cli.studies` builds the commands."""

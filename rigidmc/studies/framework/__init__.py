"""What studies are made of: `study` has the record and makes its function, `options` what may be
asked, `members`, `tasks` and `direct` the three kinds of work. Commands are made in
`rigidmc.cli.studies`."""

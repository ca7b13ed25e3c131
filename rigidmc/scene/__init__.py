"""What is to be run: body, effects, start, laws, settings; TOML in and out."""

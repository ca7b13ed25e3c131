"""How results are laid out, written and read."""

"""Stability maps: two parameters of a scene against what its members do."""

"""Multilevel Monte Carlo over the step."""

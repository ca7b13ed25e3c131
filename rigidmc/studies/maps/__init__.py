"""Stability maps."""

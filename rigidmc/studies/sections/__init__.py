"""Poincare sections."""

"""Rare events: probabilities far below the reach of plain sampling."""

"""Rare events: what almost never happens, far below what plain sampling sees."""

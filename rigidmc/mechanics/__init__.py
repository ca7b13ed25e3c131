"""Closed forms, the yardstick of everything that is integrated: elliptic functions, the free top, the heavy symmetric top,
and constants of other tops. All take arrays with components last and any leading shapes that broadcast.
"""

"""Rigid-body mechanics for arrays: inertia, rotations, coordinates and closed forms.

The closed forms (elliptic functions, the free top, the heavy symmetric top, constants of other
tops) are the reference for everything that is integrated. All functions take arrays with components
last and any leading shapes that broadcast.
"""

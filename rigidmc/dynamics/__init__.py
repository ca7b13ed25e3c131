"""Physics as plain functions of floats and small tuples: no allocation, no raise, no data-dependent loop.

They run as they stand in Python and, inlined by `rigidmc.engine.compose`, in the lanes of a kernel.
"""

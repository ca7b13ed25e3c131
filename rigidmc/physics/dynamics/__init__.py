"""The mechanics of one rigid body, as plain functions of floats and small tuples.

They allocate nothing, raise nothing and contain no loop whose length depends on the data. They run
as they are in Python, and `rigidmc.engine.compiler.compose` inlines them into the kernels.
"""

"""Custom effects, integrators and observables, tested before they are compiled.

A scene file names a custom class by its table and `module = "wind.py"`; its code runs only if the
user allows it. A trial calls each method with plain numbers and reports mistakes by class and
method, where the compiler would print a hundred lines.

`registry` finds classes in files and makes placeholders for classes whose code is not run;
`effects`, `integrators` and `observables` contain the trials of each kind.
`rigidmc.scene.vector_distributions.protocol` tries custom distributions, which are never compiled.
"""

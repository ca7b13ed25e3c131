"""Effects, integrators and observables that users wrote, tried before they are compiled.

A class of a user's own is named in a scene file by its table and `module = "wind.py"`, and its code
runs only if the user allows it. A trial calls each method with plain numbers and says what is wrong
in the words of the class and the method, where the compiler would say it in a hundred lines.

`registry` finds classes in files, and makes stand-ins for those whose code is not run; `effects`,
`integrators` and `observables` have the trials of each kind. A distribution is tried by the
protocol of its kind, `rigidmc.scene.vector_distributions.protocol`, and compiled never.
"""

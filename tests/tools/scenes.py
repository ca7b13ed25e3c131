"""Scenes that tests of several subjects share, so that they share compiled kernels as well."""

import rigidmc as rm

UNSYMMETRIC = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
TOP = rm.Scene(
    UNSYMMETRIC,
    rm.Gravity(1.0),
    rm.Start(omega=(1.0, rm.normal(0.5, 0.1), 0.3), attitude=(0.0, 1.0, 0.0)),
)
TILTED = rm.Start(omega=(rm.normal(0.5, 0.1), 1.0, rm.normal(0.0, 0.3)), attitude="uniform")
LAGRANGE = rm.Scene(
    rm.Body.from_moments((1.0, 1.0, 0.5), mass=1.0, centre=(0.0, 0.0, 0.2)), rm.Gravity(3.0), TILTED
)

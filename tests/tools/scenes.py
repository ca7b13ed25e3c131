"""Scenes that tests of several subjects share, and what they save, so that they share kernels.

A kernel of monitors takes 2 s to compile for each form of integrator, effects and monitored
quantities; steps take 0.8 s for each integrator, effects, and attitude or none; a save takes 0.2 s
for each list of observables. Bodies, starts, steps, times, members and seeds compile nothing:
change them by `with_run` and `dataclasses.replace`. A test of some state saves STATE, and one of
some monitor MONITORED.
"""

import rigidmc as rm

STATE = ("omega", "attitude", "energy")
MONITORED = ("flips", "omega_max")
UNSYMMETRIC = rm.Body((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3))
TOP = rm.Scene(
    UNSYMMETRIC,
    rm.Gravity(1.0),
    rm.Start(omega=(1.0, rm.normal(0.5, 0.1), 0.3), attitude=(0.0, 1.0, 0.0)),
)
TILTED = rm.Start(omega=(rm.normal(0.5, 0.1), 1.0, rm.normal(0.0, 0.3)), attitude="uniform")
LAGRANGE = rm.Scene(
    rm.Body((1.0, 1.0, 0.5), mass=1.0, centre=(0.0, 0.0, 0.2)), rm.Gravity(3.0), TILTED
)
# free members that flip about the middle axis, in five shards of 192 and one of 40
FREE = rm.Scene(
    rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(rm.normal(0.0, 0.1), 1.0, rm.normal(0.0, 0.1)))
).with_run(
    integrator="rk4",
    dt=0.05,
    t_end=2.0,
    every=1.0,
    members=1000,
    seed=4,
    save=("omega", *MONITORED),
)
HISTOGRAM = rm.Histogram("energy", 0.0, 3.0, 12)
WITH_HISTOGRAM = ("omega", "energy", "flips", HISTOGRAM)
HEAVY = rm.Scene(UNSYMMETRIC, rm.Gravity(3.0), TILTED).with_run(save=STATE)
DAMPED = rm.Scene(UNSYMMETRIC, (rm.Gravity(3.0), rm.ViscousDamping(0.05)), TILTED).with_run(
    save=STATE
)

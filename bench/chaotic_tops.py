"""The fractions of chaotic starts in docs/tutorials/chaotic_tops.md: by time, and by angle and
energy.

`python -m bench.chaotic_tops` prints both in a few minutes.
"""

import warnings

import numpy as np

import rigidmc as rm

STARTS = 256
TIMES = (500.0, 1000.0, 2000.0, 4000.0)  # s
ANGLES = (0.0, 1.0, 4.0, 45.0, 89.0, 90.0)  # degrees
ENERGIES = (-0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 6.0, 9.0)  # J


def share(degrees, energy, t_end=1000.0, moments=(2.0, 2.0, 1.0), starts=STARTS):
    """Return the fraction of starts on a whole energy surface whose MEGNO exceeds 4 at t_end."""
    centre = np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))
    start = rm.Start(momentum=rm.Shell(energy), attitude="ensemble")
    scene = rm.Scene(rm.Body(moments, mass=0.25, centre=centre), rm.Gravity(4.0), start)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)  # the centre of mass is far out
        run = {"integrator": "rk8", "dt": 0.2, "t_end": t_end, "members": starts}
        tops = rm.simulate(scene, **run, save=("megno",))
    return float((tops.megno.values > 4.0).mean())


def main():
    print("45 degrees, 2 J:")
    for t_end in TIMES:
        print(f"  to {t_end:g} s  {share(45.0, 2.0, t_end):.1%}", flush=True)
    print(f"to 1000 s, energies {ENERGIES} J:")
    for degrees in ANGLES:
        row = [f"{share(degrees, energy):.1%}" for energy in ENERGIES]
        print(f"  {degrees:g} degrees  {'  '.join(row)}", flush=True)
    print(f"I_2 = 1.5, 9 J  {share(90.0, 9.0, moments=(2.0, 1.5, 1.0)):.1%}")


if __name__ == "__main__":
    main()

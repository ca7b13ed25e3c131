"""The cost of axes: a body described in axes other than its principal axes, against the same body
described in these.

Steps are the same. A save or a monitored state turns vectors and attitudes; a scene of a body
described in its principal axes compiles none of this.
"""

import warnings

import numpy as np

import rigidmc as rm
from bench import harness

MOMENTS = (1.0, 1.4, 2.0)
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])  # orthonormal
CENTRE = np.array([0.1, 0.2, 0.3])
SPIN = np.array([0.3, 1.1, 0.4])
WATCHED = {
    "omega": ("omega",),
    "attitude": ("attitude",),
    "omega_max": ("omega_max",),
    "nutation": ("nutation",),
    "passage": (rm.Passage(3, 1.2),),
    "flips": (rm.Flips(2),),
}
SAVED = ("omega", "attitude")
MEMBERS, STEPS = 2048, 200


def tops(save, is_turned):
    """Return the scene in principal axes, or in axes turned from these."""
    if is_turned:
        body = rm.Body(MOMENTS, 1.0, tuple(TURN @ CENTRE), tuple(map(tuple, TURN)))
        spin = TURN @ SPIN
    else:
        body, spin = rm.Body(MOMENTS, 1.0, tuple(CENTRE)), SPIN
    start = rm.Start(omega=tuple(rm.normal(x, 0.1) for x in spin), attitude="uniform")
    run = {"dt": 0.05, "t_end": 0.05 * STEPS, "members": MEMBERS, "integrator": "rk4"}
    every = 0.05 if save[0] in SAVED else None
    return rm.Scene(body, (rm.Gravity(9.81),), start).with_run(every=every, save=save, **run)


def run(quick):
    warnings.simplefilter("ignore", rm.SceneWarning)
    cpu, candidates = {}, {}
    for name, save in WATCHED.items():
        for is_turned in (False, True):
            scene = tops(save, is_turned)
            candidates[name, is_turned] = lambda scene=scene: rm.simulate(scene, threads=1)
    harness.interleaved(candidates, 3 if quick else 15, cpu)
    rows = []
    for name in WATCHED:
        plain, turned = (np.array(cpu[name, is_turned]) for is_turned in (False, True))
        rows.append(
            {
                "what": name,
                "of": "save" if name in SAVED else "step",
                "plain_ns": float(1e9 * np.median(plain) / (MEMBERS * STEPS)),
                "turned_ns": float(1e9 * np.median(turned - plain) / (MEMBERS * STEPS)),
            }
        )
    return rows


def report(rows):
    times = "principal axes [ns] {plain_ns:.1f} | other axes add [ns] {turned_ns:.1f}"
    columns = f" {{what}} | of a {{of}} | {times}"
    harness.show("a member-step with its save or monitor, one thread", rows, columns)

"""What readers call things: index entries, by which the search finds a page under other words.

The `!` makes an entry a main one: the search puts the others below every page that has the word.
"""

import re

# {page: the words that find it first}
WORDS = {
    "learn": ["rigid body dynamics", "lecture", "classical mechanics"],
    "ensembles": ["Monte Carlo", "ensemble", "Monte Carlo simulation"],
    "teaching/index": ["lecturer", "teaching", "lecture hall", "course"],
    "teaching/examples": ["textbook", "worked examples"],
    "teaching/exercises": ["exercise", "homework", "solution"],
    "teaching/phone": ["lab sheet", "smartphone", "phone", "experiment"],
    "tutorials/tennis_racket": [
        *("Dzhanibekov effect", "Dzhanibekov", "tennis racket theorem", "tennis racket"),
        *("intermediate axis", "intermediate axis theorem", "T-handle", "wingnut"),
    ],
    "tutorials/heavy_top": [
        *("gyroscope", "spinning top", "nutation", "precession", "sleeping top")
    ],
    "tutorials/satellites": ["tumbling", "satellite", "CubeSat", "detumbling", "detumble"],
    "tutorials/chaotic_tops": ["chaotic motion", "chaotic top"],
    "tutorials/stability_map": ["stability map", "stability diagram"],
    "tutorials/thermal_rotor": ["Langevin", "thermal noise", "molecule"],
    "theory/rigid_body": ["inertia tensor", "moment of inertia", "principal axes"],
    "theory/free_body": ["Euler equations", "Euler's equations", "torque-free motion"],
    "theory/heavy_top": ["Lagrange top", "Kovalevskaya top"],
    "theory/conventions": ["Euler angles", "quaternion", "attitude", "units"],
    "theory/gyrostat": ["reaction wheel", "momentum wheel", "gyrostat", "dual spin"],
    "theory/chaos": ["Lyapunov", "Lyapunov exponent", "MEGNO"],
    "theory/integrators": ["symplectic", "symplectic integrator", "Runge-Kutta", "Lie group"],
    "how_to/sections": ["Poincare section", "Poincaré section", "surface of section"],
    "how_to/devices": ["GPU", "CUDA", "NVIDIA", "graphics card"],
    "how_to/long_runs": ["resume", "checkpoint", "restart"],
    "how_to/clusters": ["cluster", "SLURM", "job array", "dask", "MPI", "S3", "object store"],
    "how_to/results": ["pandas", "xarray", "netCDF", "DataFrame"],
    "how_to/tables": ["CSV", "parquet", "table of starts"],
    "how_to/rare": ["rare event", "splitting", "small probability"],
    "how_to/sensitivity": ["Sobol indices", "sensitivity", "uncertainty quantification"],
    "how_to/multilevel": ["multilevel Monte Carlo", "variance reduction"],
    "how_to/basins": ["basin of attraction", "basin entropy"],
    "how_to/lyapunov": ["Lyapunov spectrum", "SALI", "GALI"],
    "how_to/frequencies": ["spectrum", "FFT", "NAFF", "period"],
    "how_to/own_parts": ["custom effect", "custom torque", "own torque", "plugin"],
    "how_to/prepared_runs": ["optimisation", "optimization", "parameter sweep", "MCMC"],
    "reference/reproducibility": ["seed", "determinism", "bitwise reproducibility"],
    "reference/performance": ["speed", "performance", "benchmark"],
}


def add_entries(app, docname, source):
    """Put the entries above the first title."""
    if docname in WORDS:
        entries = "\n".join(f"   ! single: {word}" for word in WORDS[docname])
        block = f"```{{eval-rst}}\n.. index::\n{entries}\n```\n\n"
        source[0] = re.sub(r"(?m)^# ", lambda title: block + title[0], source[0], count=1)


def setup(app):
    app.connect("source-read", add_entries)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""List the shipped scenes, or print one (with comments, ready to copy).

rigidmc scenes heavy_top > mine.toml
rigidmc run mine.toml -o mine.nc

A scene file is TOML; SI units, angles in rad:

[body]
  moments = [I1, I2, I3]   principal moments about the fixed point, kg m2
  or one of  tensor = 3x3,  particles = { masses, positions },
  box = { mass, size = [x, y, z] },  plate = { mass, size = [x, y] },
  ball, shell, disc or ring = { mass, radius },
  cylinder or cone = { mass, radius, height },  rod = { mass, length, radius },
  hollow_cylinder = { mass, inner, outer, height },
  ellipsoid = { mass, semiaxes = [a, b, c] },
  t_handle = { density, radius, bar, stem }
  mass, centre = [x, y, z]   kg, m; with moments or tensor
  pivot = [x, y, z]          the fixed point of the body, if not the origin
  axes = "principal"         start, effects and results are in the principal
                             axes, not in the axes of the tensor or solid

[effects.gravity]
  g                          m/s2
[effects.NAME]               an effect of `rigidmc effects`, with its
                             parameters; [[effects.NAME]] for several

[start]
  omega or momentum          rad/s or kg m2/s, in body axes
  attitude                   "uniform", quaternion [w, x, y, z], 3x3 matrix,
                             or Euler angles z-x-z [phi, theta, psi]
[observables.NAME]           an observable with parameters, monitored at
                             every step, see `rigidmc observables`
[run]
  integrator, dt, t_end, members, seed, every, save
  tolerance = 1e-8           instead of integrator and dt: chooses both
  turn                       rad, instead of dt: each step covers this angle
                             of the member's own motion
  dtype                      "float64" or "float32": precision of the steps
  compensated                true: compensated summation
  times: seconds, or text such as "1h30m", "250 ms"; counts: also 1e6
  every                      a time between saves, a list of times, or
                             "50/turn"

Each number in body, effects and start may be a distribution:
  { normal = [mean, sd] },  { uniform = [low, high] },
  or any of scipy.stats:  { gamma = { a = 2.0, scale = 0.1 } }
  or { common = [mean, a1, a2] }: mean + a1 z1 + a2 z2, with normal z1, z2
  of the member that all such numbers have in common
  or { grid = [low, high, count], stride = 1, log = false },
  or { table = "starts.csv", column = "w1" }  (or a netCDF file)
Vector distributions:
  omega, momentum  = { cone = { axis = 2, size = 1.0, angle = 0.01 } },
                     { sphere = 1.0 }, { table = FILE, columns = [...] },
                     { correlated = { mean = [...], covariance = 3x3 } }
  momentum         = { shell = { energy = 2.0 } }, { gibbs = kT }: with
                     attitude = "ensemble" the microcanonical and the
                     canonical ensemble
  attitude         = { fisher = { attitude, kappa } },
                     { pointing = { direction, kappa } }
  moments          = { second_moments = [a, b, c] }: only possible bodies,
                     { correlated = ... }: measured inertia
[run]
  points                     how distributions are sampled: "independent",
                             "sobol", "latin_hypercube", "antithetic",
                             "saltelli", "neighbours"
"""

import os

from rigidmc.errors import NoSuchScene, hint_of, nearest

_FOLDER = os.path.dirname(__file__)


def shipped_names() -> list[str]:
    """Return the names of the shipped scenes."""
    return sorted(name[:-5] for name in os.listdir(_FOLDER) if name.endswith(".toml"))


def read_source(source: str) -> str:
    """Return the TOML text of a scene file or a shipped scene; FileNotFoundError with the nearest
    name if neither exists, NoSuchScene if `source` is not a file name."""
    from rigidmc.files.reading import text_of

    if source in shipped_names():
        return text_of(os.path.join(_FOLDER, f"{source}.toml"))
    if os.path.exists(source):
        return text_of(source)
    names, (folder, name) = shipped_names(), os.path.split(source)
    if os.path.isdir(folder or os.curdir):
        beside = [file for file in os.listdir(folder or os.curdir) if file.endswith(".toml")]
    else:
        beside = []
    close = nearest(name, beside) or nearest(name.removesuffix(".toml"), names)
    close = os.path.join(folder, close) if close in beside else close
    # with a suffix or a folder it names a missing file; otherwise it is a wrong scene name
    is_name = not os.path.splitext(source)[1] and os.path.basename(source) == source
    raise (NoSuchScene if is_name else FileNotFoundError)(
        f"{source}: no file and no shipped scene has this name{hint_of(close)}; shipped:"
        f" {', '.join(names)}"
    )

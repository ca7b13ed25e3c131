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
  pivot = [x, y, z]          the point of the body held fixed instead

[effects.gravity]
  g                          m/s2
[effects.NAME]               one of `rigidmc effects`, with its parameters;
                             [[effects.NAME]] for several of a kind

[start]
  omega or momentum          rad/s or kg m2/s, in principal axes
  attitude                   "uniform", quaternion [w, x, y, z], 3x3 matrix,
                             or Euler angles z-x-z [phi, theta, psi]
[observables.NAME]           what is watched at every step and has numbers of
                             its own, see `rigidmc observables`
[run]
  integrator, dt, t_end, members, seed, every, save
  tolerance = 1e-8           instead of integrator and dt: chooses both
  turn                       rad, instead of dt: each member steps by so much
                             of its own motion
  dtype                      "float64" or "float32": the numbers of the steps
  compensated                true: keep the remainders of all sums
  times are seconds or text, as "1h30m" and "250 ms"; counts also 1e6

Any number of body, effects and start may be a distribution:
  { normal = [mean, sd] },  { uniform = [low, high] },
  or one of scipy.stats:  { gamma = { a = 2.0, scale = 0.1 } }
  or { grid = [low, high, count], stride = 1, log = false },
  or { table = "starts.csv", column = "w1" }  (or a netCDF file)
Vectors as a whole:
  omega, momentum  = { cone = { axis = 2, size = 1.0, angle = 0.01 } },
                     { sphere = 1.0 }, { table = FILE, columns = [...] },
                     { correlated = { mean = [...], covariance = 3x3 } }
  momentum         = { shell = { energy = 2.0 } }, { gibbs = kT }; with
                     attitude = "ensemble" the whole micro-, canonical one
  attitude         = { fisher = { attitude, kappa } },
                     { pointing = { direction, kappa } }
  moments          = { second_moments = [a, b, c] }: always a body,
                     { correlated = ... }: inertia that was measured
[run]
  points                     "independent", "sobol", "latin_hypercube",
                             "antithetic", "saltelli", "neighbours",
                             "tangents": what distributions are drawn by
"""

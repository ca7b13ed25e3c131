"""Common synonyms of rigidmc's names, for hints in messages."""

# {name: its synonyms}, grouped by use. A message hints at a name only where the name is valid.
_WORDS = {
    # solids
    "ball": "sphere solid_sphere",
    "shell": "hollow_sphere spherical_shell",
    "box": "cuboid brick block cube parallelepiped",
    "hollow_cylinder": "tube pipe hollow",
    "disc": "disk",
    "ring": "hoop annulus",
    "rod": "bar stick needle",
    "plate": "sheet rectangle lamina",
    "particles": "points point_masses dumbbell",
    # keys of a body
    "moments": "inertia principal_moments moments_of_inertia i",
    "tensor": "inertia_tensor matrix",
    "mass": "m",
    "centre": "center com cog cm centre_of_mass center_of_mass",
    "radius": "r a",
    "height": "h length l",
    "density": "rho",
    # starts and saved variables
    "omega": "w angular_velocity spin rates velocity",
    "momentum": "l angular_momentum",
    "attitude": "q quaternion quaternions orientation rotation euler euler_angles angles pose",
    "energy": "hamiltonian total_energy",
    "pointing_angle": "tilt theta nadir",
    "megno": "lyapunov chaos",
    # effects
    "gravity": "gravitation g weight uniform_gravity",
    "gravity_gradient": "tide tides tidal orbit",
    "viscous_damping": "damping viscous linear_damping",
    "quadratic_drag": "drag air_drag",
    "dry_friction": "friction coulomb",
    "bath": "noise langevin thermal temperature brownian",
    "rotor": "wheel flywheel gyrostat reaction_wheel",
    "uniform_field": "magnet magnetic magnetic_field dipole field",
    "body_torque": "torque thruster",
    "energy_dissipation": "dissipation slosh",
    # distributions
    "normal": "gaussian gauss norm",
    "uniform": "flat random isotropic",
    "expon": "exponential",
    "shell ": "microcanonical",
    "gibbs": "canonical maxwell boltzmann thermal",
    "fisher": "von_mises vonmises von_mises_fisher",
    "correlated": "multivariate_normal covariance",
    "common": "correlation joint shared",
    # pictures
    "polhodes": "momentum_sphere herpolhode",
    "trajectory": "axis_sphere path",
    "angles": "euler euler_angles",
    "phase_portrait": "phase_space phase_plane",
    "effective_potential": "potential",
    # settings of a run
    "t_end": "tmax t_max tend tstop t_stop tfinal t_final t_f tf duration time end",
    "members": "n num count samples n_members n_samples ensemble size",
    "dt": "step timestep time_step stepsize step_size h delta_t",
    "every": "interval save_every output_every dt_save dt_out stride t_eval saveat save_times",
    "integrator": "method solver scheme stepper",
    "tolerance": "tol rtol atol accuracy error eps",
    "seed": "random_state rng random_seed",
    "dtype": "precision",
    "save": "outputs observables record variables",
    "threads": "nthreads n_threads n_jobs workers cores cpus",
    "output": "out file filename path outfile",
    "force": "overwrite",
    # integrators
    "rk4": "runge_kutta",
    "rk8": "rk45 dopri dopri5 dop853 dopri8",
    "gbs12": "gbs bulirsch_stoer gragg odex extrapolation feagin12 taylor",
    "strang": "verlet leapfrog symplectic splitting",
    "midpoint": "gauss_legendre implicit_midpoint",
    "closed": "analytic analytical closed_form",
}

NAMES: dict[str, list[str]] = {}  # {word: names}
for _name, _words in _WORDS.items():
    for _word in _words.split():
        NAMES.setdefault(_word, []).append(_name.strip())

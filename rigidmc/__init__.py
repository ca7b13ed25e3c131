"""rigidmc: Monte Carlo ensembles of rigid bodies with a fixed point, millions of tops in parallel.

For example::

    import rigidmc as rm
    start = rm.Start(omega=(rm.normal(0, 1e-3), 1.0, 0.0))
    scene = rm.Scene(rm.Body.from_moments((1, 2, 3)), start=start)
    ds = rm.simulate(scene, integrator="rk4", dt=1e-2, t_end=40.0, members=100_000, every=0.1)

Names load at first use: importing rigidmc compiles nothing and takes about 20 ms. Type checkers
and editors read `__init__.pyi`, which `python -m bench.stub --write` generates. Once rigidmc and
xarray are imported, every Dataset has `ds.rigid`, see `rigidmc.views.accessor`.
"""

from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any

from rigidmc.studies import STUDIES
from rigidmc.version import VERSION
from rigidmc.views import register

__version__ = VERSION

# name: module; studies, and the classes of effects and distributions, come from their registries
_HOMES = {name: f"studies.{name}.study" for name in STUDIES} | {
    "Body": "scene.body",
    "Scene": "scene.scene",
    "Start": "scene.start",
    "Run": "scene.settings",
    "simulate": "runs.simulate",
    "prepare": "runs.simulate",
    "PreparedRun": "runs.prepare",
    "rerun": "runs.rerun",
    "reweight": "studies.reweight",
    "zoom_map": "studies.stability_map.stored",
    "simulate_until": "studies.until",
    "estimate_rqmc": "studies.until",
    "simulate_totals": "studies.totals",
    "precompile": "runs.simulate",
    "live": "views.live.page",
    "solve_free_top": "mechanics.free_top",
    "analyse_free_top": "mechanics.free_top",
    "solve_lagrange_top": "mechanics.lagrange_top",
    "analyse_lagrange_top": "mechanics.lagrange_top",
    "effective_potential": "mechanics.lagrange_steady",
    "steady_precession": "mechanics.lagrange_steady",
    "least_spin": "mechanics.lagrange_steady",
    "tilt_growth": "mechanics.lagrange_steady",
    "euler_rates": "mechanics.euler_rates",
    "omega_from_euler_rates": "mechanics.euler_rates",
    "normal": "scene.distributions",
    "uniform": "scene.distributions",
    "distribution": "scene.distributions",
    "mixture": "scene.mixtures",
    "common": "scene.distributions",
    "grid": "scene.quantities",
    "Flips": "physics.observables",
    "OrbitAngles": "physics.observables",
    "Passage": "physics.observables",
    "PointingAngle": "physics.observables",
    "Histogram": "physics.observables",
    "RigidmcError": "errors",
    "SceneError": "errors",
    "PartError": "errors",
    "OptionError": "errors",
    "NoDevice": "errors",
    "FileError": "errors",
    "SceneWarning": "errors",
    "OutputExists": "errors",
}

if TYPE_CHECKING:
    from xarray import Dataset


def open(path: str | PathLike[str], allow_code: bool = False) -> "Dataset":
    """Open a result as a lazily read xarray Dataset.

    Parameters
    ----------
    path : path_like
        netCDF file, zarr store or run directory of a run or a map
    allow_code : bool, optional
        whether `rerun` and other methods that integrate may run the Python files of custom
        effects, observables and the like; opening stored data does not need it

    Returns
    -------
    xarray.Dataset
        the Dataset that `simulate` returns, see `rigidmc.runs.directory.dataset.open_run`, or for
        a map the one that `stability_map` returns. If a map's run directory lacks members, pixels
        use the others, and the attribute `missing` counts the missing ones

    Raises
    ------
    FileError
        if the path is not one of these, or a map has no shard

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    >>> rm.simulate(scene, output="flips.nc").close()
    >>> with rm.open("flips.nc") as ds:
    ...     ds.sizes["member"]
    4
    >>> sides = ("start.omega.1", 0.0, 1.0), ("start.omega.2", 0.0, 1.0)
    >>> rm.stability_map(scene, *sides, "p(flips >= 1)", 2, members=4).to_netcdf("map.nc")
    >>> dict(rm.open("map.nc").sizes)
    {'y': 2, 'x': 2}
    """
    result: Dataset
    maps = import_module("rigidmc.studies.stability_map.stored")
    folder = import_module("rigidmc.files.stores").is_folder(path)
    if maps.is_map(path):
        result = maps.open_map(path, allow_code)
    elif folder and not import_module("rigidmc.files.opening").is_zarr(path):
        result = import_module("rigidmc.runs.directory.dataset").open_run(path, allow_code)
    else:
        result = import_module("rigidmc.results.reader").open_result(path, allow_code)
    return result


def _registered() -> dict[str, str]:
    """Return {name: module} of the classes of effects and of vector distributions."""
    effects = import_module("rigidmc.physics.effects").EFFECTS.values()
    vectors = import_module("rigidmc.scene.vector_distributions").VECTOR_DISTRIBUTIONS
    kinds = (*effects, *vectors)
    return {kind.__name__: kind.__module__.removeprefix("rigidmc.") for kind in kinds}


# {removed name: replacement}
_OLD = {"device": "give device= to simulate, run, resume and the studies"}


# {earlier name: current name}, until 1.0
_OLD_NAMES = {
    "free_motion": "analyse_free_top",
    "free_top": "solve_free_top",
    "lagrange_motion": "analyse_lagrange_top",
    "lagrange_top": "solve_lagrange_top",
    "open_map": "open",
    "randomised": "estimate_rqmc",
    "warm": "precompile",
}


def __getattr__(name: str) -> Any:
    if name in _OLD:
        raise AttributeError(f"rigidmc.{name} was removed: {_OLD[name]}")
    if name == "__all__":
        return [*_HOMES, "open", *_registered()]
    if name == "protocols":  # the building blocks of custom effects, observables, ...
        return import_module("rigidmc.protocols")
    if name in _OLD_NAMES:
        # with an AttributeError, `from rigidmc import warm` would lose the message
        raise ImportError(f"rigidmc.{name} is now called rigidmc.{_OLD_NAMES[name]}")
    home = _HOMES.get(name)
    if home is None and not name.startswith("_"):  # Python itself looks up underscored names
        home = _registered().get(name)
    if home is None:
        words = f"module 'rigidmc' has no attribute '{name}'"
        if not name.startswith("_"):
            close = import_module("rigidmc.errors").nearest(name, __getattr__("__all__"))
            words += f"; did you mean '{close}'?" if close else ""
        raise AttributeError(words)
    value = getattr(import_module(f"rigidmc.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__getattr__("__all__"), "__version__", "protocols"]


register()

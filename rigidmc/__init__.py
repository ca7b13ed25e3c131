"""rigidmc: Monte Carlo ensembles of rigid bodies with a fixed point, millions of tops in parallel.

For example::

    import rigidmc as rm
    start = rm.Start(omega=(rm.normal(0, 1e-3), 1.0, 0.0))
    scene = rm.Scene(rm.Body.from_moments((1, 2, 3)), start=start)
    ds = rm.simulate(scene, integrator="rk4", dt=1e-2, t_end=40.0, members=100_000, every=0.1)

The names are loaded when first used: importing rigidmc compiles nothing and takes about 20 ms.
A Dataset has `ds.rigid` as soon as rigidmc and xarray are imported, see `rigidmc.views.accessor`.
"""

from importlib import import_module
from os import PathLike
from os.path import isdir
from typing import TYPE_CHECKING, Any

from rigidmc.studies import STUDIES
from rigidmc.version import VERSION
from rigidmc.views import register

__version__ = VERSION

# name: module; studies, and the classes of effects and laws, come from their registries
_HOMES = {name: f"studies.{name}.study" for name in STUDIES} | {
    "Body": "scene.body",
    "Scene": "scene.scene",
    "Start": "scene.start",
    "Run": "scene.settings",
    "simulate": "runs.simulate",
    "prepare": "runs.prepare",
    "PreparedRun": "runs.prepare",
    "rerun": "runs.rerun",
    "open_map": "studies.stability_map.stored",
    "zoom_map": "studies.stability_map.stored",
    "simulate_until": "studies.until",
    "randomised": "studies.until",
    "warm": "runs.precompile",
    "free_top": "mechanics.free_top",
    "free_motion": "mechanics.free_top",
    "lagrange_top": "mechanics.lagrange_top",
    "lagrange_motion": "mechanics.lagrange_top",
    "normal": "scene.distributions",
    "uniform": "scene.distributions",
    "distribution": "scene.distributions",
    "mixture": "scene.distributions",
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

if TYPE_CHECKING:  # the same names for type checkers and editors
    from xarray import Dataset

    from rigidmc import protocols as protocols
    from rigidmc.errors import FileError as FileError
    from rigidmc.errors import NoDevice as NoDevice
    from rigidmc.errors import OptionError as OptionError
    from rigidmc.errors import OutputExists as OutputExists
    from rigidmc.errors import PartError as PartError
    from rigidmc.errors import RigidmcError as RigidmcError
    from rigidmc.errors import SceneError as SceneError
    from rigidmc.errors import SceneWarning as SceneWarning
    from rigidmc.mechanics.free_top import free_motion as free_motion
    from rigidmc.mechanics.free_top import free_top as free_top
    from rigidmc.mechanics.lagrange_top import lagrange_motion as lagrange_motion
    from rigidmc.mechanics.lagrange_top import lagrange_top as lagrange_top
    from rigidmc.physics.effects import *  # noqa: F403
    from rigidmc.physics.observables import Flips as Flips
    from rigidmc.physics.observables import Histogram as Histogram
    from rigidmc.physics.observables import OrbitAngles as OrbitAngles
    from rigidmc.physics.observables import Passage as Passage
    from rigidmc.physics.observables import PointingAngle as PointingAngle
    from rigidmc.runs.precompile import warm as warm
    from rigidmc.runs.prepare import PreparedRun as PreparedRun
    from rigidmc.runs.prepare import prepare as prepare
    from rigidmc.runs.rerun import rerun as rerun
    from rigidmc.runs.simulate import simulate as simulate
    from rigidmc.scene.body import Body as Body
    from rigidmc.scene.distributions import distribution as distribution
    from rigidmc.scene.distributions import mixture as mixture
    from rigidmc.scene.distributions import normal as normal
    from rigidmc.scene.distributions import uniform as uniform
    from rigidmc.scene.quantities import grid as grid
    from rigidmc.scene.scene import Scene as Scene
    from rigidmc.scene.settings import Run as Run
    from rigidmc.scene.start import Start as Start
    from rigidmc.scene.vector_distributions import *  # noqa: F403
    from rigidmc.studies.stability_map.stored import open_map as open_map
    from rigidmc.studies.stability_map.stored import zoom_map as zoom_map
    from rigidmc.studies.until import randomised as randomised
    from rigidmc.studies.until import simulate_until as simulate_until


def open(path: str | PathLike[str], allow_code: bool = False) -> "Dataset":
    """Open a result as an xarray Dataset that is read lazily.

    Parameters
    ----------
    path : path_like
        a netCDF file, a zarr store or a run directory
    allow_code : bool, optional
        whether `rerun` and other methods that integrate may run the Python files of a user's own
        parts; what is stored opens without

    Returns
    -------
    xarray.Dataset
        as of `simulate`, see `rigidmc.runs.directory.dataset.open_run`

    Raises
    ------
    FileError
        for a path that is none of them

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov").with_run(members=4, t_end=1.0)
    >>> rm.simulate(scene, output="flips.nc").close()
    >>> with rm.open("flips.nc") as ds:
    ...     ds.sizes["member"]
    4
    """
    result: Dataset
    if isdir(path) and not import_module("rigidmc.files.opening").is_zarr(path):
        result = import_module("rigidmc.runs.directory.dataset").open_run(path, allow_code)
    else:
        result = import_module("rigidmc.results.reader").open_result(path)
        result.encoding["allow_code"] = allow_code
    return result


def _registered() -> dict[str, str]:
    """{name: module} of the classes of effects and laws."""
    effects = import_module("rigidmc.physics.effects").EFFECTS.values()
    laws = import_module("rigidmc.scene.vector_distributions").LAWS
    return {kind.__name__: kind.__module__.removeprefix("rigidmc.") for kind in (*effects, *laws)}


# {a name that is gone: what to write}
_OLD = {"device": "give device= to simulate, run, resume and the studies"}


def __getattr__(name: str) -> Any:
    if name in _OLD:
        raise AttributeError(f"rigidmc.{name} is gone: {_OLD[name]}")
    if name == "__all__":
        return [*_HOMES, "open", *_registered()]
    if name == "protocols":  # what parts of a user's own are made of
        return import_module("rigidmc.protocols")
    home = _HOMES.get(name)
    if home is None and not name.startswith("_"):  # Python itself asks for names with underscores
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

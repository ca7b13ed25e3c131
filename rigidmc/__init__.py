"""rigidmc: Monte Carlo ensembles of rigid bodies with a fixed point, millions of tops in parallel.

    import rigidmc as rm
    start = rm.Start(omega=(rm.normal(0, 1e-3), 1.0, 0.0))
    scene = rm.Scene(rm.Body.from_moments((1, 2, 3)), start=start)
    ds = rm.simulate(scene, integrator="rk4", dt=1e-2, t_end=40.0, members=100_000, every=0.1)

The names below are loaded when first used: importing rigidmc compiles nothing and takes a
millisecond. A Dataset has `ds.rigid` as soon as rigidmc and xarray are imported, see
`rigidmc.views.accessor`.
"""

from importlib import import_module
from os import PathLike
from os.path import isdir
from typing import TYPE_CHECKING, Any

from rigidmc.version import VERSION
from rigidmc.views.when_imported import register

__version__ = VERSION

_EFFECTS = (
    "AxialDamping", "Bath", "BodyTorque", "DryFriction", "EnergyDissipation", "Gravity",
    "GravityGradient", "MatrixDamping", "MovingPivot", "PeriodicTorque", "Potential",
    "QuadraticDrag", "RotatingField", "Rotor", "SpaceTorque", "Spring", "UniformField",
    "ViscousDamping",
)  # fmt: skip
_VECTORS = (
    "Cone", "Correlated", "Fisher", "GibbsMomentum", "Pointing", "SecondMoments", "Shell", "Sphere",
)  # fmt: skip
_HOMES = {
    "Body": "scene.body",
    "FileError": "errors",
    "Flips": "observables",
    "Histogram": "observables",
    "OptionError": "errors",
    "OutputExists": "errors",
    "Passage": "observables",
    "RigidmcError": "errors",
    "Scene": "scene.scene",
    "SceneError": "errors",
    "SceneWarning": "errors",
    "Run": "scene.scene",
    "Start": "scene.start",
    "grid": "scene.quantities",
    **dict.fromkeys(_VECTORS, "scene.laws"),
    "accuracy": "studies.accuracy",
    "distribution": "scene.quantities",
    "free_motion": "mechanics.free_top",
    "free_top": "mechanics.free_top",
    "lagrange_motion": "mechanics.lagrange_top",
    "lagrange_top": "mechanics.lagrange_top",
    "normal": "scene.quantities",
    "randomised": "studies.until",
    "rerun": "runs.rerun",
    "simulate": "runs.simulate",
    "simulate_until": "studies.until",
    "stability_map": "studies.maps.stability_map",
    "warm": "runs.warm",
    "uniform": "scene.quantities",
    **dict.fromkeys(_EFFECTS, "effects"),
}
__all__ = [
    "Body", "Scene", "Start", "Run", "simulate", "open", "rerun", "accuracy", "stability_map",
    "simulate_until", "randomised", "warm",
    "free_top", "free_motion", "lagrange_top", "lagrange_motion",
    "normal", "uniform", "distribution", "grid", "Flips", "Passage", "Histogram", *_EFFECTS,
    "Cone", "Correlated", "Fisher", "GibbsMomentum", "Pointing", "SecondMoments", "Shell", "Sphere",
    "RigidmcError", "SceneError", "OptionError", "FileError", "SceneWarning", "OutputExists",
]  # fmt: skip

if TYPE_CHECKING:
    from xarray import Dataset

    from rigidmc.effects import *  # noqa: F403
    from rigidmc.errors import (
        FileError,
        OptionError,
        OutputExists,
        RigidmcError,
        SceneError,
        SceneWarning,
    )
    from rigidmc.mechanics.free_top import free_motion, free_top
    from rigidmc.mechanics.lagrange_top import lagrange_motion, lagrange_top
    from rigidmc.observables import Flips, Histogram, Passage
    from rigidmc.runs.rerun import rerun
    from rigidmc.runs.simulate import simulate
    from rigidmc.runs.warm import warm
    from rigidmc.scene.body import Body
    from rigidmc.scene.laws import (
        Cone,
        Correlated,
        Fisher,
        GibbsMomentum,
        Pointing,
        SecondMoments,
        Shell,
        Sphere,
    )
    from rigidmc.scene.quantities import distribution, grid, normal, uniform
    from rigidmc.scene.scene import Run, Scene
    from rigidmc.scene.start import Start
    from rigidmc.studies.accuracy import accuracy
    from rigidmc.studies.maps.stability_map import stability_map
    from rigidmc.studies.until import randomised, simulate_until


def open(path: str | PathLike[str], allow_code: bool = False) -> "Dataset":
    """A result as an xarray Dataset that is read lazily: a netCDF file or a run directory.

    allow_code : whether to run the code of a user's own effects in a run directory
    Raises FileError if it is no result; see `rigidmc.runs.gather.open_run` for run directories.
    """
    result: Dataset
    if isdir(path):
        result = import_module("rigidmc.runs.gather").open_run(path, allow_code)
    else:
        result = import_module("rigidmc.storage.reader").open_result(path)
    return result


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        words = f"module 'rigidmc' has no attribute '{name}'"
        if not name.startswith("_"):  # Python itself asks for those that do
            close = import_module("rigidmc.errors").nearest(name, __all__)
            words += f"; did you mean '{close}'?" if close else ""
        raise AttributeError(words)
    value = getattr(import_module(f"rigidmc.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


register()

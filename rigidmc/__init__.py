"""rigidmc: Monte Carlo ensembles of rigid bodies with a fixed point, millions of tops in parallel.

    import rigidmc as rm
    start = rm.Start(omega=(rm.normal(0, 1e-3), 1.0, 0.0))
    scene = rm.Scene(rm.Body.from_moments((1, 2, 3)), start=start)
    ds = rm.simulate(scene, integrator="rk4", dt=1e-2, t_end=40.0, members=100_000, every=0.1)

The names are loaded when first used: importing rigidmc compiles nothing and takes a millisecond.
A Dataset has `ds.rigid` as soon as rigidmc and xarray are imported, see `rigidmc.views.accessor`.
"""

from importlib import import_module
from os.path import isdir
from typing import TYPE_CHECKING

from rigidmc.version import VERSION
from rigidmc.views.when_imported import register

__version__ = VERSION

_LAWS = (
    "Cone",
    "Correlated",
    "Fisher",
    "GibbsMomentum",
    "Pointing",
    "SecondMoments",
    "Shell",
    "Sphere",
)
_HOMES = {  # name: module; the classes of effects come beside these, see `_effects`
    "Body": "scene.body",
    "Scene": "scene.scene",
    "Start": "scene.start",
    "Run": "scene.settings",
    "simulate": "runs.simulate",
    "rerun": "runs.rerun",
    "accuracy": "studies.accuracy",
    "stability_map": "studies.maps.stability_map",
    "simulate_until": "studies.until",
    "randomised": "studies.until",
    "warm": "runs.warm",
    "free_top": "mechanics.free_top",
    "free_motion": "mechanics.free_top",
    "lagrange_top": "mechanics.lagrange_top",
    "lagrange_motion": "mechanics.lagrange_top",
    "normal": "scene.quantities",
    "uniform": "scene.quantities",
    "distribution": "scene.quantities",
    "grid": "scene.quantities",
    "Flips": "observables",
    "Passage": "observables",
    "Histogram": "observables",
    **dict.fromkeys(_LAWS, "scene.laws"),
    "SceneError": "errors",
    "SceneWarning": "errors",
    "OutputExists": "errors",
}

if TYPE_CHECKING:
    from rigidmc.effects import *  # noqa: F403
    from rigidmc.errors import OutputExists as OutputExists
    from rigidmc.errors import SceneError as SceneError
    from rigidmc.errors import SceneWarning as SceneWarning
    from rigidmc.mechanics.free_top import free_motion as free_motion
    from rigidmc.mechanics.free_top import free_top as free_top
    from rigidmc.mechanics.lagrange_top import lagrange_motion as lagrange_motion
    from rigidmc.mechanics.lagrange_top import lagrange_top as lagrange_top
    from rigidmc.observables import Flips as Flips
    from rigidmc.observables import Histogram as Histogram
    from rigidmc.observables import Passage as Passage
    from rigidmc.runs.rerun import rerun as rerun
    from rigidmc.runs.simulate import simulate as simulate
    from rigidmc.runs.warm import warm as warm
    from rigidmc.scene.body import Body as Body
    from rigidmc.scene.laws import Cone as Cone
    from rigidmc.scene.laws import Correlated as Correlated
    from rigidmc.scene.laws import Fisher as Fisher
    from rigidmc.scene.laws import GibbsMomentum as GibbsMomentum
    from rigidmc.scene.laws import Pointing as Pointing
    from rigidmc.scene.laws import SecondMoments as SecondMoments
    from rigidmc.scene.laws import Shell as Shell
    from rigidmc.scene.laws import Sphere as Sphere
    from rigidmc.scene.quantities import distribution as distribution
    from rigidmc.scene.quantities import grid as grid
    from rigidmc.scene.quantities import normal as normal
    from rigidmc.scene.quantities import uniform as uniform
    from rigidmc.scene.scene import Scene as Scene
    from rigidmc.scene.settings import Run as Run
    from rigidmc.scene.start import Start as Start
    from rigidmc.studies.accuracy import accuracy as accuracy
    from rigidmc.studies.maps.stability_map import stability_map as stability_map
    from rigidmc.studies.until import randomised as randomised
    from rigidmc.studies.until import simulate_until as simulate_until


def open(path, allow_code=False):
    """A result as an xarray Dataset, read lazily: of a netCDF file, or of a run directory.

    Raises SceneError for a path that is neither. See `rigidmc.runs.gather.open_run`.
    """
    if isdir(path):
        return import_module("rigidmc.runs.gather").open_run(path, allow_code)
    return import_module("rigidmc.storage").open_result(path)


def _effects():
    """The names of the classes of effects."""
    return [kind.__name__ for kind in import_module("rigidmc.effects").EFFECTS.values()]


def __getattr__(name):
    if name == "__all__":
        return [*_HOMES, "open", *_effects()]
    home = _HOMES.get(name)
    if home is None and not name.startswith("_"):  # Python itself asks for names with underscores
        home = "effects" if name in _effects() else None
    if home is None:
        words = f"module 'rigidmc' has no attribute '{name}'"
        if not name.startswith("_"):
            close = import_module("rigidmc.errors").nearest(name, __getattr__("__all__"))
            words += f"; did you mean '{close}'?" if close else ""
        raise AttributeError(words)
    value = getattr(import_module(f"rigidmc.{home}"), name)
    globals()[name] = value
    return value


def __dir__():
    return [*__getattr__("__all__"), "__version__"]


register()

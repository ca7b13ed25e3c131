"""Picture of a scene in a heat bath, compared with the Gibbs distribution."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.engine.formulas import energies
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects.protocol import is_random, numbers
from rigidmc.planning.initial import members_at_start
from rigidmc.planning.steps import physics
from rigidmc.results.labels import count_text, value_text
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.views.figures import CORE, INK, PATH, new_figure

THEORY = 200_000  # attitudes, uniform on SO(3), weighted to sample the Gibbs distribution


def gibbs(ds: xr.Dataset, allow_code: bool = False) -> Figure:
    """Compare the last state of a scene in a bath with exp(-(T + V)/kT).

    In theory, momenta about the three axes are normal with <L_i^2> = I_i kT. The theoretical
    distribution of the potential energy V comes from 200,000 uniform attitudes with weights
    exp(-V/kT). Titles show averages with their standard errors; the error of a run has another term
    of order dt^2.

    ds : result with momentum, and with attitude if effects have an energy
    Raises ValueError for scenes without a bath or with two, and for scenes whose body, kT or
    energies differ between members.
    """
    scene, ds = scene_of(ds, allow_code=allow_code), in_principal_axes(ds)
    baths = [effect for effect in scene.effects if is_random(effect)]
    if len(baths) != 1:
        raise ValueError("gibbs needs a scene with exactly one bath")
    kT, potentials = baths[0].kT, [e for e in scene.effects if implements(e, "energy")]
    parameters = (value for effect in potentials for _, _, value in numbers(effect))
    if not is_shared(*scene.body.quantities(), kT, *parameters):
        raise ValueError("gibbs needs one body, one kT and the same energies for all members")
    if "momentum" not in ds or (potentials and "attitude" not in ds):
        raise ValueError(
            "gibbs needs momentum and attitude, which were not saved:"
            ' run with save=("momentum", "attitude")'
        )
    good = ds.status.values == 0
    l = ds.momentum.isel(time=-1).transpose("axis", "member").values[:, good]
    moments = ds.moments.transpose("axis", "member").values[:, good]
    what = f"{count_text(good.sum(), 'member')} at t = {value_text(float(ds.time[-1]), ds.time)}"
    title = f"{scene.title}: {what} and the Gibbs distribution"
    figure = new_figure(title, (11.0 if potentials else 6.0, 4.6))
    places = figure.subplots(1, 2 if potentials else 1, squeeze=False)[0]
    _momenta(places[0], l / np.sqrt(moments * kT))
    if potentials:
        q = ds.attitude.isel(time=-1).transpose("quat", "member").values[:, good]
        _energies(places[1], scene, q, kT)
    return figure


def _momenta(axes: Axes, x: Array) -> None:
    """Draw histograms of reduced momenta (axis, member), which should be normal."""
    edges = np.linspace(-4.5, 4.5, 46)
    for row, (color, style) in enumerate(((CORE, "-"), (INK, "--"), (PATH, ":"))):
        height = np.histogram(x[row], edges, density=True)[0]
        name = f"axis {row + 1}"
        axes.stairs(height, edges, color=color, linestyle=style, linewidth=1.6, label=name)
    line = np.linspace(-4.5, 4.5, 400)
    normal = np.exp(-0.5 * line**2) / np.sqrt(2.0 * np.pi)
    axes.plot(line, normal, color=INK, linewidth=0.8, label="Gibbs")
    twice = (x**2).sum(0)
    mean, error = twice.mean() / 3.0, twice.std() / np.sqrt(x.shape[1]) / 3.0
    axes.set(xlabel="Lᵢ/√(Iᵢ kT)", ylabel="density", yscale="log", ylim=(1e-5, 1.0))
    words = f"angular momentum: ⟨T⟩ = {mean:.4f} ± {error:.4f} of 3/2 kT"
    axes.set_title(words, fontsize=10)
    axes.legend(fontsize=8, frameon=False)


def _energies(axes: Axes, scene: Scene, q: Array, kT: float) -> None:
    """Draw histograms of the potential energy in the run and in the Gibbs distribution."""
    block, _ = members_at_start(scene.model, scene.run, 0, 1)
    body, effects = physics(scene.effects, block)
    run = np.ravel(energies(effects, body, tuple(q))) / kT
    random = np.random.default_rng(0).normal(size=(4, THEORY))
    uniform = random / np.linalg.norm(random, axis=0)
    theory = np.ravel(energies(effects, body, tuple(uniform))) / kT
    weights = np.exp(theory.min() - theory)
    low, high = min(run.min(), theory.min()), max(run.max(), np.quantile(theory, 0.999))
    edges = np.linspace(low, high, 41)
    height = np.histogram(run, edges, density=True)[0]
    axes.stairs(height, edges, fill=True, color=CORE, label="run")
    height = np.histogram(theory, edges, density=True, weights=weights)[0]
    axes.stairs(height, edges, color=INK, linewidth=1.4, label="Gibbs")
    mean, error = run.mean(), run.std() / np.sqrt(run.size)
    expected = np.average(theory, weights=weights)
    axes.set(xlabel="potential energy V/kT", ylabel="density")
    words = f"⟨V⟩ = {mean:.4f} ± {error:.4f} kT; Gibbs {expected:.4f} kT"
    axes.set_title(words, fontsize=10)
    axes.legend(fontsize=8, frameon=False)

"""A picture of a scene in a bath against the law of Gibbs."""

import numpy as np

from rigidmc.effects.parameters import numbers
from rigidmc.effects.protocol import is_random
from rigidmc.engine.forces import energies
from rigidmc.planning.rates import physics
from rigidmc.planning.stage import stage
from rigidmc.scene.file import scene_of
from rigidmc.scene.quantities import is_shared
from rigidmc.views.ensemble import CORE, INK, PATH, new_figure

THEORY = 200_000  # attitudes, uniform on SO(3), which the law of Gibbs weighs


def gibbs(ds, allow_code=False):
    """The last state of a scene in a bath against exp(-(T + V)/kT): momenta about the three axes, and the potential energy.

    The momenta are normal with <L_i^2> = I_i kT. The energies V of the law are those of 200,000 uniform attitudes with the weights exp(-V/kT).
    Averages in the titles have their standard errors; those of the run are off by order dt^2 beside.

    ds : with momentum, and attitude where effects have an energy; ValueError for scenes without a bath or with two, and for those whose body, kT
        or energies differ from member to member
    """
    scene = scene_of(ds, allow_code=allow_code)
    baths = [e for e in scene.effects if is_random(e)]
    if len(baths) != 1:
        raise ValueError("gibbs needs a scene with a bath, and with one")
    heat, held = baths[0].kT, [e for e in scene.effects if hasattr(e, "energy")]
    if not is_shared(
        *scene.body.quantities(), heat, *(value for e in held for _, _, value in numbers(e))
    ):
        raise ValueError("gibbs needs one body, one kT and the same energies for all members")
    if "momentum" not in ds or (held and "attitude" not in ds):
        raise ValueError(
            'gibbs needs momentum and attitude, which were not saved: run with save=("momentum", "attitude")'
        )
    good = ds.status.values == 0
    l = ds.momentum.isel(time=-1).transpose("axis", "member").values[:, good]
    moments = ds.moments.transpose("axis", "member").values[:, good]
    figure = new_figure(
        f"{scene.title}: {good.sum():,} members at t = {float(ds.time[-1]):.6g} s against the law of Gibbs",
        (11.0 if held else 6.0, 4.6),
    )
    places = figure.subplots(1, 2 if held else 1, squeeze=False)[0]
    _momenta(places[0], l / np.sqrt(moments * heat))
    if held:
        q = ds.attitude.isel(time=-1).transpose("quat", "member").values[:, good]
        _energies(places[1], scene, q, heat)
    return figure


def _momenta(axes, x):
    """Histograms of reduced momenta, which should be normal."""
    edges = np.linspace(-4.5, 4.5, 46)
    for row, (color, style) in enumerate(((CORE, "-"), (INK, "--"), (PATH, ":"))):
        axes.stairs(
            np.histogram(x[row], edges, density=True)[0],
            edges,
            color=color,
            linestyle=style,
            linewidth=1.6,
            label=f"axis {row + 1}",
        )
    line = np.linspace(-4.5, 4.5, 400)
    axes.plot(
        line, np.exp(-0.5 * line**2) / np.sqrt(2.0 * np.pi), color=INK, linewidth=0.8, label="Gibbs"
    )
    heat, error = (x**2).sum(0).mean() / 3.0, (x**2).sum(0).std() / np.sqrt(x.shape[1]) / 3.0
    axes.set(xlabel="$L_i/\\sqrt{I_i kT}$ [1]", ylabel="density", yscale="log", ylim=(1e-5, 1.0))
    axes.set_title(
        f"angular momentum: $\\langle T\\rangle$ = {heat:.4f} ± {error:.4f} of 3/2 kT", fontsize=10
    )
    axes.legend(fontsize=8, frameon=False)


def _energies(axes, scene, q, heat):
    """Histogram of the potential energy, and that of uniform attitudes with the weights of Gibbs."""
    few, _ = stage(scene, 0, 1, True)
    body, effects = physics(scene.effects, few)
    held = np.ravel(energies(effects, body, tuple(q))) / heat
    some = np.random.default_rng(0).normal(size=(4, THEORY))
    free = np.ravel(energies(effects, body, tuple(some / np.linalg.norm(some, axis=0)))) / heat
    weights = np.exp(free.min() - free)
    edges = np.linspace(min(held.min(), free.min()), max(held.max(), np.quantile(free, 0.999)), 41)
    axes.stairs(
        np.histogram(held, edges, density=True)[0], edges, fill=True, color=CORE, label="run"
    )
    axes.stairs(
        np.histogram(free, edges, density=True, weights=weights)[0],
        edges,
        color=INK,
        linewidth=1.4,
        label="Gibbs",
    )
    mean, error, theory = (
        held.mean(),
        held.std() / np.sqrt(held.size),
        np.average(free, weights=weights),
    )
    axes.set(xlabel="potential energy $V/kT$ [1]", ylabel="density")
    axes.set_title(
        f"$\\langle V\\rangle$ = {mean:.4f} ± {error:.4f} kT; Gibbs {theory:.4f} kT", fontsize=10
    )
    axes.legend(fontsize=8, frameon=False)

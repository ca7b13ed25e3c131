"""Saved, retained and monitored variables of a run: names resolved to observables, once."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import facts, is_conservative, is_random
from rigidmc.physics.observables import (
    bind,
    find_observable,
    monitored_observables,
    recorded_observables,
    saved_observables,
)
from rigidmc.physics.observables.protocol import EnsembleObservable, NoiseSum
from rigidmc.physics.observables.saving import outputs_with_derivatives, save_words, summaries
from rigidmc.scene.settings import Run

Labelled = tuple[tuple[str, Any], ...]  # (label, observable) of each


class Recording(NamedTuple):
    """Observables recorded for each member.

    names : observables saved at save times
    retained : {name: amount kept}, see `rigidmc.physics.observables.saving`
    recorded : {name: observable} as compiled: the saved ones, then those that only histograms need
    monitored : observables monitored over all steps
    has_work : whether the works of the effects are saved
    observables : the scene's observables with their parameters
    """

    names: tuple[str, ...]
    retained: dict[str, str]
    recorded: dict[str, Any]
    monitored: Labelled
    has_work: bool
    observables: tuple[Any, ...]

    def observable(self, name: str) -> Any:
        """Return the observable of this name at save times, shipped or custom."""
        return find_observable(self.observables, name)

    @property
    def differentiable(self) -> tuple[str, ...]:
        """The results over all steps that have derivatives by parameters of the scene."""
        return tuple(n for pair in self.monitored for n in outputs_with_derivatives(*pair))

    @property
    def has_noise_sums(self) -> bool:
        """Whether sums over the noise of all steps are recorded."""
        return any(isinstance(part, NoiseSum) for _, part in self.monitored)

    @property
    def histograms(self) -> Labelled:
        """The counts over all members."""
        return tuple(
            (label, part) for label, part in self.monitored if isinstance(part, EnsembleObservable)
        )


def make_recording(run: Run, observables: tuple[Any, ...], effects: Sequence[Any]) -> Recording:
    """Return the Recording of a scene."""
    names = saved_observables(run.save, observables)
    retained = save_words(run.keep, names, observables)
    at_saves = recorded_observables(run.save, observables)
    return Recording(
        names,
        retained,
        {name: bind(part, effects) for name, part in at_saves.items()},
        tuple(monitored_observables((*run.save, *summaries(retained)), observables)),
        "work" in run.save,
        observables,
    )


def conservation(effects: Sequence[Any], has_work: bool) -> dict[str, str]:
    """Return {"energy", "energy_drift", "l2", "lz": "yes", or "no: ..." with the reason} from the
    physics of the effects.

    energy_drift : of the energy, minus the works if these are saved
    """
    by_label = label_effects(effects)
    lossy = [label for label, e in by_label if not is_conservative(e)]
    random = [label for label, e in by_label if is_random(e)]
    energy, drift = _verdict(lossy, "the energy"), "yes"
    if random:
        walk = "the energy error of a step of order 2 grows as dt^2 sqrt(t)"
        drift = f"no: under {', '.join(random)} {walk}"
    l2 = [label for label, e in by_label if not facts(e).conserves_l2]
    lz = [label for label, e in by_label if not facts(e).conserves_lz]
    return {
        "energy": energy,
        "energy_drift": drift if has_work else energy,
        "l2": _verdict(l2, "the angular momentum"),
        "lz": _verdict(lz, "L_z"),
    }


def untracked_effects(effects: Sequence[Any]) -> list[str]:
    """Return the labels of the effects whose work is not part of `energy`."""
    return [label for label, e in label_effects(effects) if not implements(e, "energy")]


def _verdict(labels: Sequence[str], quantity: str) -> str:
    """Return "yes", or "no" with the effects that change a quantity."""
    if not labels:
        return "yes"
    return f"no: {', '.join(labels)} change{'s' * (len(labels) == 1)} {quantity}"

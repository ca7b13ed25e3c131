"""From a scene to rows for the kernel: the members of a block at their start, and how fast they may move."""

from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from rigidmc.dynamics.euler import MassProperties, kinetic_energy
from rigidmc.dynamics.methods import implements
from rigidmc.dynamics.so3 import dot
from rigidmc.effects import labelled
from rigidmc.effects.parameters import filled, parameter_count, shape
from rigidmc.effects.protocol import is_random
from rigidmc.effects.sums import total_energy_scale
from rigidmc.engine import layout
from rigidmc.engine.forces import energies, torques
from rigidmc.engine.frame import Noise
from rigidmc.engine.streams import key_of, stream_of, uniforms
from rigidmc.errors import SceneError
from rigidmc.scene.body import broken
from rigidmc.scene.checks import PILOT
from rigidmc.scene.laws.directions import uniform_attitudes
from rigidmc.scene.laws.protocol import Facts, Law
from rigidmc.scene.points import Antithetic, Recorder, points
from rigidmc.scene.quantities import draw

KEPT = 2**26  # bytes of members that are kept from plan to run: 180,000 members
MOST_OWN_STEPS = 2**24  # of a member in a round: no member stops a run, however fast it spins


def stage(scene, first, count, carried, span=None, more=0):
    """(block, start): rows of `count` members as the kernel wants them, and what they were made from by the names of the result.

    span : time [s] in which a member makes its own number of steps, where the scene sets `turn`
    more : rows for what is kept of every step, see `rigidmc.planning.watch`
    """
    known = _known.get(scene)
    if known is None or known.carried != carried or first + count > known.block.shape[1]:
        block, start = _staged(scene, source(scene), first, count, carried)
    else:
        part = slice(first, first + count)
        block, start = (
            known.block[:, part].copy(),
            {name: values[..., part] for name, values in known.start.items()},
        )
    if span is not None:
        block[layout.STEPS] = own_steps(rates(scene.effects, block), span, scene.run.turn)
    return (np.concatenate([block, np.zeros((more, count))]) if more else block), start


class Members(NamedTuple):
    """The first members of a scene at their start: rows that nobody changes, and what they were made from."""

    block: np.ndarray
    start: dict
    carried: bool


def first_members(scene, count, carried):
    """The Members that a plan looks at, kept until they run."""
    known = _known.get(scene)
    if known is None or known.carried != carried or known.block.shape[1] < count:
        block, start = _staged(scene, source(scene), 0, count, carried)
        known = Members(block, start, carried)
        if known.block.nbytes <= KEPT:
            _known[scene] = known
    return known


_known: WeakKeyDictionary[Any, Members] = WeakKeyDictionary()
_sources: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()


def source(scene):
    """What the members of a scene are drawn from: its seed, or the Points of `run.points`."""
    run = scene.run
    if run.points == "independent":
        return run.seed
    if run.points == "antithetic":
        return Antithetic(run.seed)
    if scene not in _sources:
        seen = Recorder()
        _staged(
            scene, seen, 0, 1, True
        )  # the attitude too, so that no point depends on what is saved
        _sources[scene] = points(
            run.seed, run.points, tuple(seen.dimensions), run.strata or run.first + run.members
        )
    return _sources[scene]


def _staged(scene, seed, first, count, carried):
    moments, mass, centre = scene.body.sample(seed, first, count)
    effects = {
        f"{label}_{field}": draw(
            value if shape(e, field) else (value,), seed, f"effects.{label}.{field}", first, count
        )
        for label, e in labelled(scene.effects)
        for field, value in zip(e._fields, e, strict=True)
    }
    drawn = {name: values if len(values) > 1 else values[0] for name, values in effects.items()}
    block = np.zeros((block_rows(scene), count))
    block[layout.ATTITUDE] = 1.0
    with np.errstate(all="ignore"):
        block[layout.BODY : layout.EFFECTS] = MassProperties.of(
            tuple(moments), tuple(mass * centre)
        )
    if effects:
        block[layout.EFFECTS : layout.EFFECTS + parameter_count(*scene.effects)] = np.concatenate(
            list(effects.values())
        )
    if carried:
        block[layout.ATTITUDE : layout.MOMENTUM] = scene.start.quaternions(
            seed, first, count, facts(scene, block, moments)
        )
    which, spin = scene.start.spin(seed, first, count, facts(scene, block, moments))
    start = {"moments": moments, "mass": mass, "centre": centre, f"start_{which}": spin, **drawn}
    if carried:
        start["start_attitude"] = block[layout.ATTITUDE : layout.MOMENTUM].copy()
        if scene.start.by_euler_angles:
            start["start_euler"] = draw(scene.start.attitude, seed, "start.attitude", first, count)
    block[layout.MOMENTUM : layout.REST] = spin * moments if which == "omega" else spin
    bad = (
        broken(moments) | ~(mass > 0) | np.isnan(spin).any(0) | np.isnan(block[layout.ATTITUDE])
    )  # a shell may have too little energy
    block[layout.STATUS, bad] = layout.STATUSES["invalid_input"]
    block[layout.STEPS] = 1.0
    return block, start


def facts(scene, block, moments):
    """What vectors may depend on: the Facts of the members of a block that has its bodies, effects and attitudes."""
    body, effects = physics(scene.effects, block)
    q = tuple(block[layout.ATTITUDE : layout.MOMENTUM])
    none = np.zeros(block.shape[1])
    held = tuple(
        effect for effect in effects if implements(effect, "energy")
    )  # a bath has a scale and no potential
    return Facts(
        moments,
        lambda q: energies(effects, body, tuple(q)) + none,
        total_energy_scale(held, body) + none,
        q,
    )


def check_starts(scene):
    """Raise SceneError where no member has a start, or where the attitudes of an ensemble are too rare among uniform ones to be found."""
    which = "omega" if scene.start.momentum is None else "momentum"
    if scene.start.attitude != "ensemble":
        if (
            isinstance(getattr(scene.start, which), Law)
            and stage(scene, 0, PILOT, True)[0][layout.STATUS].all()
        ):
            rule = f"none of the first {PILOT} members has one: its energy, temperature or size cannot be"
            raise SceneError("start", which, None, rule)
        return
    block, start = _staged(scene.with_run(), scene.run.seed, 0, PILOT, False)
    known = facts(scene, block, start["moments"])
    share = scene.start.momentum.share(scene.run.seed, 0, PILOT, known)
    u, v, w, _ = uniforms(scene.run.seed, "start.attitude.ensemble", 0, PILOT, 0)
    tried = uniform_attitudes(u, v, w)
    if (np.abs(known.potential(tried)) > known.bound * (1.0 + 1e-9)).any():
        rule = "needs the largest potential energy that an attitude may have: an effect of your own tells it by energy_scale(self, body) [J]"
        raise SceneError("start", "attitude", "ensemble", rule)
    found = float(np.nanmean(share(tried)))
    if not found >= 0.01:
        rule = (
            f"of uniform attitudes the ensemble keeps {found:.1g}, less than 1 in 100: too cold to be drawn so; under gravity alone a body with "
            "its centre on axis 3 is exp(-V/kT) by attitude = { pointing = { direction = [0, 0, -1], kappa = m g h/kT } }"
        )
        raise SceneError("start", "attitude", "ensemble", rule)


def ledger(scene):
    """For each effect () where its energy tells its work, else (0.0,); () where no works are saved. See `rigidmc.engine.program.Program`."""
    if "work" not in scene.run.save:
        return ()
    return tuple(() if implements(effect, "energy") else (0.0,) for effect in scene.effects)


def block_rows(scene):
    """How many rows a block of a scene has."""
    return layout.EFFECTS + parameter_count(*scene.effects) + 2 * len(ledger(scene))


def noise(scene, first):
    """What decides the noise of random effects, of members from `first` on."""
    streams = [
        stream_of(f"effects.{label}.noise")
        for label, effect in labelled(scene.effects)
        if is_random(effect)
    ]
    key, other = key_of(scene.run.seed)
    return Noise(key, other, np.array(streams or [0], np.uint64), first)


def physics(effects, block):
    """(body, effects) of the members of a block, their fields as arrays."""
    made, row = [], layout.EFFECTS
    for effect in effects:
        made.append(filled(type(effect), block[row : row + parameter_count(effect)]))
        row += parameter_count(effect)
    return MassProperties(*block[layout.BODY : layout.EFFECTS]), tuple(made)


def rates(effects, block):
    """How fast each member may move [rad/s]: sqrt(2 (E + V)/I) + sqrt(V/I), I the smallest moment, E the energy, V the largest potential one.

    The first term bounds |omega| for all times, the second is the rate at which torques act; where effects have no energy, by their
    torque at the start.
    """
    body, effects = physics(effects, block)
    q, l = (
        tuple(block[layout.ATTITUDE : layout.MOMENTUM]),
        tuple(block[layout.MOMENTUM : layout.REST]),
    )
    with np.errstate(all="ignore"):
        highest, smallest = (
            total_energy_scale(effects, body),
            1.0 / np.max([body.i1, body.i2, body.i3], axis=0),
        )
        torque = torques(effects, body, q, l)
        swing = np.maximum(highest, np.sqrt(dot(torque, torque)))
        energy = kinetic_energy(body, l) + energies(effects, body, q) + highest
        return np.sqrt(2.0 * np.maximum(energy, 0.0) / smallest) + np.sqrt(swing / smallest)


def together(block):
    """The order of a block's members by their own steps: those that make as many go together."""
    steps = block[layout.STEPS]
    return np.argsort(
        steps.astype("u2") if steps.max(initial=0.0) < 2**16 else steps, kind="stable"
    )  # by radix, 15 times as fast


def own_steps(rate, span, turn):
    """Steps in which members that move at `rate` turn by at most `turn` each, over a time `span`."""
    with np.errstate(all="ignore"):
        steps = np.ceil(span * rate / turn)
    return np.clip(np.where(np.isfinite(steps), steps, 1.0), 1.0, MOST_OWN_STEPS)

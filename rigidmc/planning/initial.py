"""From a scene to rows for the kernel: the members of a block at their start."""

from collections.abc import Mapping
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.formulas import energies
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import Noise
from rigidmc.engine.streams import key_of, stream_of, uniforms
from rigidmc.errors import SceneError
from rigidmc.mechanics.inertia import broken, quaternions, tensors_into, vectors_into
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import Flag, flag, implements
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.physics.effects import labelled, shared
from rigidmc.physics.effects.protocol import facts as effect_facts
from rigidmc.physics.effects.protocol import parameter_count, shape, takes_noise
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.planning.steps import Array, own_steps, physics, rates
from rigidmc.scene.quantities import draw
from rigidmc.scene.sampling import (
    DESIGNS,
    Antithetic,
    Design,
    Dimension,
    Given,
    Points,
    Recorder,
    points,
)
from rigidmc.scene.scene import Scene
from rigidmc.scene.validation import PILOT
from rigidmc.scene.vector_distributions.protocol import Ensemble, Facts, Law
from rigidmc.scene.vector_distributions.vectors import uniform_attitudes

CACHED = 2**26  # bytes of members that are kept from plan to run: 180,000 members

APART = 256  # members that are staged for nothing take less time than another call
RANGE = 2**14  # members staged at once at most: 8 MB

Start = dict[str, Array]  # what members were made from, by the names of the result
# what members are drawn from
Source = int | Antithetic | Design | Given | Points | Recorder


def stage(
    scene: Scene, first: int, count: int, carried: bool, span: float | None = None, more: int = 0
) -> tuple[Array, Start]:
    """(block, start): rows of `count` members for the kernel, and what they were made from.

    carried : whether the attitude is followed
    span : time [s] in which a member makes its own number of steps, if the scene sets `turn`
    more : rows for what is kept of every step, see `rigidmc.planning.monitors`
    """
    block = np.zeros((block_rows(scene) + more, count))
    known = _known.get(scene)
    if known is None or known.carried != carried or first + count > known.block.shape[1]:
        start = _fill(block, scene, source(scene), first, carried)
    else:
        part = slice(first, first + count)
        for rows in _filled(scene):
            block[rows] = known.block[rows, part]
        start = {name: values[..., part] for name, values in known.start.items()}
    if span is not None:
        block[layout.STEPS] = own_steps(rates(scene.effects, block), span, scene.run.turn)
    return block, start


def stage_some(
    scene: Scene,
    members: NDArray[np.int64],
    carried: bool,
    span: float | None = None,
    more: int = 0,
) -> tuple[Array, Start]:
    """As `stage`, of members by their indices, in any order.

    Draws come by ranges of members, so those between are staged too, unless they are many.
    """
    apart = np.diff(members)
    cut = (apart < 0) | (apart > APART) | (np.diff(members // RANGE) != 0)
    blocks, starts = list[Array](), list[Start]()
    for part in np.split(members, np.flatnonzero(cut) + 1):
        low, columns = int(part[0]), part - part[0]
        block, start = stage(scene, low, int(columns[-1]) + 1, carried, span, more)
        # block[:, columns] would have another memory layout
        blocks.append(np.take(block, columns, axis=1))
        starts.append({name: values[..., columns] for name, values in start.items()})
    start = {name: np.concatenate([one[name] for one in starts], axis=-1) for name in starts[0]}
    return np.concatenate(blocks, axis=1), start


class Members(NamedTuple):
    """The first members of a scene at their start: a block that nobody changes, of which only the
    rows of `_filled` are set, and what the members were made from."""

    block: Array
    start: Start
    carried: bool


def first_members(scene: Scene, count: int, carried: bool) -> Members:
    """The Members that a plan looks at, kept until they run."""
    known = _known.get(scene)
    if known is None or known.carried != carried or known.block.shape[1] < count:
        # zeros in all rows, and their copies, took 1 of 21 ms for 65,536 members and one step
        block = np.empty((block_rows(scene), count))
        start = _fill(block, scene, source(scene), 0, carried)
        known = Members(block, start, carried)
        if known.block.nbytes <= CACHED:
            _known.clear()  # many scenes that ran may live at once
            _known[scene] = known
    return known


_known: WeakKeyDictionary[Scene, Members] = WeakKeyDictionary()
_sources: WeakKeyDictionary[Scene, Points | Design] = WeakKeyDictionary()


def source(scene: Scene) -> Source:
    """What the members of a scene are drawn from: its seed, or the Points of `run.points`."""
    run = scene.run
    if run.points == "independent":
        return run.seed
    if run.points == "antithetic":
        return Antithetic(run.seed)
    if scene not in _sources:
        strata = run.strata or run.first + run.members
        if run.points in DESIGNS:
            _sources[scene] = DESIGNS[run.points](run.seed, groups(scene)[1], run.dtype)
        else:
            _sources[scene] = points(run.seed, run.points, drawn(scene), strata)
    return _sources[scene]


def drawn(scene: Scene) -> tuple[Dimension, ...]:
    """The random numbers that a member of a scene draws."""
    recorder = Recorder()
    # with the attitude, so that no point depends on what is saved
    staged(scene, recorder, 1, True)
    return tuple(recorder.dimensions)


def groups(scene: Scene) -> tuple[list[str], dict[Dimension, int]]:
    """(the names of the uncertain numbers of a scene, {dimension: place of its name}).

    A number has the name that a map gives it, such as start.omega.2. The numbers that a law of a
    whole vector or of the attitude draws are one group, with the name of what it draws.
    """
    names = {dimension: _name(scene, *dimension) for dimension in drawn(scene)}
    places = {name: i for i, name in enumerate(dict.fromkeys(names.values()))}
    return list(places), {dimension: places[name] for dimension, name in names.items()}


def _name(scene: Scene, stream: str, draw: int, word: int) -> str:
    """The name of what the number `word` of a draw from a random stream is for."""
    table, first, *rest = stream.split(".")
    if table == "effects":
        effect = dict(labelled(scene.effects))[first]
        return f"{stream}.{4 * draw + word + 1}" if shape(effect, rest[0]) else stream
    whole = f"{table}.{first}"
    if first == "attitude":
        angles = scene.start.by_euler_angles
        return f"{whole}.{('phi', 'theta', 'psi')[word]}" if angles else whole
    if whole in ("body.mass", "body.tensor"):  # a tensor is a law of all its numbers
        return whole
    value = getattr(getattr(scene, table), first)
    return f"{whole}.{4 * draw + word + 1}" if isinstance(value, tuple) else whole


def staged(
    scene: Scene, seed: Source, count: int, carried: bool, more: int = 0
) -> tuple[Array, Start]:
    """The first `count` members, drawn from `seed`; see `stage`."""
    block = np.zeros((block_rows(scene) + more, count))
    return block, _fill(block, scene, seed, 0, carried)


def _filled(scene: Scene) -> tuple[slice, ...]:
    """The rows of a block that `_fill` sets; the others are 0 until the engine begins."""
    end = layout.EFFECTS + parameter_count(*scene.effects)
    return (
        slice(layout.ATTITUDE, layout.REST),
        slice(layout.STATUS, layout.STATUS + 1),
        slice(layout.STEPS, end),
    )


def _fill(block: Array, scene: Scene, seed: Source, first: int, carried: bool) -> Start:
    """Set the rows of `_filled` for members from index `first` on; what these are made from."""
    count = block.shape[1]
    moments, mass, centre, turn = scene.body.sample_turned(seed, first, count)
    effects = {
        f"{label}_{field}": draw(
            value if shape(e, field) else (value,), seed, f"effects.{label}.{field}", first, count
        )
        for label, e in labelled(scene.effects)
        for field, value in zip(e._fields, e, strict=True)
    }
    if turn is not None:
        effects = _turned(scene, effects, turn)
    with np.errstate(all="ignore"):
        body = MassProperties.of(tuple(moments), tuple(mass * centre))
    for row, values in zip(block[layout.BODY : layout.EFFECTS], body, strict=True):
        row[:] = values
    if effects:
        end = layout.EFFECTS + parameter_count(*scene.effects)
        acting = dict(effects)
        for name, sources in shared(scene.effects).items():
            acting[name] = np.sum([effects[one] for one in sources], axis=0)
        block[layout.EFFECTS : end] = np.concatenate(list(acting.values()))
    block[layout.STATUS], block[layout.STEPS] = layout.STATUSES["ok"], 1.0
    block[layout.ATTITUDE : layout.MOMENTUM] = np.array([[1.0], [0.0], [0.0], [0.0]])
    if carried:
        known = facts(scene, block, moments)
        attitude = scene.start.quaternions(seed, first, count, known)
        if turn is not None and scene.start.attitude != "ensemble":
            attitude = multiply(tuple(attitude), quaternions(turn))
        block[layout.ATTITUDE : layout.MOMENTUM] = attitude
    word, spin = scene.start.spin(seed, first, count, facts(scene, block, moments))
    if turn is not None and not isinstance(getattr(scene.start, word), Ensemble):
        spin = vectors_into(turn, spin)
    start = {"moments": moments, "mass": mass, "centre": centre, f"start_{word}": spin}
    if turn is not None:
        start["principal_axes"] = np.stack(quaternions(turn))
    start |= {name: values if len(values) > 1 else values[0] for name, values in effects.items()}
    if carried:
        start["start_attitude"] = block[layout.ATTITUDE : layout.MOMENTUM].copy()
        if scene.start.by_euler_angles:
            start["start_euler"] = draw(scene.start.attitude, seed, "start.attitude", first, count)
    block[layout.MOMENTUM : layout.REST] = spin * moments if word == "omega" else spin
    # the spin is nan if a shell has too little energy
    bad = broken(moments) | ~(mass > 0) | np.isnan(spin).any(0) | np.isnan(block[layout.ATTITUDE])
    block[layout.STATUS, bad] = layout.STATUSES["invalid_input"]
    return start


def _turned(scene: Scene, drawn: Mapping[str, Array], turn: Array) -> dict[str, Array]:
    """The drawn parameters of effects, those that are fixed in the body along the members' axes."""
    turned = dict(drawn)
    for label, effect in labelled(scene.effects):
        for field in effect_facts(effect).in_body:
            values = drawn[f"{label}_{field}"]
            into = vectors_into if len(values) == 3 else tensors_into
            turned[f"{label}_{field}"] = into(turn, values)
    return turned


def facts(scene: Scene, block: Array, moments: Array) -> Facts:
    """The Facts that laws of vectors may depend on, of members whose rows a block has."""
    body, effects = physics(scene.effects, block)
    q = tuple(block[layout.ATTITUDE : layout.MOMENTUM])
    zeros = np.zeros(block.shape[1])
    # a bath has a scale of energy and no potential
    potentials = tuple(effect for effect in effects if implements(effect, "energy"))

    def potential(q: Any) -> Array:
        energy: Array = energies(effects, body, tuple(q)) + zeros
        return energy

    return Facts(moments, potential, total_energy_scale(potentials, body) + zeros, q)


def check_starts(scene: Scene) -> None:
    """Raise SceneError if no member has a start, or if an ensemble is too rare to be drawn."""
    if scene.start.attitude == "ensemble":
        _check_ensemble(scene)
        return
    spin = scene.start.which
    is_law = isinstance(getattr(scene.start, spin), Law)
    if is_law and stage(scene, 0, PILOT, True)[0][layout.STATUS].all():
        rule = (
            f"none of the first {PILOT} members has one: its energy, temperature or size cannot be"
        )
        raise SceneError("start", spin, None, rule)


def _check_ensemble(scene: Scene) -> None:
    """Raise SceneError if the attitudes of an ensemble are too rare among uniform ones to be drawn
    by rejection."""
    block, start = staged(scene.with_run(), scene.run.seed, PILOT, False)
    known = facts(scene, block, start["moments"])
    law: Any = scene.start.momentum
    share = law.share(scene.run.seed, 0, PILOT, known)
    u, v, w, _ = uniforms(scene.run.seed, "start.attitude.ensemble", 0, PILOT, 0)
    tried = uniform_attitudes(u, v, w)
    if (np.abs(known.potential(tried)) > known.bound * (1.0 + 1e-9)).any():
        rule = (
            "needs the largest potential energy that an attitude may have: an effect of your own "
            "tells it by energy_scale(self, body) [J]"
        )
        raise SceneError("start", "attitude", "ensemble", rule)
    accepted = float(np.nanmean(share(tried)))
    if not accepted >= 0.01:
        rule = (
            f"of uniform attitudes the ensemble keeps {accepted:.1g}, less than 1 in 100: too "
            "cold to be drawn so; under gravity alone a body with its centre on axis 3 is "
            "exp(-V/kT) by attitude = { pointing = { direction = [0, 0, -1], kappa = m g h/kT } }"
        )
        raise SceneError("start", "attitude", "ensemble", rule)


def ledger(scene: Scene) -> tuple[Flag, ...]:
    """For each effect OFF if its energy tells its work, else ON; () if no works are saved. See
    `rigidmc.engine.program.Program`."""
    if "work" not in scene.run.save:
        return ()
    return tuple(flag(not implements(effect, "energy")) for effect in scene.effects)


def block_rows(scene: Scene) -> int:
    """How many rows a block of a scene has."""
    return layout.places(parameter_count(*scene.effects), len(ledger(scene))).end


def noise(scene: Scene, members: NDArray[np.int64]) -> Noise:
    """What decides the noise of random effects, for members by their indices."""
    streams = [
        stream_of(f"effects.{label}.noise")
        for label, effect in labelled(scene.effects)
        if takes_noise(effect)
    ]
    key, other = key_of(scene.run.seed)
    return Noise(key, other, np.array(streams or [0], np.uint64), members)

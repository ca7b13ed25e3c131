"""Build rows for the kernel from a model: the members at their start."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.formulas import energies
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import NoiseKeys
from rigidmc.engine.machine import allocate_block
from rigidmc.engine.streams import key_of, stream_of
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.mechanics.inertia import (
    quaternions,
    tensors_into,
    vectors_from,
    vectors_into,
    violates_triangle,
)
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.dynamics.methods import Flag, flag, implements
from rigidmc.physics.dynamics.so3 import conjugate, multiply
from rigidmc.physics.effects import label_effects, shared_parameters
from rigidmc.physics.effects.present import memories_of, states_of
from rigidmc.physics.effects.protocol import blank, has_memory, parameter_count, shape, takes_noise
from rigidmc.physics.effects.protocol import facts as effect_facts
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.planning.orbit_start import (
    from_orbit,
    relative_inputs,
    relative_to_orbit,
    with_orbit_rate,
)
from rigidmc.planning.steps import physics
from rigidmc.scene.distributions import Common
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import count_rows, draw, is_shared, is_variable
from rigidmc.scene.sampling import (
    DESIGNS,
    AntitheticPairs,
    DimensionProbe,
    FamilyDesign,
    FixedPoints,
    PointSequence,
    RandomDimension,
    points,
)
from rigidmc.scene.settings import Run
from rigidmc.scene.validation import PILOT
from rigidmc.scene.varied import common_numbers
from rigidmc.scene.vector_distributions import TensorRows
from rigidmc.scene.vector_distributions.protocol import (
    EquilibriumEnsemble,
    MemberFacts,
    VectorDistribution,
)
from rigidmc.scene.vector_distributions.vectors import whole_of

APART = 256  # building this many unused members takes less time than another call
RANGE = 2**14  # most members built at once: 8 MB

Start = dict[str, Array]  # sampled values that members were built from, named as in the result
# sources of the members' draws
Source = int | AntitheticPairs | FamilyDesign | FixedPoints | PointSequence | DimensionProbe


def block_rows(effects: Sequence[Any], has_work: bool) -> int:
    """Return how many rows a block has, excluding rows for monitors."""
    return layout.map_rows(parameter_count(*effects), trailing_count(effects, has_work)).end


def trailing_count(effects: Sequence[Any], has_work: bool) -> int:
    """Return how many numbers follow L: states of effects, saved works and memories."""
    known = blank(effects)
    return len(states_of(known)) + len(memories_of(known)) + (len(effects) if has_work else 0)


def initial_block(
    model: Model,
    sampler: Source,
    first: int,
    count: int,
    has_attitude: bool = True,
    rows: int | None = None,
) -> tuple[Array, Start]:
    """Build members from index `first` on.

    Returns (block, start): the rows for the kernel (rows, count), and the sampled values that the
    members were built from.

    has_attitude : whether the attitude is followed
    rows : of the block, by default those without works and monitors, see `block_rows`
    """
    rows = block_rows(model.effects, False) if rows is None else rows
    block = allocate_block(rows, count)
    # `allocate_block` leaves memory as it is: rows that nobody sets would be nan by chance
    low = 0
    for some in (*rows_to_fill(model.effects), slice(rows, rows)):  # zero the rows between
        block[low : some.start], low = 0.0, some.stop
    return block, fill_initial(block, model, sampler, first, has_attitude)


def members_at_start(model: Model, run: Run, first: int, count: int) -> tuple[Array, Start]:
    """Build members with attitudes, drawn as in a run; see `initial_block`."""
    return initial_block(model, make_sampler(model, run), first, count)


def initial_block_of(
    model: Model, sampler: Source, members: Ints, has_attitude: bool = True, rows: int | None = None
) -> tuple[Array, Start]:
    """Build members by their indices, in any order; see `initial_block`.

    Draws come in ranges of members. Members in a gap between indices are built too, unless the gap
    is long.
    """
    blocks, starts = list[Array](), list[Start]()
    for low, columns, count in member_ranges(members):
        block, start = initial_block(model, sampler, low, count, has_attitude, rows)
        # block[:, columns] would have another memory layout
        blocks.append(np.take(block, columns, axis=1))
        starts.append({name: values[..., columns] for name, values in start.items()})
    start = {name: np.concatenate([part[name] for part in starts], axis=-1) for name in starts[0]}
    return np.concatenate(blocks, axis=1), start


def member_ranges(members: Ints) -> Iterator[tuple[int, Ints, int]]:
    """Yield ranges of members to build, as (first index, columns of the wanted members, count)."""
    apart = np.diff(members)
    cut = (apart < 0) | (apart > APART) | (np.diff(members // RANGE) != 0)
    for part in np.split(members, np.flatnonzero(cut) + 1):
        columns = part - part[0]
        yield int(part[0]), columns, int(columns[-1]) + 1


class InitialMembers(NamedTuple):
    """The first members of a model at their start, from index 0 on, and the sampled values they
    were built from. The block is never changed; only the rows of `rows_to_fill` are set."""

    block: Array
    start: Start

    def part(self, model: Model, first: int, count: int, rows: int) -> tuple[Array, Start]:
        """Return members that are among these; see `initial_block`."""
        block, part = allocate_block(rows, count, np.zeros), slice(first, first + count)
        for some in rows_to_fill(model.effects):
            block[some] = self.block[some, part]
        return block, {name: values[..., part] for name, values in self.start.items()}


def make_pilot(model: Model, sampler: Source, has_attitude: bool, count: int = 0) -> InitialMembers:
    """Build the first members of a model, by default `pilot_size` of them."""
    count = count or pilot_size(model)
    # setting and copying zeros in all rows took 1 of 21 ms for 65,536 members and one step
    block = np.empty((block_rows(model.effects, False), count))
    return InitialMembers(block, fill_initial(block, model, sampler, 0, has_attitude))


def pilot_size(model: Model) -> int:
    """Return how many first members represent the ensemble: all rows if there are arrays."""
    quantities = model.quantities()
    if is_shared(*quantities) and not isinstance(model.start.attitude, str):
        return layout.LANES
    return layout.whole_lanes(max(PILOT, count_rows(*quantities) or 0))


def make_sampler(model: Model, run: Run) -> Source:
    """Return the source of a run's draws: its seed, or the point set that `run.points` names."""
    if run.points == "independent":
        return run.seed
    if run.points == "antithetic":
        return AntitheticPairs(run.seed)
    if run.points in DESIGNS:
        return DESIGNS[run.points](run.seed, uncertain_numbers(model)[1])
    return points(
        run.seed, run.points, random_dimensions(model), run.strata or run.first + run.members
    )


def random_dimensions(model: Model) -> tuple[RandomDimension, ...]:
    """Return the random numbers that a member draws."""
    recorder = DimensionProbe()
    # with the attitude, so that points do not depend on the saved variables
    initial_block(model, recorder, 0, 1)
    return tuple(recorder.dimensions)


def uncertain_numbers(model: Model) -> tuple[list[str], dict[RandomDimension, int]]:
    """Return (names of the uncertain numbers of a model, {dimension: place of its name}).

    A number has the name that a map gives it, such as start.omega.2. All numbers drawn by a
    distribution of a whole vector or of the attitude form one group, named after that vector or
    the attitude. A number in common has the name of the first number that it enters.
    """
    names = {dimension: _name(model, *dimension) for dimension in random_dimensions(model)}
    places = {name: i for i, name in enumerate(dict.fromkeys(names.values()))}
    return list(places), {dimension: places[name] for dimension, name in names.items()}


def _name(model: Model, stream: str, draw: int, word: int) -> str:
    """Return the name of the quantity that number `word` of a draw from a random stream sets."""
    if stream == Common.stream:
        by = common_numbers(model).items()
        has = (name for name, factors in by if any(factors[4 * draw + word : 4 * draw + word + 1]))
        return next(has, "start.attitude")  # only a quaternion has no names
    table, first, *rest = stream.split(".")
    if table == "effects":
        effect = dict(label_effects(model.effects))[first]
        alone = shape(effect, rest[0]) and whole_of(getattr(effect, rest[0])) is None
        return f"{stream}.{4 * draw + word + 1}" if alone else stream
    vector = f"{table}.{first}"
    if first == "attitude":
        angles = model.start.has_euler_angles
        return f"{vector}.{angle_names(model.start.sequence)[word]}" if angles else vector
    if vector == "body.tensor":
        return f"body.{model.body.moments.names_of_draws()[4 * draw + word]}"
    if vector == "body.mass":
        return vector
    value = getattr(getattr(model, table), first)
    return f"{vector}.{4 * draw + word + 1}" if isinstance(value, tuple) else vector


def rows_to_fill(effects: Sequence[Any]) -> tuple[slice, ...]:
    """Return the block rows that `fill_initial` sets; the others stay 0 until the engine starts."""
    end = layout.EFFECTS + parameter_count(*effects)
    return (
        slice(layout.ATTITUDE, layout.EXTRA),
        slice(layout.STATUS, layout.STATUS + 1),
        slice(layout.STEPS, end),
    )


def fill_initial(
    block: Array, model: Model, sampler: Source, first: int, has_attitude: bool
) -> Start:
    """Set the rows of `rows_to_fill` for members from index `first` on, and return the sampled
    values that the members are built from."""
    count = block.shape[1]
    moments, mass, centre, turn = model.body.sample_turned(sampler, first, count)
    parameters = _drawn_parameters(model.effects, sampler, first, count)
    effects = parameters if turn is None else _turned(model.effects, parameters, turn)
    _fill_body_and_effects(block, model.effects, effects, moments, mass, centre)
    relative = relative_to_orbit(model)
    # for members whose attitude is not followed, and for `member_facts` before it is drawn
    attitude = np.array([[1.0], [0.0], [0.0], [0.0]])
    block[layout.ATTITUDE : layout.MOMENTUM] = attitude
    # only distributions of the spin, and attitudes that follow from them, ask for facts
    asks = isinstance(getattr(model.start, model.start.spin_name), VectorDistribution)
    if has_attitude:
        facts = member_facts(model.effects, block, moments) if asks else None
        attitude = model.start.sample_attitude(sampler, first, count, facts)
        if "attitude" in relative:
            attitude = from_orbit(model.effects, effects, attitude)
        block[layout.ATTITUDE : layout.MOMENTUM] = attitude
        if turn is not None and model.start.attitude != "ensemble":
            axes = multiply(tuple(attitude), quaternions(turn))
            block[layout.ATTITUDE : layout.MOMENTUM] = axes
    # the principal frame of an uncertain tensor has the axes of each member
    turned = turn if model.body.frame == "described" else None
    # recomputed: a spin on an energy shell gets what the potential of the drawn attitude leaves
    asked = member_facts(model.effects, block, moments)._replace(turn=turned) if asks else None
    word, drawn = model.start.sample_spin(sampler, first, count, asked)
    in_principal = isinstance(getattr(model.start, word), EquilibriumEnsemble)
    if word in relative:
        drawn = with_orbit_rate(model.effects, effects, attitude, drawn)
    spin = drawn if turn is None or in_principal else vectors_into(turn, drawn)
    start = {"moments": moments, "mass": mass, "centre": centre, f"start_{word}": drawn}
    start |= relative_inputs(model.start, sampler, first, count)
    if turn is not None:
        start["principal_axes"] = np.stack(quaternions(turn))
        start["principal_centre"] = centre
        # results have what the scene says, to the last bit, unless it was drawn in principal axes
        if model.body.frame == "principal":
            start[f"start_{word}"], parameters = spin, effects
        else:
            start["centre"] = vectors_from(turn, centre)
            if in_principal:
                start[f"start_{word}"] = vectors_from(turn, spin)
    if isinstance(model.body.moments, TensorRows):
        start["tensor"] = draw(model.body.moments.rows, sampler, "body.tensor", first, count)
    start |= {name: values if len(values) > 1 else values[0] for name, values in parameters.items()}
    if has_attitude:
        start["start_attitude"] = _attitude_of_result(model, block, attitude, start)
        if model.start.has_euler_angles:
            start["start_euler"] = draw(
                model.start.attitude, sampler, "start.attitude", first, count
            )
    block[layout.MOMENTUM : layout.EXTRA] = spin * moments if word == "omega" else spin
    # the spin is nan if a distribution on an energy shell gets too little energy
    bad = np.isnan(spin).any(0) | np.isnan(block[layout.ATTITUDE])
    if is_variable(model.body.moments, model.body.mass):  # a Body checks plain numbers and rows
        bad |= violates_triangle(moments) | ~(mass > 0)
    block[layout.STATUS, bad] = layout.STATUSES["invalid_input"]
    return start


def _drawn_parameters(
    effects: Sequence[Any], sampler: Source, first: int, count: int
) -> dict[str, Array]:
    """Return the parameters of effects as the scene gives them, {label_field: values (size, n)}."""
    return {
        f"{label}_{field}": draw(
            value if shape(e, field) else (value,),
            sampler,
            f"effects.{label}.{field}",
            first,
            count,
        )
        for label, e in label_effects(effects)
        for field, value in zip(e._fields, e, strict=True)
    }


def _fill_body_and_effects(
    block: Array,
    effects: Sequence[Any],
    drawn: Mapping[str, Array],
    moments: Array,
    mass: Array,
    centre: Array,
) -> None:
    """Set the rows of bodies and effects, and begin as ok; all in the principal axes."""
    # impossible moments (0, inf) give inf or nan here; `fill_initial` flags these members
    with np.errstate(all="ignore"):
        body = MassProperties.of(tuple(moments), tuple(mass * centre))
    for row, values in zip(block[layout.BODY : layout.EFFECTS], body[:BODY_NUMBERS], strict=True):
        row[:] = values
    if drawn:
        end = layout.EFFECTS + parameter_count(*effects)
        acting = dict(drawn)
        for name, sources in shared_parameters(effects).items():
            acting[name] = np.stack([drawn[source] for source in sources]).sum(0)
        block[layout.EFFECTS : end] = np.concatenate(list(acting.values()))
    block[layout.STATUS], block[layout.STEPS] = layout.STATUSES["ok"], 1.0


def _attitude_of_result(model: Model, block: Array, drawn: Any, start: Start) -> Array:
    """Return the attitudes at the start in the axes of the result; drawn : as the scene says."""
    if "principal_axes" not in start or model.body.frame == "principal":
        return block[layout.ATTITUDE : layout.MOMENTUM].copy()
    if model.start.attitude != "ensemble":
        return np.stack(tuple(drawn))
    back = conjugate(tuple(start["principal_axes"]))
    return np.stack(multiply(tuple(drawn), back))


def _turned(effects: Sequence[Any], drawn: Mapping[str, Array], turn: Array) -> dict[str, Array]:
    """Return the drawn parameters of effects, body-fixed ones turned into each member's axes."""
    turned = dict(drawn)
    for label, effect in label_effects(effects):
        for field in effect_facts(effect).in_body:
            values = drawn[f"{label}_{field}"]
            into = vectors_into if len(values) == 3 else tensors_into
            turned[f"{label}_{field}"] = into(turn, values)
    return turned


def member_facts(effects: Sequence[Any], block: Array, moments: Array) -> MemberFacts:
    """Return the MemberFacts that vector distributions may depend on, for members of a block."""
    body, arrays = physics(effects, block)
    q = tuple(block[layout.ATTITUDE : layout.MOMENTUM])
    zeros = np.zeros(block.shape[1])
    # a bath has an energy scale but no potential
    potentials = tuple(effect for effect in arrays if implements(effect, "energy"))

    def potential(q: Any) -> Array:
        energy: Array = energies(arrays, body, tuple(q)) + zeros
        return energy

    return MemberFacts(moments, potential, total_energy_scale(potentials, body) + zeros, q)


def work_flags(effects: Sequence[Any], has_work: bool) -> tuple[Flag, ...]:
    """Return for each effect OFF if its energy gives its work, else ON; () if no works are saved.

    See `rigidmc.engine.program.Program`.
    """
    if not has_work:
        return ()
    return tuple(flag(not implements(effect, "energy")) for effect in effects)


def noise_keys(effects: Sequence[Any], seed: int, members: Ints) -> NoiseKeys:
    """Return the keys of the noise of random effects, then of samples, for members by their
    indices."""
    streams = [
        stream_of(f"effects.{label}.noise")
        for label, effect in label_effects(effects)
        if takes_noise(effect)
    ]
    streams += [
        stream_of(f"effects.{label}.sample")
        for label, effect in label_effects(effects)
        if has_memory(effect)
    ]
    key, other = key_of(seed)
    return NoiseKeys(key, other, np.array(streams or [0], np.uint64), members)

"""The sums of a fit, against explicit sums of analytic functions in NumPy."""

import hashlib
import signal
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench import bits
from rigidmc.engine.kernel.normal_equations import (
    ATTITUDE,
    BIAS,
    DRIFT,
    JACOBIAN,
    LANES,
    MOUNTING,
    OFFSET,
    SCALE,
    SENSOR_ROWS,
    VECTOR,
    Samples,
)
from rigidmc.engine.normal_equations import sum_samples
from rigidmc.studies.fit.problem import LOSSES

SAVES, ROWS, MOVING, RECORDS, SAMPLES = 200, 5, 4, 2, 60
EVERY = 0.05  # polynomials of degree 7 miss (2 EVERY)^8/9000 = 1e-12 of cos 2t
NUISANCES = 11
E = 1e-6  # step of central differences


class Waves:
    """Saves that are cosines of the time, of which all sums follow at any time."""

    def __init__(self, members, seed=1):
        random = np.random.default_rng(seed)
        shape = ROWS, 1 + MOVING, members
        self.phase, self.rate = random.uniform(0, 6, shape), random.uniform(0.5, 2, shape)
        self.saves = np.moveaxis([self.at(i) for i in range(SAVES)], 0, 0)
        self.record = random.integers(0, RECORDS, members)
        self.times = np.sort(random.uniform(5.0, 190.0, (RECORDS, SAMPLES)), axis=1)
        self.turn = Rotation.from_rotvec(random.normal(size=(members, 3)))
        self.scale, self.bias = 0.1 * random.normal(size=(2, members, 3))
        self.offset, self.drift = random.normal(size=members), 1e-3 * random.normal(size=members)
        self.values = random.normal(size=(RECORDS, SAMPLES, 4))
        self.values /= np.linalg.norm(self.values, axis=2, keepdims=True)
        self.weights = random.uniform(0.5, 2.0, (RECORDS, SAMPLES, 3))
        self.weights[0, 3, 1] = 0.0
        self.values[0, 3, 1] = np.nan
        self.chain = random.normal(size=(3, 3, members))
        self.along = random.uniform(-0.5, 0.5, (RECORDS, SAMPLES, 3)) * (self.weights > 0.0)
        self.members = members

    def at(self, place):
        """The values and derivatives (rows, columns, members) at a time in distances of saves."""
        return np.cos(self.rate * (place * EVERY) + self.phase)

    def sensor(self, kind):
        sensor = np.zeros((SENSOR_ROWS, self.members))
        sensor[:9] = self.turn.as_matrix().reshape(-1, 9).T
        sensor[SCALE : SCALE + 3], sensor[BIAS : BIAS + 3] = self.scale.T, self.bias.T
        sensor[OFFSET], sensor[DRIFT] = self.offset, self.drift
        if kind == ATTITUDE:
            sensor[MOUNTING : MOUNTING + 4] = self.turn.inv().as_quat(scalar_first=True).T
        return sensor

    def sums(self, kind=VECTOR, mixed=3, keeps=0, row=1, column=0, **changed):
        """The sums of the kernel, with all nuisances of a vector."""
        parameters = changed.get("parameters", MOVING + NUISANCES)
        columns_of = MOVING + np.arange(NUISANCES)
        shape = parameters * (parameters + 1) // 2 + parameters + 1, self.members
        if keeps:
            shape = SAMPLES * 3 * (2 + parameters), self.members
        values = self.values if kind == ATTITUDE else np.ascontiguousarray(self.values[..., :3])
        sums = np.zeros(shape)
        given = {
            "saves": self.saves.ravel()[row * (1 + MOVING) * self.saves.shape[-1] + column :],
            "times": self.times, "values": values, "weights": self.weights,
            "record": self.record, "sensor": self.sensor(kind), "columns_of": columns_of,
            "chain": self.chain, "along": self.along, "sums": sums,
            "room": np.zeros((JACOBIAN + 4 * parameters + 3) * LANES),
            "pitch": self.saves[0].size, "columns": 1 + MOVING,
            "width": self.saves.shape[-1], "steps": SAVES, "samples": SAMPLES,
            "members": self.members, "kind": kind, "channels": 3,
            "parameters": parameters, "moving": MOVING, "mixed": mixed, "keeps": keeps,
            "is_shaken": 0, "loss": 0,
        }  # fmt: skip
        sum_samples(Samples(**{**given, **changed}))
        return sums

    def motion(self, m, at, row, mixed):
        """Value and derivatives of a member: (rows,), (rows, moving)."""
        values = self.at(at)[row:, :, m]
        slopes = np.array(values[:, 1:])
        slopes[:, :mixed] = slopes[:, :mixed] @ self.chain[:mixed, :mixed, m]
        return values[:, 0], slopes

    def reading(self, m, k, p, mixed):
        """Reading (3,) and derivatives by the motion; p : changes of bias, scale, rotation, offset
        and drift."""
        t = self.times[self.record[m], k]
        at = t + (self.drift[m] + p[10]) * t + self.offset[m] + p[9]
        value, slopes = self.motion(m, at, 1, mixed)
        turn = (Rotation.from_rotvec(p[6:9]) * self.turn[m]).as_matrix()
        gain = 1.0 + self.scale[m] + p[3:6]
        return gain * (turn @ value[:3]) + self.bias[m] + p[:3], gain[:, None] * (turn @ slopes[:3])

    def expected(self, m, mixed=3):
        """The residuals (samples, 3) and derivatives (samples, 3, parameters) of a vector."""
        residuals, slopes = [], []
        for k in range(SAMPLES):
            model, by_motion = self.reading(m, k, np.zeros(NUISANCES), mixed)
            ends = [
                [self.reading(m, k, sign * E * one, mixed)[0] for one in np.eye(NUISANCES)]
                for sign in (1, -1)
            ]
            by_nuisance = (np.array(ends[0]) - ends[1]).T / (2 * E)
            weight = self.weights[self.record[m], k]
            data = np.where(weight > 0.0, self.values[self.record[m], k, :3], 0.0)
            residuals.append(np.where(weight > 0.0, weight * (data - model), 0.0))
            slopes.append(weight[:, None] * np.hstack([by_motion, by_nuisance]))
        return np.array(residuals), np.array(slopes)


def summed(residuals, slopes):
    """J^T J, J^T r and r^T r of residuals."""
    r, j = residuals.ravel(), slopes.reshape(-1, slopes.shape[-1])
    return np.concatenate([(j.T @ j)[np.triu_indices(j.shape[1])], j.T @ r, [r @ r]])


@pytest.mark.parametrize("mixed", [0, 3])
def test_readings_of_a_vector_have_the_sums_of_numpy(mixed):
    waves = Waves(16)
    found = waves.sums(mixed=mixed)
    for m in (0, 5, 15):
        expected = summed(*waves.expected(m, mixed))
        np.testing.assert_allclose(found[:, m], expected, rtol=1e-7, atol=1e-6)


def test_kept_residuals_and_derivatives_have_the_sums():
    waves = Waves(8)
    kept = waves.sums(keeps=1).reshape(SAMPLES, 3, -1, 8)
    for m in range(8):
        residuals, slopes = waves.expected(m)
        np.testing.assert_allclose(kept[:, :, 0, m], residuals, atol=1e-9)
        np.testing.assert_allclose(kept[:, :, 1, m], slopes[:, :, MOVING + 9], atol=1e-7)
        np.testing.assert_allclose(kept[:, :, 2:, m], slopes, atol=1e-7)
        sums = waves.sums()[:, m]
        np.testing.assert_allclose(summed(kept[:, :, 0, m], kept[:, :, 2:, m]), sums, rtol=1e-12)


def test_samples_are_made_white_before_they_are_summed():
    waves = Waves(8)
    kept = waves.sums(keeps=1).reshape(SAMPLES, 3, -1, 8)
    found = waves.sums(is_shaken=1)
    for m in range(8):
        h = waves.along[waves.record[m]]
        turn = np.eye(3) - h[:, :, None] * h[:, None]
        white = np.einsum("kcd,kdi->kci", turn, kept[..., m])
        np.testing.assert_allclose(found[:, m], summed(white[..., 0], white[..., 2:]), rtol=1e-10)


# rho and rho' of scipy's documentation
RHO = {
    "huber": (
        lambda z: np.where(z <= 1, z, 2 * np.sqrt(z) - 1), lambda z: np.maximum(z, 1) ** -0.5
    ),
    "cauchy": (np.log1p, lambda z: 1 / (1 + z)),
}  # fmt: skip


@pytest.mark.parametrize("loss", RHO)
def test_outliers_are_weighed_as_the_loss_asks(loss):
    waves, (number, scale), (rho, slope) = Waves(8), LOSSES[loss], RHO[loss]
    kept = waves.sums(keeps=1).reshape(SAMPLES, 3, -1, 8)
    found = waves.sums(loss=number)
    for m in range(8):
        z = (kept[:, :, 0, m] / scale) ** 2
        assert (z > 1.0).any() and (z < 1.0).any()
        some = np.sqrt(slope(z))[..., None] * kept[..., m]
        expected = summed(some[..., 0], some[..., 2:])
        expected[-1] = scale**2 * rho(z).sum()
        np.testing.assert_allclose(found[:, m], expected, rtol=1e-10, atol=1e-10)


def digest():
    """The bits of the sums with jitter and a loss, and of attitudes."""
    rates = Waves(16).sums(is_shaken=1, loss=LOSSES["cauchy"][0])
    columns_of = np.array([-1] * 6 + list(range(MOVING, MOVING + 5)))
    turns = Waves(16).sums(ATTITUDE, columns_of=columns_of, parameters=MOVING + 5)
    return hashlib.sha256(rates.tobytes() + turns.tobytes()).hexdigest()


# of other libraries, NumPy computes the waves with other bits
@pytest.mark.slow  # each compiles for 10 s
@pytest.mark.parametrize(
    "processor", [name for name in bits.PROCESSORS if "libraries" not in name][1:]
)
def test_sums_have_the_same_bits_on_any_processor(processor, tmp_path):
    """With vectors of 128, 256 and 512 bits, and without fused multiply-adds."""
    code = "from tests.engine.kernel.test_normal_equations import digest; print(digest())"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True,
        env={**bits.environment(processor), "RIGIDMC_CACHE_DIR": str(tmp_path)},
    )  # fmt: skip
    if done.returncode == -signal.SIGILL:
        pytest.skip(f"this CPU lacks instructions of {processor}")
    assert done.stdout.split() == [digest()], done.stderr


def test_attitudes_are_compared_by_the_rotation_between_them():
    waves = Waves(8)
    first = Rotation.from_quat([0.5, 0.5, 0.5, 0.5], scalar_first=True)
    axis = 0.3 * EVERY * np.array([0.0, 0.6, 0.8])  # turned by between two saves
    waves.saves[:, 1:5, 0] = (
        first * Rotation.from_rotvec(np.arange(SAVES)[:, None] * axis)
    ).as_quat(scalar_first=True)[:, :, None]
    waves.weights[0, 3] = 0.0
    columns_of = np.array([-1] * 6 + list(range(MOVING, MOVING + 5)))
    kept = waves.sums(ATTITUDE, keeps=1, columns_of=columns_of, parameters=MOVING + 5)
    kept = kept.reshape(SAMPLES, 3, -1, 8)
    for m in range(8):
        which = waves.record[m]
        t, weight = waves.times[which], waves.weights[which]

        def left(p, m=m, t=t, which=which):
            """Twice the vector of the rotation from model to data, in the axes of the sensor."""
            at = t + (waves.drift[m] + p[4]) * t + waves.offset[m] + p[3]
            sensor = Rotation.from_rotvec(p[:3]) * waves.turn[m]
            model = first * Rotation.from_rotvec(at[:, None] * axis) * sensor.inv()
            data = Rotation.from_quat(np.nan_to_num(waves.values[which]), scalar_first=True)
            turn = (model.inv() * data).as_quat(scalar_first=True)
            return 2.0 * np.where(turn[:, :1] < 0.0, -1.0, 1.0) * turn[:, 1:]

        some = weight[:, 0] > 0.0
        expected = (weight * left(np.zeros(5)))[some]
        np.testing.assert_allclose(kept[some, :, 0, m], expected, atol=1e-9)
        assert not kept[~some, :, :, m].any()
        # derivatives at the data, where they are those of the rotation vector
        near = waves.turn[m].as_matrix()
        slope = weight[5][:, None] * np.hstack([
            near @ waves.motion(m, t[5] * (1 + waves.drift[m]) + waves.offset[m], 1, 3)[1][:3],
            -np.eye(3), (near @ axis)[:, None], (near @ axis * t[5])[:, None],
        ])  # fmt: skip
        np.testing.assert_allclose(kept[5, :, 2:, m], slope, atol=1e-9)


@pytest.mark.parametrize("more", [{}, {"is_shaken": 1, "loss": 2}])
@pytest.mark.parametrize("members", [8, 16, 40])
def test_sums_of_a_member_do_not_depend_on_those_beside_it(members, more):
    large = Waves(members)
    alone = Waves(members)
    some = np.arange(members)[::-1][:LANES]
    for name in ("saves", "chain", "phase", "rate"):
        setattr(alone, name, np.ascontiguousarray(getattr(large, name)[..., some]))
    for name in ("record", "scale", "bias", "offset", "drift", "turn"):
        setattr(alone, name, getattr(large, name)[some])
    alone.members = LANES
    np.testing.assert_array_equal(alone.sums(**more), large.sums(**more)[:, some])


def test_members_may_lie_anywhere_in_the_saves():
    waves, wide = Waves(8), Waves(8)
    wide.saves = np.full((*waves.saves.shape[:-1], 24), np.nan)
    wide.saves[..., 16:] = waves.saves
    np.testing.assert_array_equal(wide.sums(column=16), waves.sums())


def test_a_missing_value_has_no_effect():
    waves, other = Waves(8), Waves(8)
    other.values[0, 3, 1] = 1e6
    np.testing.assert_array_equal(waves.sums(), other.sums())
    other.weights[0, 3, 1] = 1.0
    assert not np.array_equal(waves.sums(), other.sums())


def test_times_beyond_the_saves_take_the_outermost_polynomial():
    waves = Waves(8)
    waves.drift[:] = 0.0
    waves.offset[:] = 0.0
    waves.times = np.sort(np.concatenate([
        np.full((RECORDS, 1), -0.5), np.full((RECORDS, 1), SAVES - 0.5), waves.times[:, 2:]
    ], axis=1), axis=1)  # fmt: skip
    kept = waves.sums(keeps=1).reshape(SAMPLES, 3, -1, 8)
    for m in range(8):
        residuals, _ = waves.expected(m)
        np.testing.assert_allclose(kept[:, :, 0, m], residuals, atol=2e-8)
    waves.times[:, -1] = 1e9
    assert np.isfinite(waves.sums()).all()  # far beyond, it reads its saves only

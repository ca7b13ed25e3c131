"""Normal equations of a fit, summed over the samples of a record for each member.

A member saves an observable and its derivatives at equal distances. A sample lies between saves:
the model there is the polynomial of degree 7 through the eight nearest saves. With the residual
r = w (data - model) of a channel, its weight w = 1/sigma, and the derivatives J of w model by the
parameters, the kernel sums over all samples::

    J^T J (its upper triangle, row by row),   J^T r,   r^T r

So members leave a few numbers each, and not their saves and derivatives. The sums of a member take
its samples in order, whatever members lie beside it.

A sensor reads a vector v of body axes as z = (1 + s) R v + b, with scale errors s, alignment R and
bias b, at the time (1 + drift) t + offset of its own clock's time t. A rotation d of the sensor,
R -> exp([d]x) R, changes z by (1 + s) (d x R v). The attitude of its axes is that of the body
times the inverse of R.
"""

import math
import sys
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.memory import memory
from rigidmc.physics.dynamics.functions import logarithm_of_one_and
from rigidmc.physics.dynamics.so3 import conjugate, multiply

LANES = 8  # members side by side: a cache line holds a save of 8 members
NODES = 8  # saves of a polynomial: its error, (omega h)^8/9000 at the middle, is below that of rk4
# 1/((-1)^(7 - i) i! (7 - i)!): the divisors of Lagrange's polynomials of the nodes 0, ..., 7
DIVISORS = (-1 / 5040, 1 / 720, -1 / 240, 1 / 144, -1 / 144, 1 / 240, -1 / 720, 1 / 5040)
VECTOR, ATTITUDE = 1, 2  # kinds of a stream; 0 for numbers that no sensor turns
# Rows of `sensor`: R row by row, scale errors, biases, offset [saves], drift of the clock
SCALE, BIAS, OFFSET, DRIFT, SENSOR_ROWS = 9, 12, 15, 16, 17
MOUNTING = SCALE  # of an attitude, in place of scale and bias: the quaternion of the inverse of R
# Nuisances, in the order of `columns_of`: bias, scale and rotation of each axis, offset, drift
OF_SCALE, OF_ROTATION, OF_OFFSET, OF_DRIFT, NUISANCES = 3, 6, 9, 10, 11
# Rows of `room`: weights of the nodes, of their slopes, the first node, then for each channel the
# model, its rate, the residual; the cost of a channel; and the derivatives
WEIGHTS, SLOPES, FIRST, MODEL, RATE, RESIDUAL, COST, JACOBIAN = 0, 8, 16, 17, 21, 25, 29, 30
# Losses, and residuals from which they differ from squares: normal errors then lose 5 % of their
# information. Source: Holland & Welsch, Commun. Stat. A 6 (1977) 813, table 1.
HUBER, HUBER_SCALE, CAUCHY, CAUCHY_SCALE = 1, 1.345, 2, 2.385


class Samples(NamedTuple):
    """The samples of one stream of measurements, the saves of the members, and their sums.

    saves : from the first value of the observable on, [s*pitch + (r*columns + d)*width + m], as in
        `rigidmc.engine.kernel.arguments.SaveTarget`, with `steps` saves
    times : of the samples by their own clock, in distances of saves (records, samples)
    values, weights : (records, samples, channels); the weight of a missing value is 0
    record : of each member
    sensor : (SENSOR_ROWS, members)
    columns_of : column of the derivative by each nuisance, -1 for a known one
    chain : (mixed, mixed, members), derivatives of the first parameters of the motion by the
        coordinates of the fit, which take their place
    along : of each weighted channel, h of `whiten` (records, samples, channels); see `is_shaken`
    sums : (pairs + parameters + 1, members), pairs = parameters (parameters + 1)/2; or, if `keeps`
        is 1, residuals, rates and derivatives without a loss (samples, channels, 2 + parameters,
        members)
    room : working memory of (JACOBIAN + 4 parameters + mixed) LANES numbers
    kind, channels : of the stream: 0, VECTOR or ATTITUDE
    parameters, moving : all parameters, and those that change the motion, which come first
    loss : 0 for squares, HUBER or CAUCHY
    """

    saves: Any
    times: Any
    values: Any
    weights: Any
    record: Any
    sensor: Any
    columns_of: Any
    chain: Any
    along: Any
    sums: Any
    room: Any
    pitch: int
    columns: int
    width: int
    steps: int
    samples: int
    members: int
    kind: int
    channels: int
    parameters: int
    moving: int
    mixed: int
    keeps: int
    is_shaken: int
    loss: int


RECORD = np.dtype([(name, np.intp) for name in Samples._fields])


def add_samples(tree, numbers, frame):
    """Add the samples of a stream to the sums of all members."""
    for low in range(0, frame.members, LANES):
        for k in range(frame.samples):
            find_saves(frame, low, k)
            room = memory(frame.room, 1.0)
            for i in range(JACOBIAN * LANES, (JACOBIAN + 4 * frame.parameters) * LANES):
                room[i] = 0.0
            interpolate(frame, low)
            change_parameters(frame, low)
            read_sensor(frame, low, k)
            if frame.is_shaken != 0:
                whiten(frame, low, k)
            for c in range(frame.channels):
                if frame.keeps != 0:
                    keep_sample(frame, low, k * frame.channels + c, c)
                else:
                    lose(frame, low, c)
                    add_sample(frame, low, c)
    return 0


def find_saves(frame, low, k):
    """Set the first save of the polynomial of sample k, and the weights of its nodes."""
    times, sensor = memory(frame.times, 1.0), memory(frame.sensor, 1.0)
    room, record = memory(frame.room, 1.0), memory(frame.record, 1)
    for lane in range(LANES):
        m = low + lane
        drift, offset = sensor[DRIFT * frame.members + m], sensor[OFFSET * frame.members + m]
        at = times[record[m] * frame.samples + k]
        at = at + (drift * at + offset)
        last = (frame.steps - NODES) * 1.0
        # A clock beyond the saves takes the outermost polynomial; nan compares False.
        begin = at - 3.0 if at > 3.0 else 0.0
        place = int(begin if begin < last else last)
        room[FIRST * LANES + lane] = place
        x = at - place
        for i in range(NODES):
            weight, slope = 1.0, 0.0
            for j in range(NODES):
                if j != i:
                    slope = slope * (x - j) + weight
                    weight = weight * (x - j)
            room[(WEIGHTS + i) * LANES + lane] = weight * DIVISORS[i]
            room[(SLOPES + i) * LANES + lane] = slope * DIVISORS[i]


def interpolate(frame, low):
    """Set the model, its rate and its derivatives at a sample."""
    for c in range(frame.channels + (frame.kind == ATTITUDE)):
        # of an attitude, the three components of a rotation vector have derivatives
        derivatives = frame.moving if c < frame.channels else 0
        for d in range(1 + derivatives):
            target = MODEL + c if d == 0 else JACOBIAN + c * frame.parameters + d - 1
            combine(frame, low, WEIGHTS, c * frame.columns + d, target)
        combine(frame, low, SLOPES, c * frame.columns, RATE + c)


def combine(frame, low, weights, value, target):
    """Set a row to the sum of a value of all nodes by their weights."""
    saves, room = memory(frame.saves, 1.0), memory(frame.room, 1.0)
    for lane in range(LANES):
        room[target * LANES + lane] = 0.0
    for i in range(NODES):
        for lane in range(LANES):
            place = (int(room[FIRST * LANES + lane]) + i) * frame.pitch
            save = saves[place + value * frame.width + low + lane]
            room[target * LANES + lane] += room[(weights + i) * LANES + lane] * save


def change_parameters(frame, low):
    """Replace the derivatives by the first parameters of the motion by derivatives by coordinates.

    After the sums it would be too late: the derivatives by two moments cancel in all digits where a
    second moment is tiny beside the others.
    """
    room, chain, n = memory(frame.room, 1.0), memory(frame.chain, 1.0), frame.mixed
    for c in range(frame.channels):
        row, other = JACOBIAN + c * frame.parameters, JACOBIAN + 4 * frame.parameters
        for i in range(n):
            for lane in range(LANES):
                total = 0.0
                for j in range(n):
                    factor = chain[(j * n + i) * frame.members + low + lane]
                    total += room[(row + j) * LANES + lane] * factor
                room[(other + i) * LANES + lane] = total
        for i in range(n * LANES):
            room[row * LANES + i] = room[other * LANES + i]


def read_sensor(frame, low, k):
    """Set the residuals, data less reading, with the rates and the derivatives of the readings."""
    if frame.kind == ATTITUDE:
        compare_attitudes(frame, low, k)
    if frame.kind != 0:
        sensor, room, members = memory(frame.sensor, 1.0), memory(frame.room, 1.0), frame.members
        for lane in range(LANES):
            if frame.kind == VECTOR:
                turn(sensor, members, room, low, lane, MODEL, 1)
            turn(sensor, members, room, low, lane, RATE, 1)
            for d in range(frame.moving):
                turn(sensor, members, room, low, lane, JACOBIAN + d, frame.parameters)
    for c in range(frame.channels):
        read_channel(frame, low, k, c)


def turn(sensor, members, room, low, lane, row, apart):
    """Turn the vector in three rows, `apart` from each other, into the axes of the sensor."""
    m = low + lane
    x, y = room[row * LANES + lane], room[(row + apart) * LANES + lane]
    z = room[(row + 2 * apart) * LANES + lane]
    for c in range(3):
        first = sensor[3 * c * members + m] * x + sensor[(3 * c + 1) * members + m] * y
        room[(row + c * apart) * LANES + lane] = first + sensor[(3 * c + 2) * members + m] * z


def read_channel(frame, low, k, c):
    """Set the residual of channel c and its derivatives by the nuisances, scale all others, and
    multiply all by the weight; `room` has the vector in the axes of the sensor, and its rate."""
    sensor, room, members = memory(frame.sensor, 1.0), memory(frame.room, 1.0), frame.members
    times, record = memory(frame.times, 1.0), memory(frame.record, 1)
    weights = memory(frame.weights, 1.0)
    values, columns_of = memory(frame.values, 1.0), memory(frame.columns_of, 1)
    row, after, before = JACOBIAN + c * frame.parameters, (c + 1) % 3, (c + 2) % 3
    for lane in range(LANES):
        m, gain = low + lane, 1.0
        sample = record[m] * frame.samples + k
        if frame.kind == ATTITUDE:
            put(room, row, columns_of[OF_ROTATION + c], lane, -1.0)
        else:
            gain, u = 1.0 + sensor[(SCALE + c) * members + m], room[(MODEL + c) * LANES + lane]
            reading = gain * u + sensor[(BIAS + c) * members + m]
            data = values[sample * frame.channels + c]
            room[(RESIDUAL + c) * LANES + lane] = data - reading
            put(room, row, columns_of[c], lane, 1.0)
            put(room, row, columns_of[OF_SCALE + c], lane, u)
        if frame.kind == VECTOR:  # component c of d x u, by d_(c+1) and d_(c+2)
            u_before = room[(MODEL + before) * LANES + lane]
            put(room, row, columns_of[OF_ROTATION + after], lane, gain * u_before)
            u_after = room[(MODEL + after) * LANES + lane]
            put(room, row, columns_of[OF_ROTATION + before], lane, -gain * u_after)
        for d in range(frame.moving):
            room[(row + d) * LANES + lane] *= gain
        rate = gain * room[(RATE + c) * LANES + lane]
        put(room, row, columns_of[OF_OFFSET], lane, rate)
        put(room, row, columns_of[OF_DRIFT], lane, rate * times[sample])
        weight = weights[sample * frame.channels + c]
        room[(RATE + c) * LANES + lane] = weight * rate
        left = room[(RESIDUAL + c) * LANES + lane]
        # A missing value is nan, and nan times 0 is nan.
        room[(RESIDUAL + c) * LANES + lane] = weight * left if weight > 0.0 else 0.0
        for d in range(frame.parameters):
            room[(row + d) * LANES + lane] *= weight


def put(room, row, column, lane, value):
    """Set a derivative, unless its parameter is known."""
    if column >= 0:
        room[(row + column) * LANES + lane] = value


def compare_attitudes(frame, low, k):
    """Set data less model of an attitude: 2 vec(s* d), the rotation from the model s = q p of a
    sensor to the data d in its axes, and the rate of the model. p is the inverse of R.

    To first order in the rotation, it changes by minus the derivatives of the model.
    """
    room, values = memory(frame.room, 1.0), memory(frame.values, 1.0)
    sensor, record = memory(frame.sensor, 1.0), memory(frame.record, 1)
    for lane in range(LANES):
        m = low + lane
        sample = record[m] * frame.samples + k
        q, rate = four(room, MODEL * LANES + lane, LANES), four(room, RATE * LANES + lane, LANES)
        at = multiply(q, four(sensor, MOUNTING * frame.members + m, frame.members))
        left = multiply(conjugate(at), four(values, 4 * sample, 1))
        spin = multiply(conjugate(q), rate)
        # q and -q are one attitude; and the polynomial leaves the unit sphere by its error
        sign = 2.0 if left[0] >= 0.0 else -2.0
        for c in range(3):
            room[(RESIDUAL + c) * LANES + lane] = sign * (left[1], left[2], left[3])[c]
            room[(RATE + c) * LANES + lane] = 2.0 * (spin[1], spin[2], spin[3])[c]


def four(numbers, at, apart):
    """Return four numbers from place `at` on."""
    return numbers[at], numbers[at + apart], numbers[at + 2 * apart], numbers[at + 3 * apart]


def whiten(frame, low, k):
    """Make the channels y of a sample, whose errors an error of its time correlates, white:
    y - h (h . y), in the residuals and in each derivative."""
    room, along = memory(frame.room, 1.0), memory(frame.along, 1.0)
    record = memory(frame.record, 1)
    for d in range(1 + frame.parameters):
        row = RESIDUAL if d == 0 else JACOBIAN + d - 1
        apart = 1 if d == 0 else frame.parameters
        for lane in range(LANES):
            first, total = (record[low + lane] * frame.samples + k) * frame.channels, 0.0
            for c in range(frame.channels):
                total += along[first + c] * room[(row + c * apart) * LANES + lane]
            for c in range(frame.channels):
                room[(row + c * apart) * LANES + lane] -= along[first + c] * total


def lose(frame, low, c):
    """Set the cost of channel c of a sample, scale^2 rho(z) with z = (r/scale)^2, and multiply
    residual and derivatives by the root of rho'(z)."""
    room, row = memory(frame.room, 1.0), JACOBIAN + c * frame.parameters
    for lane in range(LANES):
        left = room[(RESIDUAL + c) * LANES + lane]
        cost, slope = left * left, 1.0
        if frame.loss == HUBER and cost > HUBER_SCALE * HUBER_SCALE:
            slope = HUBER_SCALE / math.sqrt(cost)
            cost = HUBER_SCALE * (2.0 * math.sqrt(cost) - HUBER_SCALE)
        if frame.loss == CAUCHY:
            z = cost / (CAUCHY_SCALE * CAUCHY_SCALE)
            slope = 1.0 / (1.0 + z)
            cost = CAUCHY_SCALE * CAUCHY_SCALE * logarithm_of_one_and(z)
        room[COST * LANES + lane] = cost
        root = math.sqrt(slope)
        room[(RESIDUAL + c) * LANES + lane] = root * left
        for d in range(frame.parameters):
            room[(row + d) * LANES + lane] *= root


def add_sample(frame, low, c):
    """Add channel c of a sample to the sums."""
    room, sums = memory(frame.room, 1.0), memory(frame.sums, 1.0)
    p, row, place = frame.parameters, JACOBIAN + c * frame.parameters, low
    residual = (RESIDUAL + c) * LANES
    for i in range(p):
        for j in range(i, p):
            for lane in range(LANES):
                first = room[(row + i) * LANES + lane]
                sums[place + lane] += first * room[(row + j) * LANES + lane]
            place += frame.members
    for i in range(p):
        for lane in range(LANES):
            sums[place + lane] += room[(row + i) * LANES + lane] * room[residual + lane]
        place += frame.members
    for lane in range(LANES):
        sums[place + lane] += room[COST * LANES + lane]


def keep_sample(frame, low, number, c):
    """Write the residual, the rate and the derivatives of channel c of a sample."""
    room, sums = memory(frame.room, 1.0), memory(frame.sums, 1.0)
    p, row = frame.parameters, JACOBIAN + c * frame.parameters
    for i in range(2 + p):
        source = RESIDUAL + c if i == 0 else RATE + c if i == 1 else row + i - 2
        for lane in range(LANES):
            at = (number * (2 + p) + i) * frame.members + low + lane
            sums[at] = room[source * LANES + lane]


inline_all(sys.modules[__name__])

"""A rigid body in any axes: Euler's equations with the full tensor, by scipy's DOP853.

    I dw/dt = (I w) x w + tau,   dA/dt = A hat(w + slip)

Vectors of the body, its tensor and its attitude are in the axes in which the body is described.
Nothing of the package.
"""

import math

import numpy as np
from scipy.integrate import simpson, solve_ivp
from scipy.optimize import brentq, minimize_scalar

UP = np.array([0.0, 0.0, 1.0])
NOTHING = np.zeros(3)


class Properties:
    """What a body is: its tensor (3, 3) about the fixed point, mass and centre of mass."""

    def __init__(self, tensor, mass=1.0, centre=(0.0, 0.0, 0.0)):
        self.tensor, self.mass, self.centre = np.array(tensor, float), mass, np.array(centre, float)
        self.inverse = np.linalg.inv(self.tensor)


def matrices(q):
    """A (3, 3, ...) of quaternions (4, ...), from body to space components."""
    w, x, y, z = q / np.sqrt((q * q).sum(0))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def symmetric(six):
    """The tensor with the elements xx, yy, zz, yz, zx, xy."""
    xx, yy, zz, yz, zx, xy = six
    return np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])


def anomaly(mu, a, e, m0, t):
    """(distance, true anomaly) on a Kepler orbit; Newton's method."""
    m = math.sqrt(mu / a**3) * t + m0
    big = m + e * math.sin(m)
    for _ in range(60):
        big -= (big - e * math.sin(big) - m) / (1 - e * math.cos(big))
    half = math.atan2(math.sqrt(1 + e) * math.sin(big / 2), math.sqrt(1 - e) * math.cos(big / 2))
    return a * (1 - e * math.cos(big)), 2 * half


# Effects: functions of (body, t, A, w) that return torques [N m], and of (body, A) for energies.


def gravity(g):
    def torque(body, t, a, w):
        return np.cross(body.mass * body.centre, a.T @ (-g * UP))

    return torque, lambda body, a: body.mass * g * (UP @ a @ body.centre)


def gravity_gradient(mu, distance, eccentricity=0.0, at=0.0):
    def torque(body, t, a, w):
        r, nu = anomaly(mu, distance, eccentricity, at, t)
        u = a.T @ np.array([math.cos(nu), math.sin(nu), 0.0])
        return 3.0 * mu / r**3 * np.cross(u, body.tensor @ u)

    return torque, None


def spring(stiffness, at, to, length=0.0):
    at, to = np.array(at), np.array(to)

    def torque(body, t, a, w):
        arm = a @ at - to
        force = -stiffness * (1.0 - length / np.linalg.norm(arm)) * arm
        return np.cross(at, a.T @ force)

    return torque, lambda body, a: 0.5 * stiffness * (np.linalg.norm(a @ at - to) - length) ** 2


def uniform_field(dipole, field):
    dipole, field = np.array(dipole), np.array(field)
    return (
        lambda body, t, a, w: np.cross(dipole, a.T @ field),
        lambda body, a: -(dipole @ a.T @ field),
    )


def rotating_field(dipole, field, rate):
    x, y, z = field

    def torque(body, t, a, w):
        c, s = math.cos(rate * t), math.sin(rate * t)
        return np.cross(np.array(dipole), a.T @ np.array([c * x - s * y, s * x + c * y, z]))

    return torque, None


def potential(linear, quadratic):
    linear, q = np.array(linear), symmetric(quadratic)

    def torque(body, t, a, w):
        u = a.T @ UP
        return np.cross(u, linear + q @ u)

    def energy(body, a):
        u = a.T @ UP
        return linear @ u + 0.5 * u @ q @ u

    return torque, energy


def moving_pivot(swing, frequency, phase=0.0):
    def torque(body, t, a, w):
        push = frequency**2 * math.cos(frequency * t + phase) * np.array(swing)
        return np.cross(body.mass * body.centre, a.T @ push)

    return torque, None


def body_torque(size):
    return lambda body, t, a, w: np.array(size), None


def space_torque(size):
    return lambda body, t, a, w: a.T @ np.array(size), None


def periodic_torque(size, frequency, phase=0.0):
    return lambda body, t, a, w: np.array(size) * math.cos(frequency * t + phase), None


def rotor(momentum, motor=(0.0, 0.0, 0.0)):
    h, m = np.array(momentum), np.array(motor)
    return lambda body, t, a, w: np.cross(h + m * t, w) - m, None


def viscous_damping(rate):
    return lambda body, t, a, w: -rate * (body.tensor @ w), None


def matrix_damping(matrix):
    return lambda body, t, a, w: -symmetric(matrix) @ w, None


def quadratic_drag(drag):
    return lambda body, t, a, w: -drag * np.linalg.norm(w) * w, None


def dry_friction(friction, rest):
    return lambda body, t, a, w: -friction * w / math.sqrt(w @ w + rest * rest), None


def energy_dissipation(loss, wheel=NOTHING, motor=NOTHING):
    def torque(body, t, a, w):
        g = body.tensor @ w + wheel + np.multiply(motor, t)
        return loss * np.cross(g, np.cross(g, w)) / np.linalg.norm(g)

    return torque, None


def internal_dissipation(loss, wheel=NOTHING, motor=NOTHING):
    def slip(body, t, a, w):
        g = body.tensor @ w + wheel + np.multiply(motor, t)
        return loss * np.cross(g, w) / np.linalg.norm(g)

    def torque(body, t, a, w):
        g = body.tensor @ w + wheel + np.multiply(motor, t)
        return np.cross(g, slip(body, t, a, w))

    torque.slip = slip
    return torque, None


class Motion:
    """The motion of a body from its start to `end`; `effects` from the functions above."""

    def __init__(self, body, effects, omega, attitude, end, points=4001):
        self.body, self.effects = body, effects
        torques = [torque for torque, _ in effects]
        slips = [torque.slip for torque in torques if hasattr(torque, "slip")]

        def rates(t, y):
            q, w, a = y[:4], y[4:7], matrices(y[:4])
            parts = [torque(body, t, a, w) for torque in torques]
            dw = body.inverse @ (np.cross(body.tensor @ w, w) + sum(parts, NOTHING))
            turn = w + sum((slip(body, t, a, w) for slip in slips), NOTHING)
            dq = 0.5 * np.array([-q[1:] @ turn, *(q[0] * turn + np.cross(q[1:], turn))])
            return np.concatenate([dq, dw, [part @ w for part in parts]])

        attitude = np.array(attitude, float) / np.linalg.norm(attitude)
        start = np.concatenate([attitude, omega, np.zeros(len(torques))])
        # steps so short that the dense output, of order 7, is as good as the steps
        self.solution = solve_ivp(
            rates, (0.0, end), start, "DOP853", rtol=1e-12, atol=1e-14, max_step=0.025,
            dense_output=True,
        ).sol  # fmt: skip
        self.times = np.linspace(0.0, end, points)
        self.states = self.solution(self.times)

    def omega(self, y):
        return y[4:7]

    def momentum(self, y):
        return self.body.tensor @ y[4:7]

    def attitude(self, y):
        return y[:4] / np.sqrt((y[:4] ** 2).sum(0))

    def work(self, y):
        return y[7:]

    def energy(self, y):
        w, a = y[4:7], np.moveaxis(matrices(y[:4]), -1, 0)
        known = [energy for _, energy in self.effects if energy]
        potential = [sum(energy(self.body, one) for energy in known) for one in a]
        return 0.5 * (w * (self.body.tensor @ w)).sum(0) + np.array(potential)

    def direction(self, about, t, y):
        """Unit vectors (3, n) along a direction in space, in the body; `about` as in a scene, or
        the function of t that gives it."""
        a = matrices(y[:4])
        if about == "momentum":
            d = self.momentum(y)
        elif callable(about):
            d = np.einsum("ijn,in->jn", a, np.array([about(x) for x in t]).T)
        else:
            d = np.einsum("ijn,i->jn", a, UP if about == "vertical" else np.array(about, float))
        return d / np.sqrt((d * d).sum(0))

    def angle(self, axis, about="vertical"):
        """The angle between a vector of the body and a direction in space, of (t, y)."""
        u = np.array(axis, float) / np.linalg.norm(axis)

        def found(t, y):
            d = self.direction(about, t, y)
            return np.arctan2(np.linalg.norm(np.cross(u, d.T), axis=1), u @ d)

        return found

    def extremes(self, function):
        """(smallest, largest) of a function of (t, y), to the accuracy of a parabola's ends."""
        values, found = function(self.times, self.states), []
        for sign in (1.0, -1.0):
            k = int(np.argmin(sign * values))
            low, high = self.times[max(k - 1, 0)], self.times[min(k + 1, len(values) - 1)]

            def one(t, sign=sign):
                return sign * function(np.array([t]), self.solution(np.array([t])))[0]

            best = minimize_scalar(one, bounds=(low, high), options={"xatol": 1e-9}).fun
            found.append(sign * min(best, sign * values[k]))
        return tuple(found)

    def mean(self, values):
        """The mean over time of values (..., n) at `times`."""
        return simpson(values, x=self.times) / self.times[-1]

    def crossings(self, function):
        """Times at which a function of (t, y) passes through 0."""
        values = function(self.times, self.states)
        places = np.flatnonzero(np.sign(values[1:]) * np.sign(values[:-1]) < 0)

        def one(t):
            return function(np.array([t]), self.solution(np.array([t])))[0]

        return [brentq(one, *self.times[k : k + 2], xtol=1e-13) for k in places]

    def passages(self, axis, angle, about="vertical"):
        """Times at which an axis leaves a cone; 0 for a start beyond it."""
        beyond = self.angle(axis, about)
        at = np.array([0.0]), self.states[:, :1]
        outside = bool(beyond(*at)[0] >= angle)
        times = self.crossings(lambda t, y: np.cos(angle) - np.cos(beyond(t, y)))
        # crossings lead out and in by turns
        return [0.0, *times[1::2]] if outside else times[0::2]

    def flips(self, axis, within):
        """Times at which L . axis changes its sign, each after L came within an angle of +-axis."""
        e = np.array(axis, float)
        size = np.sqrt((self.momentum(self.states) ** 2).sum(0))
        near = np.abs(e @ self.momentum(self.states)) > math.cos(within) * size
        found = []
        for at in self.crossings(lambda t, y: e @ self.momentum(y)):
            since = found[-1] if found else -1.0
            if near[(self.times > since) & (self.times < at)].any():
                found.append(at)
        return found

    def turned(self):
        """The angle by which axis 3 has turned about the vertical."""
        a = matrices(self.states[:4])
        phi = np.unwrap(np.arctan2(a[1, 2], a[0, 2]))
        return phi[-1] - phi[0]

    def orbit_angles(self, y, anomalies, axes, signs):
        """Roll, pitch and yaw of these axes of the body in the frame of the orbit: along the track,
        opposite to the normal, to the centre."""
        c, s = np.cos(anomalies), np.sin(anomalies)
        zero, one = np.zeros_like(c), np.ones_like(c)
        frame = np.array([[-s, c, zero], [zero, zero, -one], [-c, -s, zero]])
        body = matrices(y[:4])[:, [abs(i) for i in axes]] * np.reshape(signs, (1, 3, 1))
        m = np.einsum("jkn,kin->ijn", frame, body)
        return np.array(
            [
                np.arctan2(m[1, 2], m[2, 2]),
                np.arctan2(-m[0, 2], np.hypot(m[1, 2], m[2, 2])),
                np.arctan2(m[0, 1], m[0, 0]),
            ]
        )

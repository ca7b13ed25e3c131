"""The laws of all effects a second time, in space and with NumPy, and how a body moves by them.

    I dw/dt = (I w) x w + A^T tau,   dA/dt = A hat(w + A^T slip)

REFERENCE[name](effect, t, A, omega in space, Properties) is a torque in space. Vectors of the body,
its tensor and its attitude are in the axes in which the body is described. No code of the package.
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
        self.static, self.inverse = mass * self.centre, np.linalg.inv(self.tensor)


def matrices(q):
    """A (3, 3, ...) of quaternions (4, ...), from body to space components."""
    w, x, y, z = q / np.sqrt((q * q).sum(0))
    one = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    two = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    three = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return np.array([one, two, three])


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


def pull(e, t):
    """mu/r^3 and the direction to the body on its orbit."""
    r, nu = anomaly(e.mu, e.distance, e.eccentricity, e.anomaly, t)
    return e.mu / r**3, np.array([math.cos(nu), math.sin(nu), 0.0])


def turn_about_z(a):
    c, s = math.cos(a), math.sin(a)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def gradient_torque(e, t, a, b):
    size, r = pull(e, t)
    return 3.0 * size * np.cross(r, a @ b.tensor @ a.T @ r)


def spring_torque(e, a):
    arm = a @ e.at
    d = arm - e.to
    return np.cross(arm, -e.stiffness * (1.0 - e.length / np.linalg.norm(d)) * d)


def potential_torque(e, a):
    u = a[2]
    slope = e.linear + symmetric(e.quadratic) @ u + 4.0 * np.multiply(e.quartic, u**3)
    return a @ np.cross(u, slope)


def whole(e, t, a, w, b):
    """(size, direction in space) of the momentum of a body with the wheels that a loss knows."""
    g = a @ (b.tensor @ a.T @ w + e.wheel + t * np.array(e.motor))
    return np.linalg.norm(g), g / np.linalg.norm(g)


def dissipated(e, t, a, w, b):
    """Minus loss times the component of omega across the momentum of the whole, times its size."""
    size, n = whole(e, t, a, w, b)
    return -e.loss * size * (w - n * (n @ w))


REFERENCE = {  # torque in space components: functions of effect, t, A, omega in space
    "gravity": lambda e, t, a, w, b: np.cross(a @ b.static, -e.g * UP),
    "gravity_gradient": lambda e, t, a, w, b: gradient_torque(e, t, a, b),
    "spring": lambda e, t, a, w, b: spring_torque(e, a),
    "uniform_field": lambda e, t, a, w, b: np.cross(a @ e.dipole, e.field),
    "rotating_field": lambda e, t, a, w, b: np.cross(
        a @ e.dipole, turn_about_z(e.rate * t) @ e.field
    ),
    "potential": lambda e, t, a, w, b: potential_torque(e, a),
    "moving_pivot": lambda e, t, a, w, b: np.cross(
        a @ b.static, np.multiply(e.swing, e.frequency**2 * math.cos(e.frequency * t + e.phase))
    ),
    "body_torque": lambda e, t, a, w, b: a @ e.size,
    "space_torque": lambda e, t, a, w, b: np.array(e.size),
    "periodic_torque": lambda e, t, a, w, b: a @ e.size * math.cos(e.frequency * t + e.phase),
    # the total momentum is constant: in space, that of the wheel changes by what the body gets back
    "rotor": lambda e, t, a, w, b: (
        -np.cross(w, a @ (np.array(e.momentum) + t * np.array(e.motor))) - a @ e.motor
    ),
    "viscous_damping": lambda e, t, a, w, b: -e.rate * a @ b.tensor @ a.T @ w,
    "axial_damping": lambda e, t, a, w, b: -a @ np.diag(e.rates) @ b.tensor @ a.T @ w,
    "matrix_damping": lambda e, t, a, w, b: -a @ symmetric(e.matrix) @ a.T @ w,
    "quadratic_drag": lambda e, t, a, w, b: -e.drag * np.linalg.norm(w) * w,
    "dry_friction": lambda e, t, a, w, b: -e.friction * w / math.hypot(np.linalg.norm(w), e.rest),
    "energy_dissipation": dissipated,
    "internal_dissipation": dissipated,
}
# What effects add in space to the angular velocity I^-1 L. A torque in the body that goes with it
# is one in space less the change of axes, which turn faster.
SLIPS = {
    "internal_dissipation": lambda e, t, a, w, b: e.loss * np.cross(whole(e, t, a, w, b)[1], w)
}
ENERGY = {  # functions of effect, A and body
    "gravity": lambda e, a, b: e.g * (UP @ a @ b.static),
    "spring": lambda e, a, b: 0.5 * e.stiffness * (np.linalg.norm(a @ e.at - e.to) - e.length) ** 2,
    "uniform_field": lambda e, a, b: -(a @ e.dipole) @ e.field,
    "potential": lambda e, a, b: (
        np.dot(e.linear, a[2]) + 0.5 * a[2] @ symmetric(e.quadratic) @ a[2] + e.quartic @ a[2] ** 4
    ),
}


def with_wheels(effects):
    """Effects as [(name, effect)]; inner friction takes the momentum of the rotors beside it."""
    rotors = [one for name, one in effects if name == "rotor"]
    if not rotors:
        return effects
    total = {
        field: tuple(np.sum([getattr(one, of) for one in rotors], axis=0))
        for field, of in (("wheel", "momentum"), ("motor", "motor"))
    }
    friction = "energy_dissipation", "internal_dissipation"
    return [(n, one._replace(**total) if n in friction else one) for n, one in effects]


class Motion:
    """The motion of a body from its start to `end`; effects : [(name, effect of plain numbers)]."""

    def __init__(self, body, effects, omega, attitude, end, points=4001, max_step=0.025):
        self.body, self.effects = body, with_wheels(effects)
        slips = [(SLIPS[name], e) for name, e in self.effects if name in SLIPS]

        def rates(t, y):
            q, w, a = y[:4], y[4:7], matrices(y[:4])
            known = a, a @ w, body
            parts = [a.T @ REFERENCE[name](e, t, *known) for name, e in self.effects]
            dw = body.inverse @ (np.cross(body.tensor @ w, w) + sum(parts, NOTHING))
            turn = w + sum((a.T @ slip(e, t, *known) for slip, e in slips), NOTHING)
            dq = 0.5 * np.array([-q[1:] @ turn, *(q[0] * turn + np.cross(q[1:], turn))])
            return np.concatenate([dq, dw, [part @ w for part in parts]])

        attitude = np.array(attitude, float) / np.linalg.norm(attitude)
        start = np.concatenate([attitude, omega, np.zeros(len(effects))])
        # steps so short that the dense output, of order 7, is as good as the steps
        self.solution = solve_ivp(
            rates, (0.0, end), start, "DOP853", rtol=1e-12, atol=1e-14, max_step=max_step,
            dense_output=True,
        ).sol  # fmt: skip
        self.times = np.linspace(0.0, end, points)
        self.states = self.solution(self.times)

    def end(self):
        """(A, omega, works) at the end."""
        y = self.states[:, -1]
        return matrices(y[:4]), y[4:7], y[7:]

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
        known = [(ENERGY[name], e) for name, e in self.effects if name in ENERGY]
        potential = [sum(energy(e, one, self.body) for energy, e in known) for one in a]
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
        pitch = np.arctan2(-m[0, 2], np.hypot(m[1, 2], m[2, 2]))
        return np.array([np.arctan2(m[1, 2], m[2, 2]), pitch, np.arctan2(m[0, 1], m[0, 0])])

"""Operations that methods of high order need for heavy tops, by error.

All in `long double`, so that no rounding hides an error. Each top makes its own steps, as with
`turn`. An operation is a product, a sum or a fused multiply-add. An evaluation of the rates under
gravity takes 32; a Runge-Kutta method adds 7 for each coefficient that is not 0, extrapolation 7
for each evaluation, and a Taylor series of order p needs 21 products of series.

Measured once with published coefficients, in operations of rk8 for 1e-12 and 1e-13: order 9
(Verner, 15 stages) 0.71 and 0.67; order 10 (17 stages; Ono) 0.90 and 0.84, (Hairer; Feagin) 1.1 and
1.05; order 12 (25 stages; Ono) 1.06 and 0.95, (Feagin) 1.25 and 1.12.
"""

import numpy as np

from bench import harness
from bench.problems import tops
from rigidmc.physics.effects import Gravity
from rigidmc.physics.integrators import gbs12, rk8
from rigidmc.planning.steps import count_member_steps, rate_bounds

T_END, MEMBERS = 10.0, 128
LIMITS = (1e-4, 1e-7, 1e-10, 1e-12, 1e-13)
EVALUATION, NUMBERS = 32, 7
# stages of each row of rk8, see `RK8.step`
ROWS = (
    (rk8._A2, (0,)), (rk8._A3, (0, 1)), (rk8._A4, (0, 2)), (rk8._A5, (0, 2, 3)),
    (rk8._A6, (0, 3, 4)), (rk8._A7, (0, 3, 4, 5)), (rk8._A8, (0, 3, 4, 5, 6)),
    (rk8._A9, (0, 3, 4, 5, 6, 7)), (rk8._A10, (0, 3, 4, 5, 6, 7, 8)),
    (rk8._A11, (0, 3, 4, 5, 6, 7, 8, 9)), (rk8._A12, (0, 3, 4, 5, 6, 7, 8, 9, 10)),
    (rk8._B, (0, 5, 6, 7, 8, 9, 10, 11)),
)  # fmt: skip


def rates(y, p):
    """Return d(q, omega)/dt;  p : rows of k, of I^-1 and of weight times centre of mass."""
    q, w = y[:4], y[4:]
    return np.concatenate([spin(q, w) / 2, p[:3] * w[[1, 2, 0]] * w[[2, 0, 1]] + push(p, up(q))])


def spin(q, w):
    """Return the quaternion product q (0, w)."""
    return np.stack(
        [
            -q[1] * w[0] - q[2] * w[1] - q[3] * w[2],
            q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
            q[0] * w[1] + q[3] * w[0] - q[1] * w[2],
            q[0] * w[2] + q[1] * w[1] - q[2] * w[0],
        ]
    )


def up(q):
    """Return the vertical in body axes."""
    x, y = 2 * (q[1] * q[3] - q[0] * q[2]), 2 * (q[2] * q[3] + q[0] * q[1])
    return np.stack([x, y, q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2])


def push(p, u):
    """Return I^-1 (u x c)."""
    return p[3:6] * turned(u, p[6:])


def turned(a, b):
    """Return a x b."""
    return a[[1, 2, 0]] * b[[2, 0, 1]] - a[[2, 0, 1]] * b[[1, 2, 0]]


def runge_kutta(y, p, h):
    """Make a step of rk8."""
    k = [rates(y, p)]
    for row, stages in ROWS:
        new = y + h * sum(np.longdouble(a) * k[i] for a, i in zip(row, stages, strict=True))
        k.append(rates(new, p))
    return new


def extrapolation(substeps):
    """Return a step of the extrapolated midpoint rule."""
    squares = [np.longdouble(n) ** 2 for n in substeps]
    weights = [np.prod([a / (a - b) for b in squares if b != a]) for a in squares]

    def step(y, p, h):
        first, change = rates(y, p), 0
        for n, weight in zip(substeps, weights, strict=True):
            even, odd = y, y + h / n * first
            for _ in range(n // 2 - 1):
                even = even + 2 * h / n * rates(odd, p)
                odd = odd + 2 * h / n * rates(even, p)
            change = change + weight * (even + 2 * h / n * rates(odd, p) - y)
        return y + change

    return step


def taylor(order):
    """Return a step of the Taylor series."""

    def step(y, p, h):
        q, w, g = [y[:4]], [y[4:]], [up(y[:4])]
        for n in range(order):
            pairs = range(n + 1)
            free = sum(w[i][[1, 2, 0]] * w[n - i][[2, 0, 1]] for i in pairs)
            q_rate = sum(spin(q[i], w[n - i]) for i in pairs) / 2
            g_rate = sum(turned(g[i], w[n - i]) for i in pairs)
            w.append((p[:3] * free + push(p, g[n])) / (n + 1))
            q.append(q_rate / (n + 1))
            g.append(g_rate / (n + 1))
        new = np.concatenate([q[-1], w[-1]])
        for a, b in zip(q[-2::-1], w[-2::-1], strict=True):
            new = new * h + np.concatenate([a, b])
        return new

    return step


def methods():
    """Return {name: (step, operations of a step)}."""
    terms = sum(len(row) for row, _ in ROWS)
    # rk8 in the engine scales L to omega in each evaluation: 3 more
    found = {"rk8": (runge_kutta, NUMBERS * terms + 12 * (EVALUATION + 3))}
    for last, order in ((8, 8), (10, 10), (14, 12), (14, 14)):
        substeps = gbs12.SUBSTEPS if order == 12 else tuple(range(2, last + 1, 2))
        evaluations = sum(substeps) - len(substeps) + 1
        cost = evaluations * (EVALUATION + NUMBERS) + len(substeps) * (3 + 2 * NUMBERS)
        found[f"gbs{order}"] = extrapolation(substeps), cost
    for order in (12, 14, 16, 18, 20):
        found[f"Taylor {order}"] = taylor(order), 21 * order * (order + 1) // 2 + 23 * order
    return found


class Problem:
    """Heavy tops, their steps at a turn, and their end by Taylor series of order 22."""

    def __init__(self):
        many = tops.random_tops(MEMBERS, seed=11)
        self.tops = many._replace(static=np.random.default_rng(12).normal(size=(3, MEMBERS)))
        gravity = (Gravity(1.0),)
        block = tops.blocks(self.tops, gravity)[0]
        self.rates = rate_bounds(gravity, block)
        i = self.tops.moments.astype(np.longdouble)
        j, k = i[[1, 2, 0]], i[[2, 0, 1]]
        self.numbers = np.concatenate([(j - k) / i, 1 / i, self.tops.static])
        self.end = self.run(taylor(22), 0.4)[0]

    def run(self, step, turn):
        """Return (state at the end, mean number of steps)."""
        counts = count_member_steps(self.rates, T_END, turn).astype(int)
        order = np.argsort(-counts)
        counts, numbers = counts[order], self.numbers[:, order]
        y = np.concatenate([self.tops.attitude, self.tops.omega])[:, order].astype(np.longdouble)
        h = np.longdouble(T_END) / counts
        with np.errstate(all="ignore"):
            for made in range(counts[0]):
                live = int(np.searchsorted(-counts, -made, "left"))
                new = step(y[:, :live], numbers[:, :live], h[:live])
                new[:4] /= np.sqrt((new[:4] ** 2).sum(0))
                y[:, :live] = new
        back = np.argsort(order)
        return y[:, back], float(counts.mean())

    def error(self, end):
        """Return the largest error of omega (relative) and attitude [rad] over all tops."""
        wrong, true = end[4:] - self.end[4:], self.end[4:]
        rate = np.sqrt((wrong**2).sum(0) / (true**2).sum(0))
        angle = tops.attitude_error(end[:4], self.end[:4])
        return float(np.nanmax(np.where(np.isfinite(rate + angle), np.maximum(rate, angle), 9.0)))


def steps_needed(problem, step):
    """Return the mean number of steps for each limit, between turns that are 1.19 apart."""
    found, turn, last = [], 4.0, None
    while len(found) < len(LIMITS):
        end, steps = problem.run(step, turn)
        point = np.log(steps), np.log(problem.error(end))
        while len(found) < len(LIMITS) and point[1] <= np.log(LIMITS[len(found)]):
            part = (
                1.0
                if last is None
                else (np.log(LIMITS[len(found)]) - last[1]) / (point[1] - last[1])
            )
            x = point[0] if last is None else last[0] + part * (point[0] - last[0])
            found.append(float(np.exp(x)))
        last, turn = point, turn / 2.0**0.25
    return found


def run(quick):
    problem, rows = Problem(), []
    for name, (step, cost) in methods().items():
        if quick and name not in ("rk8", "gbs12"):
            continue
        for limit, steps in zip(LIMITS, steps_needed(problem, step), strict=True):
            rows.append({"kind": "order", "name": name, "limit": limit, "steps": steps,
                         "operations": steps * cost})  # fmt: skip
    each = {(r["name"], r["limit"]): r["operations"] for r in rows}
    for limit in (1e-12, 1e-13):
        ratio = each["gbs12", limit] / each["rk8", limit]
        what = f"operations of gbs12 for an error of {limit:.0e}, of those of rk8"
        rows.append(harness.at_most(what, 0.75, ratio))
    return rows


def report(rows):
    some = [r for r in rows if r["kind"] == "order"]
    each = {(r["name"], r["limit"]): r for r in some}
    lines = [
        [name]
        + [
            f"{each[name, limit]['steps']:.0f}: {each[name, limit]['operations'] / 1e3:.0f}"
            for limit in LIMITS
        ]
        for name in dict.fromkeys(r["name"] for r in some)
    ]
    head = ["worst error", *(f"{limit:.0e}" for limit in LIMITS)]
    harness.table(f"steps: thousands of operations, {MEMBERS} heavy tops to 10 s", head, lines)
    harness.report_targets(rows)

"""The times of a run: how many steps it makes, and which of them end at a save."""

import math
from fractions import Fraction

from rigidmc.errors import SceneError

MOST_STEPS = 10**15


def steps_and_saves(
    t_end: float, dt: float, every: float | None
) -> tuple[int, float, int, tuple[str, ...]]:
    """(steps, dt, stride, notes): a whole number of steps to t_end, and of steps between saves,
    with a step of at most dt.

    Decimal numbers are taken as the fractions they are written as, so that 10 / 0.3 is 100/3.
    Raises SceneError if `every` and t_end have no common step of at least dt/2.
    """
    end, step = Fraction(repr(t_end)), Fraction(repr(dt))
    for key, length in (("dt", dt), ("every", every)):
        if length is not None:
            _refuse_many(end / Fraction(repr(length)), key, length, t_end)
    if every is None or every >= t_end:
        steps = stride = max(1, math.ceil(end / step * (1 - Fraction(1, 10**9))))
    else:
        # steps must be a multiple of p for stride = steps q/p to be whole, with p/q = t_end/every
        ratio = end / Fraction(repr(every))
        # numbers that are only written to 16 digits, such as t_end/7 or 2^-30 s
        simple = ratio.limit_denominator(1000)
        ratio = simple if abs(simple / ratio - 1) < Fraction(1, 10**14) else ratio
        multiples = max(1, math.ceil(end / step / ratio.numerator * (1 - Fraction(1, 10**9))))
        steps = multiples * ratio.numerator
        stride = multiples * ratio.denominator
        if steps > 2 * math.ceil(end / step) and steps > 1000:
            saves = max(1, round(t_end / every))
            rule = (
                f"no step near dt = {dt:g} divides both it and t_end = {t_end:g}: take t_end ="
                f" {_times(every, saves)}, or every = {t_end / saves:.10g}"
            )
            raise SceneError("run", "every", every, rule)
    _refuse_many(steps, "dt", dt, t_end)
    reduced = t_end / steps
    if abs(reduced / dt - 1) < 1e-9:
        return steps, reduced, stride, ()
    note = f"dt reduced from {dt:g} to {reduced:.10g} s, which divides t_end and every"
    return steps, reduced, stride, (note,)


def _refuse_many(steps: int | Fraction, key: str, length: float, t_end: float) -> None:
    """Raise SceneError for more steps, or saves, than a run may have."""
    if steps > MOST_STEPS:
        # a whole number of more than 309 digits is no float
        count = f"{float(steps):.3g}" if steps < 10**300 else "over 1e+300"
        rule = f"{count} steps to t_end = {t_end:g}, more than the limit of {MOST_STEPS:.3g}"
        raise SceneError("run", key, length, rule)


def _times(every: float, saves: int) -> str:
    """A time of whole saves, as it is written."""
    return str(float(Fraction(repr(every)) * saves))


def rounds(t_end: float, every: float | None) -> tuple[int, float, int]:
    """(rounds, length, rounds between saves): the longest times that divide t_end and `every`."""
    if every is None or every >= t_end:
        return 1, t_end, 1
    count, length, stride, _ = steps_and_saves(t_end, every, every)
    return count, length, stride

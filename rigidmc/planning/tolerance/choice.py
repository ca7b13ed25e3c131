"""The choice of a search, for `show` and for the attributes of a result."""

from typing import Any, NamedTuple

from rigidmc.inputs.amounts import count_text
from rigidmc.planning.tolerance.costs import Candidate

SURE = 299  # members that state something about 99 % of all members with 95 % certainty


class Choice(NamedTuple):
    """The choice for `--tolerance`: the candidate, its error, and the alternatives.

    predicted : error that 99 % of members stay below
    checked : fraction of the members of a second pilot within the tolerance
    runner_up : (Candidate, its cost relative to the chosen one), or None
    pilots : which members were integrated how far, if not all to t_end; else ""
    """

    way: Candidate
    predicted: float
    checked: float
    truth: str
    runner_up: tuple[Candidate, float] | None
    ns_per_member: float
    tolerance: float
    members: int
    pilots: str = ""

    def members_per_second(self, threads: int) -> float:
        """Return members to t_end per second on all threads."""
        return 1e9 * threads / self.ns_per_member

    @property
    def short(self) -> str:
        """A warning if the predicted error exceeds the tolerance although finer steps were tried,
        else ""."""
        if self.predicted <= self.tolerance:
            return ""
        return (
            f"the error bound for 99 % of members, {self.predicted:.2g}, exceeds the tolerance of "
            f"{self.tolerance:g}; finer steps were tried"
        )

    def lines(self, count: int, seconds: float) -> list[str]:
        """Describe the choice, its reasons, and the time that `count` members take."""
        way, other = self.way, self.runner_up
        lines = [
            f"for a tolerance of {self.tolerance:g}: {way.with_precision()} {way.step}, the "
            "cheapest that reaches it"
        ]
        if other is not None:
            second = f"{other[0].with_precision()} {other[0].step}"
            lines.append(f"  next best: {second}, at {other[1]:.2g} times the cost")
        few = self.members < SURE
        lines.append(
            f"  {'the members of both pilots' if few else '99 % of members'} have errors below "
            f"{self.predicted:.1e}; on a second pilot of "
            f"{count_text(self.members, 'member')}, {100 * self.checked:.1f} % keep the tolerance"
        )
        lines += [f"  note: {self.short}"] * bool(self.short)
        lines.append(f"  reference: {self.truth}")
        lines += [f"  pilot: {self.pilots}"] * bool(self.pilots)
        lines.append(f"  about {seconds:.2g} s for {count_text(count, 'member')}")
        return lines

    def attributes(self) -> dict[str, Any]:
        """Return the choice as attributes of a result, without any timing of this machine."""
        way, other = self.way, self.runner_up
        attributes: dict[str, Any] = {
            "tolerance": self.tolerance,
            "tolerance_predicted_error": self.predicted,
            "tolerance_checked_share": self.checked,
            "tolerance_truth": self.truth,
            "tolerance_chosen": f"{way.with_precision()} {way.step}: the cheapest that reaches it",
        }
        if self.pilots:
            attributes["tolerance_pilot"] = self.pilots
        if other is not None:
            attributes["tolerance_runner_up"] = f"{other[0].with_precision()} {other[0].step}"
        return attributes

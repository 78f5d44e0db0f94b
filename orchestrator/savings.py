"""What a run did not have to do: counts under the name of the switch that allows it."""

from __future__ import annotations


class Savings:
    """Adds up what each kind of skipping saved."""

    def __init__(self) -> None:
        self.counts: dict[str, dict[str, int]] = {}

    def add(self, switch: str, what: str, count: int) -> None:
        """``count`` things called ``what`` were not done, thanks to a switch of ``method.skip``; none leaves no trace."""
        if count:
            saved = self.counts.setdefault(switch, {})
            saved[what] = saved.get(what, 0) + int(count)

    def __add__(self, other: "Savings") -> "Savings":
        """What both saved, as of two ranks."""
        total = Savings()
        for part in (self, other):
            for switch, saved in part.counts.items():
                for what, count in saved.items():
                    total.add(switch, what, count)
        return total

    def table(self) -> list[dict[str, object]]:
        """As in summary.json: one entry per switch."""
        return [{"skip": switch, "saved": dict(saved)} for switch, saved in self.counts.items()]

"""What a run has used: each rank notes its own, the summary has the sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from orchestrator.blackbox.usage import Usage
from orchestrator.results.summary.summary import memory_peak_mb, versions
from orchestrator.results.summary.workload import Record, codes_of_all, joined
from orchestrator.savings import Savings
from orchestrator.scene.model import Scene


@dataclass(frozen=True)
class Spent:
    """One rank's share.

    clock : the codes' own CPU seconds per kind of work, summed over workers
    memory_mb, own_memory_mb : largest, of this process and of the codes', and of this process alone
    codes : number of a code in the configuration → what it has spent
    asked : seconds for which the black box has been asked, but for the true error
    workload : who did what, per period
    workers : processes of the codes that work at the same time
    savings : what need not be done
    """

    clock: dict[str, float]
    memory_mb: float
    own_memory_mb: float
    codes: dict[int, dict[str, object]]
    asked: float
    workload: Record
    workers: int
    savings: Savings

    @classmethod
    def of(cls, usage: Usage, numbers: Sequence[int], workload: Record, workers: int, savings: Savings,
           for_reference: float = 0.0) -> Spent:
        """This rank's, so far.

        usage : what its black box has taken
        numbers : of the black box's codes in the configuration
        for_reference : seconds that it was asked for the true error, which are no part of the solution's
        """
        own = memory_peak_mb()
        return cls(usage.clock(), usage.memory_peak_mb() + own, own, dict(zip(numbers, usage.codes())),
                   usage.asked - for_reference, workload, workers, savings)


def total(ranks: Sequence[Spent], scene: Scene) -> dict[str, object]:
    """What all ranks have used, under the keys of summary.json."""
    codes = codes_of_all([rank.codes for rank in ranks])
    for number, entry in codes.items():
        entry["subdomains"] = [s.index for s in scene.subdomains if s.code == number]
    return {
        "timing": {"blackbox": {work: sum(rank.clock[work] for rank in ranks) for work in ranks[0].clock}},
        "asking_seconds": max(rank.asked for rank in ranks), "codes": list(codes.values()),
        "versions": versions({entry["code"]: entry["version"] for entry in codes.values()}),
        "workload": joined([rank.workload for rank in ranks]), "workers": sum(rank.workers for rank in ranks),
        "memory_peak_mb": sum(rank.memory_mb for rank in ranks), "rank_memory_peak_mb": [rank.own_memory_mb for rank in ranks],
        "skipped": sum((rank.savings for rank in ranks), Savings()).table(), "ranks": len(ranks),
    }

"""Workload: who did what, who waited, and what all have used; stages of ranks and seconds of
workers, as in the paper's tables 3 and 4.

A record is plain data. Rows carry the rank they were measured on, so that those of several ranks
are joined by putting their lists one after the other (``joined``).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.blackbox.usage import CLOCKS, Activity, Usage, since
from orchestrator.parallel.team import ALONE, Team
from orchestrator.processes import memory_peak_mb
from orchestrator.results.summary.summary import versions
from orchestrator.timing import Stopwatch

if TYPE_CHECKING:  # who reads a report has no scene, and need not load what makes one
    from orchestrator.scene.model import Scene

_TABLES = ("stages", "workers", "ranks")

Record = dict[str, dict[str, object]]


class Workload:
    """Measures one period of a run after the other.

    usage, watch : what is observed: the black box's workers, and the stages
    team : the ranks; what this one waits for others is part of its stages

    A rank is idle while it waits for others: its codes have nothing to do either. Peak memory is
    that of the rank's own process since it was started, at the end of the period; its CPU seconds
    are those of all its threads, the codes' not among them.
    """

    def __init__(self, usage: Usage, watch: Stopwatch, team: Team = ALONE):
        self.usage, self.watch, self.team = usage, watch, team
        watch.waited = lambda: team.waited
        self.record: Record = {}
        self._then = self._now()

    def end(self, period: str) -> None:
        """Record what has happened since the last call under this name."""
        then, now = self._then, self._now()
        self._then, rank, (clocks, stages, workers) = now, self.team.rank, then
        wall, cpu, waited, messages, sent, reductions = np.subtract(now[0], clocks).tolist()
        spent = {name: np.subtract(measured, stages.get(name, (0.0, 0, 0.0))).tolist()
                 for name, measured in now[1].items()}
        busy = [since(late, early) for late, early in zip(now[2], workers)]
        took = [sum(own[clock] for clock in CLOCKS) for own in busy]
        self.record[period] = {
            "seconds": wall,
            "stages": [{"rank": rank, "stage": name, "calls": int(calls), "seconds": seconds,
                        "waiting": waiting, "share": seconds / wall}
                       for name, (seconds, calls, waiting) in spent.items() if seconds > 0],
            "workers": [{"rank": rank, **own, "seconds": all_,
                         "idle_share": (own["waiting"] + own["idle"]) / all_ if all_ else 0.0}
                        for own, all_ in zip(busy, took)],
            "ranks": [{"rank": rank, "seconds": wall, "cpu": cpu, "waiting": waited,
                       "idle_share": waited / wall, "messages": int(messages),
                       "reductions": int(reductions), "bytes": int(sent),
                       "memory_peak_mb": memory_peak_mb()}]}

    def _now(self) -> tuple[tuple, dict[str, tuple[float, int, float]], list[Activity]]:
        """Clocks and what the ranks have exchanged; per stage seconds, calls and waiting; what
        workers have done.
        """
        watch, team = self.watch, self.team
        return ((time.perf_counter(), time.process_time(), team.waited, team.messages, team.bytes,
                 team.reductions),
                {name: (watch.seconds[name], watch.calls[name], watch.waiting[name])
                 for name in list(watch.seconds)}, self.usage.activity())


def joined(records: Sequence[Record]) -> Record:
    """The records of all ranks as one; a period lasts as long as on the slowest rank."""
    return {period: {"seconds": max(r[period]["seconds"] for r in records),
                     **{table: [row for r in records for row in r[period][table]]
                        for table in _TABLES}} for period in records[0]}


def codes_of_all(ranks: Sequence[Mapping[int, dict]]) -> dict[int, dict]:
    """One entry per code (as ``Usage.codes``, under the code's number) from those of every rank."""
    result: dict[int, dict] = {}
    for number, entry in sorted((item for codes in ranks for item in codes.items()),
                                key=lambda item: item[0]):
        known = result.get(number)
        result[number] = entry if known is None else known | {
            key: known[key] + entry[key] for key in ("models", "workers", "compliances")} | {
            "seconds": {kind: known["seconds"][kind] + spent
                        for kind, spent in entry["seconds"].items()}}
    return result


@dataclass(frozen=True)
class Spent:
    """One rank's share.

    clock : the codes' own CPU seconds per kind of work, summed over workers
    memory_mb, own_memory_mb : largest, of this process and of the codes', and of this process alone
    codes : number of a code in the configuration → what it has spent
    asked : seconds for which the black box has been asked, but for the true error
    workload : who did what, per period
    workers : processes of the codes that work at the same time
    """

    clock: dict[str, float]
    memory_mb: float
    own_memory_mb: float
    codes: dict[int, dict[str, object]]
    asked: float
    workload: Record
    workers: int

    @classmethod
    def of(cls, usage: Usage, numbers: Sequence[int], workload: Record, workers: int,
           for_reference: float = 0.0) -> Spent:
        """This rank's, so far.

        usage : what its black box has taken
        numbers : of the black box's codes in the configuration
        for_reference : seconds that it was asked for the true error, which are no part of the
            solution's
        """
        own = memory_peak_mb()
        return cls(usage.clock(), usage.memory_peak_mb() + own, own,
                   dict(zip(numbers, usage.codes())),
                   usage.asked - for_reference, workload, workers)


def total(ranks: Sequence[Spent], scene: Scene) -> dict[str, object]:
    """The use of all ranks, under the keys of summary.json."""
    codes = [entry | {"subdomains": [s.index for s in scene.subdomains if s.code == number]}
             for number, entry in codes_of_all([rank.codes for rank in ranks]).items()]
    return {
        "timing": {"blackbox": {work: sum(rank.clock[work] for rank in ranks)
                                for work in ranks[0].clock}},
        "asking_seconds": max(rank.asked for rank in ranks), "codes": codes,
        "versions": versions({entry["code"]: entry["version"] for entry in codes}),
        "workload": joined([rank.workload for rank in ranks]),
        "workers": sum(rank.workers for rank in ranks),
        "memory_peak_mb": sum(rank.memory_mb for rank in ranks),
        "rank_memory_peak_mb": [rank.own_memory_mb for rank in ranks],
        "ranks": len(ranks)}

"""Ranks that are threads of one process, for what they tell each other without a clock."""

import threading

import numpy as np

from orchestrator.parallel.team import Team


class Threads(Team):
    """Ranks that are threads of this process: gathered objects wait for each other at a barrier."""

    def __init__(self, rank: int, size: int, table: list, barrier: threading.Barrier):
        self.rank, self.size, self.table, self.barrier = rank, size, table, barrier

    def all_gather(self, part):
        self.table[self.rank] = part
        self.barrier.wait()
        everyone = list(self.table)
        self.barrier.wait()
        return everyone

    def gather(self, part):
        everyone = self.all_gather(part)
        return None if self.rank else everyone

    def share(self, thing):
        return self.all_gather(thing)[0]

    def hand_out(self, make):
        made = self.all_gather(None if self.rank else [make(rank) for rank in range(self.size)])
        return made[0][self.rank]

    def both(self, parts, largest):
        everyone = self.all_gather(([np.array(part, float) for part in parts], list(largest)))
        return [sum(same) for same in zip(*(sums for sums, _ in everyone))], [max(same) for same in zip(*(ends for _, ends in everyone))]

    def deliver(self, outgoing):
        return [np.array(everyones[self.rank], float).ravel() for everyones in self.all_gather(list(outgoing))]

    def exchange(self, outgoing, incoming):
        everyone = self.all_gather({rank: array.copy() for rank, array in outgoing.items()})
        for rank, array in incoming.items():
            array[...] = everyone[rank][self.rank]
        return incoming


def among(size: int, what) -> list:
    """What each of some ranks returns, or raises."""
    results, table, barrier = [None] * size, [None] * size, threading.Barrier(size, timeout=120)

    def run(rank: int) -> None:
        try:
            results[rank] = what(Threads(rank, size, table, barrier))
        except Exception as error:  # noqa: BLE001 - told below
            results[rank] = error
            barrier.abort()  # nobody waits for who is gone

    threads = [threading.Thread(target=run, args=(rank,)) for rank in range(size)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results

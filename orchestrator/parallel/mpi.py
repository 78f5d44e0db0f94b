"""A team over MPI. Nobody ever blocks inside MPI: all waiting is polling, with naps.

So a waiting rank leaves its core to the codes and answers signals. A failing rank tells all others
why. A thread of theirs listens and interrupts whatever they do; they end in good order, and rank 0
saves what there is and says why, once.
"""

from __future__ import annotations

import atexit
import os
import pickle
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import psutil
from mpi4py import MPI

from orchestrator.errors import OrchestratorError, told_from
from orchestrator.parallel.team import Elsewhere, Team

_TRACES, _FAILURE, _OBJECT = 1, 2, 3  # tags
_EAGER = 50e-6  # seconds of polling without a nap
_NAPS = (20e-6, 1e-3)  # shortest and longest
_LISTENING = 0.1  # seconds between two looks for failures elsewhere
# numbers, over all ranks, up to which a sum is gathered, in one message, rather than reduced and
# sent back
_GATHERED = 1 << 16


class MpiRanks(Team):
    """All ranks that mpiexec has started."""

    def __init__(self) -> None:
        # a communicator of its own for failures, so that no other message is taken for one
        self._world, self._alarm = MPI.COMM_WORLD, MPI.COMM_WORLD.Dup()
        self.rank, self.size = self._world.rank, self._world.size
        node = self._world.Split_type(MPI.COMM_TYPE_SHARED)
        self._neighbours = node.allgather((self.rank, os.getpid(), sorted(os.sched_getaffinity(0))))
        self._failed, self._heard = False, None
        # requests under way, kept alive whatever happens: MPI writes into their memory
        self._open: dict[int, Any] = {}
        atexit.register(self._end)

    # ---- what the method asks ------------------------------------------------------------------

    def both(self, parts: Sequence,
             largest: Sequence[float]) -> tuple[list[np.ndarray], list[float]]:
        arrays = [np.asarray(part, float) for part in parts]
        ends = np.cumsum([0, *(a.size for a in arrays)])
        mine = np.concatenate([*(a.ravel() for a in arrays), np.array(largest, float)])
        self.reductions += 1
        self._count(mine)
        if len(mine) * self.size <= _GATHERED:
            everyone = self._gathered(mine)
            total, most = everyone[:, : ends[-1]].sum(axis=0), everyone[:, ends[-1]:].max(axis=0)
        else:  # one rank adds, all take its bits
            total, sums = np.empty(ends[-1]), mine[: ends[-1]]
            self._wait(self._world.Ireduce(sums, total if self.rank == 0 else None, MPI.SUM,
                                           root=0), sums, total)
            self._count(total if self.rank == 0 else total[:0])
            self._wait(self._world.Ibcast(total, root=0), total)
            most = self._gathered(mine[ends[-1]:]).max(axis=0)
        return [total[a:b].reshape(x.shape)
                for a, b, x in zip(ends[:-1], ends[1:], arrays)], most.tolist()

    def _gathered(self, mine: np.ndarray) -> np.ndarray:
        """Return (ranks, n) the numbers (n,) of all ranks."""
        everyone = np.empty((self.size, len(mine)))
        self._wait(self._world.Iallgather(mine, everyone), mine, everyone)
        return everyone

    def meet(self) -> None:
        self._count(np.empty(0))
        self._wait(self._world.Ibarrier())

    def exchange(self, outgoing: Mapping[int, np.ndarray],
                 incoming: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        outgoing = {rank: np.ascontiguousarray(array) for rank, array in outgoing.items()}
        requests = [self._world.Irecv(array, rank, _TRACES) for rank, array in incoming.items()]
        requests += [self._world.Isend(array, rank, _TRACES) for rank, array in outgoing.items()]
        self._count(*outgoing.values())
        self._open |= {id(request): (request, outgoing, incoming) for request in requests}
        for request in requests:
            self._wait(request)
        return incoming

    def deliver(self, outgoing: Sequence[np.ndarray]) -> list[np.ndarray]:
        flat = [np.ravel(np.asarray(array, float)) for array in outgoing]
        sizes, found = np.array([len(array) for array in flat]), np.empty(self.size, int)
        self._count(sizes)
        self._wait(self._world.Ialltoall(sizes, found), sizes, found)
        others = [rank for rank in range(self.size) if rank != self.rank]
        arrived = self.exchange({rank: flat[rank] for rank in others if len(flat[rank])},
                                {rank: np.empty(found[rank]) for rank in others if found[rank]})
        return [flat[rank] if rank == self.rank else arrived.get(rank, np.empty(0))
                for rank in range(self.size)]

    def all_gather(self, part: Any) -> list[Any]:
        packed, sizes = np.frombuffer(pickle.dumps(part), np.uint8), np.empty(self.size, int)
        own = np.array([len(packed)])
        self._wait(self._world.Iallgather(own, sizes), own, sizes)
        every = np.empty(sizes.sum(), np.uint8)
        self._count(packed)
        ends = np.cumsum(sizes)
        self._wait(self._world.Iallgatherv(packed, [every, (sizes, ends - sizes)]), packed, every)
        return [pickle.loads(every[a:b]) for a, b in zip(ends - sizes, ends)]

    def gather(self, part: Any) -> list[Any] | None:
        if self.rank:
            self._send(part, 0)
            return None
        return [part, *(self._received(rank) for rank in range(1, self.size))]

    def hand_out(self, make: Callable[[int], Any]) -> Any:
        if self.rank:
            return self._received(0)
        for rank in range(1, self.size):
            self._send(make(rank), rank)
        return make(0)

    def _send(self, thing: Any, rank: int) -> None:
        packed = np.frombuffer(pickle.dumps(thing), np.uint8)
        self._count(packed)
        self._wait(self._world.Isend(packed, rank, _OBJECT), packed)

    def _received(self, rank: int) -> Any:
        """The next thing that a rank has sent, of whatever length."""
        status = MPI.Status()
        self._poll(lambda: self._world.Iprobe(rank, _OBJECT, status))
        packed = np.empty(status.Get_count(MPI.BYTE), np.uint8)
        self._wait(self._world.Irecv(packed, rank, _OBJECT), packed)
        return pickle.loads(packed)

    def share(self, thing: Any) -> Any:
        packed = np.frombuffer(pickle.dumps(thing) if self.rank == 0 else b"", np.uint8).copy()
        length = np.array([len(packed)])
        self._wait(self._world.Ibcast(length, root=0), length)
        packed = self.spread(np.empty(length[0], np.uint8) if self.rank else packed)
        return pickle.loads(packed) if self.rank else thing

    def spread(self, array: np.ndarray) -> np.ndarray:
        if self.rank == 0:
            self._count(array)
        self._wait(self._world.Ibcast(array, root=0), array)
        return array

    def cores(self) -> float:
        """Each core is shared evenly by the ranks of this node that may use it."""
        users = {rank: set(allowed) for rank, _, allowed in self._neighbours}
        return sum(1 / sum(core in allowed for allowed in users.values())
                   for core in users[self.rank])

    def _count(self, *sent: np.ndarray) -> None:
        self.messages += len(sent)
        self.bytes += sum(array.nbytes for array in sent)

    # ---- waiting, failures, the end ------------------------------------------------------------

    def _wait(self, request, *memory: np.ndarray) -> None:
        self._open.setdefault(id(request), (request, memory))
        self._poll(request.Test)
        self._open.pop(id(request), None)

    def _poll(self, arrived: Callable[[], bool]) -> None:
        begin, nap = time.perf_counter(), _NAPS[0]
        while not arrived():
            if self._heard is not None:
                self._leave()
            if time.perf_counter() - begin > _EAGER:
                time.sleep(nap)
                nap = min(1.5 * nap, _NAPS[1])
        self.waited += time.perf_counter() - begin

    @contextmanager
    def together(self) -> Iterator[None]:
        """The block all ranks run. Leaving it, they wait for each other, unless one has failed."""
        previous = signal.signal(signal.SIGUSR1, self._stop)
        over = threading.Event()
        listener = threading.Thread(target=self._listen, args=(over,), name="failures elsewhere",
                                    daemon=True)
        listener.start()
        try:
            yield
            if not self.parted:
                self._wait(self._world.Ibarrier())
        except BaseException as error:
            self.part(error)
            raise
        finally:
            over.set()
            listener.join()
            signal.signal(signal.SIGUSR1, previous)

    def _listen(self, over: threading.Event) -> None:
        status = MPI.Status()
        while not over.wait(_LISTENING):
            if self._alarm.Iprobe(MPI.ANY_SOURCE, _FAILURE, status):
                self._heard = Elsewhere(status.source,
                                        self._alarm.recv(source=status.source, tag=_FAILURE))
                signal.pthread_kill(threading.main_thread().ident, signal.SIGUSR1)
                return

    def _stop(self, signum: int, frame: object) -> None:
        if self._heard is not None and not self._failed:
            self._leave()

    def _leave(self) -> None:
        """Raise what another rank has met: by the signal once, and where that was swallowed, at the
        next wait for others.
        """
        self._failed = True
        raise self._heard

    def _end(self) -> None:
        """After a failure requests are still under way: MPI has to end before their memory goes."""
        if not MPI.Is_finalized():
            MPI.Finalize()

    @property
    def parted(self) -> bool:
        return self._failed

    def part(self, error: BaseException) -> None:
        """Waits for nobody."""
        if self._failed or self.lost():
            return
        self._failed = True
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:  # noqa: BLE001 - whatever an error carries, its text travels
            error = OrchestratorError(f"{type(error).__name__}: {error}")
        if self.rank:
            error = told_from(f"on rank {self.rank} ({platform.node()})", error)
        self._open |= {-1 - rank: self._alarm.isend(error, rank, _FAILURE)
                       for rank in range(self.size) if rank != self.rank}

    def cause(self, error: BaseException) -> BaseException:
        """Return what ended the run, as rank 0 shall say it."""
        if isinstance(error, Elsewhere):
            return error.error
        if isinstance(error, KeyboardInterrupt) and (lost := self.lost()):
            which = " and ".join(map(str, lost))
            return OrchestratorError(
                f"rank {which} has died, killed by hand or by the kernel for want of memory; all "
                "others have stopped")
        return error

    def speaks(self) -> bool:
        lost = self.lost()
        return self.rank == min(rank for rank, _, _ in self._neighbours
                                if rank not in lost) and (self.rank == 0 or 0 in lost)

    def lost(self) -> list[int]:
        return [rank for rank, pid, _ in self._neighbours if not _alive(pid)]


def _alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    except psutil.NoSuchProcess:
        return False

"""A team over MPI. Nobody ever blocks inside MPI: all waiting is polling, with naps.

So a waiting rank leaves its core to the codes and answers signals. A failing rank tells all others
why. A thread of theirs listens and interrupts whatever they do, be it waiting for their own codes;
they end in good order, and rank 0 saves what there is and says why, once.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from mpi4py import MPI

from orchestrator.errors import OrchestratorError
from orchestrator.parallel.team import Elsewhere, Team

_TRACES, _FAILURE, _GATHER, _HANDED = 1, 2, 3, 4  # tags
_SHORT = 1 << 15  # bytes that travel together with their number
_EAGER = 50e-6  # seconds of polling without a nap
_NAPS = (20e-6, 1e-3)  # shortest and longest
_LISTENING = 0.1  # seconds between two looks for failures elsewhere
_GATHERED = 1 << 16  # numbers, over all ranks, up to which a sum is gathered, in one message, rather than reduced and sent back


class Ranks(Team):
    """All ranks that mpiexec has started."""

    def __init__(self) -> None:
        # a communicator of its own for failures, so that no other message is taken for one
        self._world, self._alarm = MPI.COMM_WORLD, MPI.COMM_WORLD.Dup()
        self.rank, self.size = self._world.rank, self._world.size
        self.waited, self.messages, self.bytes, self.reductions = 0.0, 0, 0, 0
        node = self._world.Split_type(MPI.COMM_TYPE_SHARED)
        self._neighbours = node.allgather((self.rank, os.getpid(), sorted(os.sched_getaffinity(0))))
        self._failed, self._over, self._heard = False, threading.Event(), None
        self._told: list = []
        self._open: dict[int, Any] = {}  # requests under way, kept alive whatever happens: MPI writes into their memory
        atexit.register(self._end)

    # ---- what the method asks ------------------------------------------------------------------

    def sum_later(self, *parts) -> Callable[[], list[np.ndarray]]:
        arrays = [np.asarray(part, float) for part in parts]
        # one alone is not copied: nobody changes what is under way
        mine = np.concatenate([a.ravel() for a in arrays]) if len(arrays) != 1 else np.ascontiguousarray(arrays[0]).ravel()
        self._count(mine)
        self.reductions += 1
        if len(mine) * self.size <= _GATHERED:
            everyone = np.empty((self.size, len(mine)))
            request = self._world.Iallgather(mine, everyone)
        else:  # one rank adds, all take its bits
            everyone = np.empty((1, len(mine)))
            request = self._world.Ireduce(mine, everyone if self.rank == 0 else None, MPI.SUM, root=0)
        self._open[id(request)] = request, mine, everyone

        def result() -> list[np.ndarray]:
            self._wait(request)
            if len(mine) * self.size > _GATHERED:
                self._count(everyone if self.rank == 0 else np.empty(0))
                self._wait(self._world.Ibcast(everyone, root=0))
            total = everyone.sum(axis=0) if len(everyone) > 1 else everyone[0]
            return _apart(total, arrays)

        return result

    def both_later(self, parts: Sequence, largest: Sequence[float]) -> Callable[[], tuple[list[np.ndarray], list[float]]]:
        arrays = [np.asarray(part, float) for part in parts]
        mine = np.concatenate([*(a.ravel() for a in arrays), np.array(largest, float)])
        if len(mine) * self.size > _GATHERED:
            return super().both_later(parts, largest)
        everyone = np.empty((self.size, len(mine)))
        self._count(mine)
        self.reductions += 1
        request = self._world.Iallgather(mine, everyone)
        self._open[id(request)] = request, mine, everyone

        def result() -> tuple[list[np.ndarray], list[float]]:
            self._wait(request)
            sums, ends = np.split(everyone, [len(mine) - len(largest)], axis=1)
            return _apart(sums.sum(axis=0), arrays), ends.max(axis=0).tolist()

        return result

    def max_later(self, *values: float) -> Callable[[], list[float]]:
        everyone, mine = np.empty((self.size, len(values))), np.array(values, float)
        self._count(mine)
        self.reductions += 1
        request = self._world.Iallgather(mine, everyone)
        self._open[id(request)] = request, mine, everyone

        def result() -> list[float]:
            self._wait(request)
            return everyone.max(axis=0).tolist()

        return result

    def exchange_later(self, outgoing: Mapping[int, np.ndarray],
                       incoming: dict[int, np.ndarray]) -> Callable[[], dict[int, np.ndarray]]:
        requests = [self._world.Irecv(array, rank, _TRACES) for rank, array in incoming.items()]
        requests += [self._world.Isend(array, rank, _TRACES) for rank, array in outgoing.items()]
        self._count(*outgoing.values())
        self._open |= {id(request): (request, outgoing, incoming) for request in requests}

        def result() -> dict[int, np.ndarray]:
            for request in requests:
                self._wait(request)
            return incoming

        return result

    def all_gather(self, part: Any) -> list[Any]:
        mine = np.frombuffer(pickle.dumps(part), np.uint8)
        self._count(mine)
        lengths = np.empty(self.size, np.int64)
        self._wait(self._world.Iallgather(np.array([len(mine)], np.int64), lengths))
        everyone = np.empty(lengths.sum(), np.uint8)
        self._wait(self._world.Iallgatherv(mine, [everyone, lengths]))
        return self._unpacked(everyone, lengths)

    def gather(self, part: Any) -> list[Any] | None:
        if self.rank:
            packed = pickle.dumps(part)
            self._count(np.frombuffer(packed, np.uint8))
            self._wait(self._world.Isend(np.frombuffer(packed, np.uint8), 0, _GATHER))
            return None
        return [part] + [pickle.loads(self._received(rank, _GATHER)) for rank in range(1, self.size)]

    def hand_out(self, make: Callable[[int], Any]) -> Any:
        if self.rank:
            return pickle.loads(self._received(0, _HANDED))
        for rank in range(1, self.size):
            packed = np.frombuffer(pickle.dumps(make(rank)), np.uint8)
            self._count(packed)
            self._wait(self._world.Isend(packed, rank, _HANDED))
        return make(0)

    def _received(self, rank: int, tag: int) -> np.ndarray:
        """The next part that a rank has sent, of whatever length."""
        status = MPI.Status()
        self._poll(lambda: self._world.Iprobe(rank, tag, status))
        packed = np.empty(status.Get_count(MPI.BYTE), np.uint8)
        self._wait(self._world.Irecv(packed, rank, tag))
        return packed

    def gather_later(self, part: np.ndarray, sizes: list[int]) -> Callable[[], list[np.ndarray] | None]:
        mine = np.ascontiguousarray(part, float).ravel()
        self._count(mine)
        everyone = np.empty(sum(sizes) if self.rank == 0 else 0)
        request = self._world.Igatherv(mine, [everyone, sizes] if self.rank == 0 else None, root=0)
        self._open[id(request)] = request, mine, everyone

        def result() -> list[np.ndarray] | None:
            self._wait(request)
            return np.split(everyone, np.cumsum(sizes)[:-1]) if self.rank == 0 else None

        return result

    def share(self, thing: Any) -> Any:
        # length and beginning in one message, which is all for most things
        first, packed = np.zeros(8 + _SHORT, np.uint8), np.empty(0, np.uint8)
        if self.rank == 0:
            packed = np.frombuffer(pickle.dumps(thing), np.uint8).copy()
            first[:8] = np.array([len(packed)]).view(np.uint8)
            first[8 : 8 + len(packed)] = packed[:_SHORT]
            self._count(packed)
        self._wait(self._world.Ibcast(first, root=0))
        length = int(first[:8].view(np.int64)[0])
        if self.rank:
            packed = np.empty(length, np.uint8)
            packed[:_SHORT] = first[8 : 8 + length]
        if length > _SHORT:
            self._wait(self._world.Ibcast(packed[_SHORT:], root=0))
        return thing if self.rank == 0 else pickle.loads(packed)

    def cores(self) -> float:
        """Each core is shared evenly by the ranks of this node that may use it."""
        users = {rank: set(allowed) for rank, _, allowed in self._neighbours}
        return sum(1 / sum(core in allowed for allowed in users.values()) for core in users[self.rank])

    @staticmethod
    def _unpacked(everyone: np.ndarray, lengths: np.ndarray) -> list[Any]:
        ends = np.cumsum(lengths)
        return [pickle.loads(everyone[e - n : e].tobytes()) for e, n in zip(ends, lengths)]

    def _count(self, *sent: np.ndarray) -> None:
        self.messages += len(sent)
        self.bytes += sum(array.nbytes for array in sent)

    # ---- waiting, failures, the end ------------------------------------------------------------

    def _wait(self, request) -> None:
        self._open.setdefault(id(request), request)
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
        listener = threading.Thread(target=self._listen, name="failures elsewhere", daemon=True)
        listener.start()
        try:
            yield
            self._wait(self._world.Ibarrier())
        except BaseException as error:
            self._tell(error)
            raise
        finally:
            self._over.set()
            listener.join()
            signal.signal(signal.SIGUSR1, previous)

    def _listen(self) -> None:
        status = MPI.Status()
        while not self._over.wait(_LISTENING):
            if self._alarm.Iprobe(MPI.ANY_SOURCE, _FAILURE, status):
                self._heard = Elsewhere(status.source, self._alarm.recv(source=status.source, tag=_FAILURE))
                signal.pthread_kill(threading.main_thread().ident, signal.SIGUSR1)
                return

    def _stop(self, signum: int, frame: object) -> None:
        if self._heard is not None and not self._failed:
            self._leave()

    def _leave(self) -> None:
        """Raise what another rank has met.

        By the signal once. Imports, finalizers and callbacks may swallow it, whatever the signal happens to
        interrupt; the next wait for others, which would last for ever, then raises it again.
        """
        self._failed = True
        raise self._heard

    def _end(self) -> None:
        """After a failure requests are still under way: MPI has to end before their memory goes."""
        if not MPI.Is_finalized():
            MPI.Finalize()

    def _tell(self, error: BaseException) -> None:
        """Let all others know that this rank goes no further; waits for nobody."""
        if self._failed or self.lost():
            return
        self._failed = True
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:  # noqa: BLE001 - whatever an error carries, its text travels
            error = OrchestratorError(f"{type(error).__name__}: {error}")
        self._told = [self._alarm.isend(error, rank, _FAILURE) for rank in range(self.size) if rank != self.rank]

    def cause(self, error: BaseException) -> BaseException:
        """What ended the run, as rank 0 shall say it."""
        if isinstance(error, Elsewhere):
            return error.error
        if isinstance(error, KeyboardInterrupt) and (lost := self.lost()):
            which = " and ".join(map(str, lost))
            return OrchestratorError(f"rank {which} has died, killed by hand or by the kernel for want of memory; "
                                     "all others have stopped")
        return error

    def speaks(self) -> bool:
        lost = self.lost()
        return self.rank == min(rank for rank, _, _ in self._neighbours if rank not in lost) and (
            self.rank == 0 or 0 in lost)

    def lost(self) -> list[int]:
        gone = []
        for rank, pid, _ in self._neighbours:
            try:
                with open(f"/proc/{pid}/stat") as file:
                    dead = file.read().rpartition(")")[2].split()[0] in "ZX"
            except OSError:
                dead = True
            if dead:
                gone.append(rank)
        return gone


def _apart(flat: np.ndarray, arrays: Sequence[np.ndarray]) -> list[np.ndarray]:
    """What has travelled together, in the shapes of these arrays."""
    ends = np.cumsum([a.size for a in arrays])
    return [flat[e - a.size : e].reshape(a.shape) for a, e in zip(arrays, ends)]

"""Stands between the orchestrator and FreeFEM's pipes and falsifies one reply.

    python -m benchmarks.kit.proxy FREEFEM ARGUMENTS…

``ORCHESTRATOR_FALSIFY`` says which, as JSON: ``kind`` (load, traces, fields, stiffness), ``number`` of the reply among
those of its kind, ``how`` (entry: one value, by ``size`` times the largest; reply: all values, by that share), ``seed`` of
the entry, and ``counts``, a file that is given the number of replies of each kind.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from collections import Counter
from typing import BinaryIO

import numpy as np

LOAD, TRACES, FIELDS, STIFFNESS, QUIT = 1, 2, 3, 4, 5  # requests of the protocol that subdomain_server.edp speaks
KINDS = {LOAD: "load", TRACES: "traces", FIELDS: "fields", STIFFNESS: "stiffness"}


def main(freefem: str, *arguments: str) -> int:
    """FreeFEM's exit code."""
    requests, replies = arguments[-2:]
    if not replies.startswith("/dev/fd/"):
        return subprocess.call([freefem, *arguments])
    to_read, ask = os.pipe()
    answer, to_write = os.pipe()
    child = subprocess.Popen([freefem, *arguments[:-2], f"/dev/fd/{to_read}", f"/dev/fd/{to_write}"],
                             pass_fds=(to_read, to_write))
    os.close(to_read)
    os.close(to_write)
    kinds: queue.SimpleQueue[str] = queue.SimpleQueue()
    kinds.put("hello")
    with open(ask, "wb") as out, open(requests, "rb") as source:
        threading.Thread(target=_forward, args=(source, out, kinds), daemon=True).start()
        with open(answer, "rb") as back, open(replies, "wb") as target:
            _falsify(back, target, kinds, json.loads(os.environ["ORCHESTRATOR_FALSIFY"]))
        return child.wait()


def _forward(source: BinaryIO, out: BinaryIO, kinds: queue.SimpleQueue) -> None:
    """Requests as they come, each told by the kind of its replies."""
    while len(head := source.read(8)) == 8:
        op = int(np.frombuffer(head, np.int64)[0])
        ints, reals = (b"", b"") if op == QUIT else (_array(source), _array(source))
        if op != QUIT:
            several = op in (TRACES, FIELDS)
            for _ in range(int(np.frombuffer(ints, np.int64)[1]) if several else 1):
                kinds.put(KINDS[op])
        out.write(head + ints + reals)
        out.flush()
    out.close()


def _falsify(back: BinaryIO, target: BinaryIO, kinds: queue.SimpleQueue, wanted: dict) -> None:
    seen: Counter[str] = Counter()
    while ints := _array(back):
        seconds, reals = _array(back), _array(back)
        kind = kinds.get()
        if kind == wanted.get("kind") and seen[kind] == wanted["number"]:
            values = np.frombuffer(reals, float, offset=8).copy()
            _change(values, wanted)
            reals = reals[:8] + values.tobytes()
        seen[kind] += 1
        target.write(ints + seconds + reals)
        target.flush()
        if "counts" in wanted:
            with open(wanted["counts"], "w") as file:
                json.dump(seen, file)


def _change(values: np.ndarray, wanted: dict) -> None:
    if wanted["how"] == "reply":
        values *= 1 + wanted["size"]
    elif values.size:
        values[np.random.default_rng(wanted["seed"]).integers(values.size)] += wanted["size"] * np.abs(values).max()


def _array(stream: BinaryIO) -> bytes:
    """An array's bytes, its count first; empty at the end of the stream."""
    head = stream.read(8)
    return head + stream.read(8 * int(np.frombuffer(head, np.int64)[0])) if len(head) == 8 else b""


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

"""Whether two runs solve the same problem: all that the method's state depends on, key by key, and a hash of it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping

import numpy as np

from orchestrator.results.named_files import hashed, included, named

# When to stop, where to write, who computes and how long it may take change nothing in what a state means.
_FREE = {"name", "output", "blackbox.workers", "blackbox.transport", "blackbox.timeout",
         "parts.program.timeout", "method.tolerance", "method.max_iterations"}
_SHORT = 40  # signs of a value in a message


def problem_of(config: Mapping[str, object], *arrays: np.ndarray) -> dict[str, str]:
    """What the state depends on: key → value of the configuration (complete), key → content of the files that it names and
    of those that these include, and e.g. the mesh's nodes and cells.

    Tolerance, iteration limit, name, output, workers, transport and timeout are left out: a run may be
    resumed with others. So are the places of files: what is in them counts.
    """
    problem: dict[str, str] = {}
    for key, value in _leaves(config, "", ""):
        file, rest = named(value)
        if file is None:
            problem[key] = json.dumps(value, default=str)
            continue
        problem[key] = f"content of {os.path.basename(file)}{rest}: {hashed(file)}"
        for other in included(file):
            problem[f"{key}, with {os.path.relpath(other, os.path.dirname(file))}"] = f"content: {hashed(other)}"
    for number, array in enumerate(arrays):
        digest = hashlib.sha256(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
        problem[("nodes of the mesh", "cells of the mesh")[number] if number < 2 else f"array {number}"] = f"content: {digest.hexdigest()}"
    return problem


def digest_of(problem: Mapping[str, str]) -> str:
    """Hash of what ``problem_of`` has found."""
    return hashlib.sha256(json.dumps(problem, sort_keys=True).encode()).hexdigest()


def fingerprint(config: Mapping[str, object], *arrays: np.ndarray) -> str:
    """Hash of what the state depends on, see ``problem_of``."""
    return digest_of(problem_of(config, *arrays))


def differences(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """What differs between two problems, in words; of the mesh only where nothing else explains it."""
    keys = [key for key in (*now, *(key for key in before if key not in now)) if before.get(key) != now.get(key)]
    keys = [key for key in keys if not key.endswith(" of the mesh")] or keys
    return [f"{key}: {_shown(before.get(key))}, now {_shown(now.get(key))}" if "content" not in f"{before.get(key)}{now.get(key)}"
            else f"{_which(key, now.get(key) or before.get(key))} is another one" for key in keys]


def _shown(value: str | None) -> str:
    return "nothing" if value is None else value if len(value) <= _SHORT else f"{value[:_SHORT]}…"


def _which(key: str, value: str) -> str:
    what = value.rpartition(":")[0]
    return f"{key} ({what})" if what != "content" else key


def _leaves(value: object, path: str, plain: str) -> Iterator[tuple[str, object]]:
    """Keys with the places in lists, and what is no mapping or list; numbers of one list are one value."""
    if plain in _FREE:
        return
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else str(key), f"{plain}.{key}" if plain else str(key))
    elif isinstance(value, (list, tuple)) and any(isinstance(item, (Mapping, list, tuple, str)) for item in value):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{path}[{index}]", plain)
    else:
        yield path, value

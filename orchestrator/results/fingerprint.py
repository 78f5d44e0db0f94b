"""Whether two runs solve the same problem: a hash of all that the method's state depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

# When to stop, where to write, who computes and how long it may take change nothing in what a state means.
_FREE = {"name", "output", "blackbox.workers", "blackbox.transport", "blackbox.timeout",
         "method.tolerance", "method.max_iterations"}
_FILES = {"blackbox.code", "blackbox.form"}  # what is in them counts as well


def fingerprint(config: Mapping[str, object], *arrays: np.ndarray) -> str:
    """Hash of what the state depends on: the configuration (complete), what is in the files of forms and solvers that it
    names, and e.g. the mesh's nodes and cells.

    Tolerance, iteration limit, name, output, workers, transport and timeout are left out: a run may be
    resumed with others.
    """
    digest = hashlib.sha256(json.dumps(_relevant(config, ""), sort_keys=True, default=str).encode())
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _relevant(value: object, path: str) -> object:
    if path == "blackbox" and isinstance(value, list):
        return [_relevant(entry, path) for entry in value]
    if path in _FILES and isinstance(value, str):
        file = Path(value if path != "blackbox.code" else value.partition(".py")[0] + ".py")
        return [value, hashlib.sha256(file.read_bytes()).hexdigest()] if file.is_file() else value
    if not isinstance(value, Mapping):
        return value
    inner = {str(key): (f"{path}.{key}" if path else str(key), item) for key, item in value.items()}
    return {key: _relevant(item, where) for key, (where, item) in inner.items() if where not in _FREE}

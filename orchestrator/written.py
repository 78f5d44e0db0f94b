"""Files whose damage is found: .npz that are written whole or not at all, and single files that a
seal at their end tells as ours.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import zipfile
from pathlib import Path

import numpy as np

from orchestrator.errors import wrong


def write_arrays(path: Path, **arrays: object) -> None:
    """An .npz file, packed, in a folder that is made where it is not there; whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}")
    with unfinished.open("wb") as file:
        np.savez_compressed(file, **arrays)
    os.replace(unfinished, path)


def read_arrays(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """All arrays of an .npz file.

    Each is unpacked to its end, where its checksum is compared. ``numpy.load`` stops where the array's own header says: a
    bit that makes (225,) of it (205,) leaves the checksum unasked.

    Raises OSError, ValueError, EOFError, zlib.error, zipfile.BadZipFile: it cannot be read, or is not as it was written
    """
    with zipfile.ZipFile(path) as packed:
        return {name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(packed.read(name)), allow_pickle=False)
                for name in packed.namelist()}


_SEAL = re.compile(rb"\n<!-- orchestrator ([0-9a-f]{64}) -->\n\Z")


def write_sealed(path: Path, content: bytes) -> None:
    """Write a single file of a command where its user says, with a seal behind what its readers look at.

    Raises InputError: a file is there that is no such file, or was changed since; it cannot be written
    """
    try:
        if path.is_symlink() or path.exists() and not _sealed(path.read_bytes()):
            raise wrong((), f"{path}, which is there already and was not written by this program, or changed since",
                        "a new file, or one that an earlier call has written", "name another one, or remove it")
        path.write_bytes(content + f"\n<!-- orchestrator {hashlib.sha256(content).hexdigest()} -->\n".encode())
    except OSError as error:
        raise wrong((), f"{path}: {error.strerror}", "a place that can be written to", "name another one") from error


def _sealed(content: bytes) -> bool:
    seal = _SEAL.search(content)
    return seal is not None and hashlib.sha256(content[: seal.start()]).hexdigest().encode() == seal[1]

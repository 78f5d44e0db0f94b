"""Files .npz that are written whole or not at all, and whose damage is found wherever it is."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

import numpy as np


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

"""A whole scene put on disk while its parts are worked on; it comes back page by page, as somebody asks for its arrays."""

from __future__ import annotations

import mmap
import pickle
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import BinaryIO

from orchestrator.processes import trim
from orchestrator.scene.model import Scene

_ALIGNED = 64  # bytes, as arrays in memory are


@contextmanager
def set_aside(scene: Scene | None, wanted: bool = True) -> Iterator[None]:
    """While the block runs the scene is empty, for all who hold it; then it is what it was.

    Where the disk has no room it stays as it is. Afterwards its arrays are the file's, which lasts as long as they: of those
    that nobody asks for nothing is read. Who changes one changes memory alone.
    """
    with tempfile.TemporaryFile() as file:
        packed = None
        if wanted and scene is not None:
            with suppress(OSError):
                packed = _written(scene, file)
        if packed is not None:
            vars(scene).clear()
            trim()
        try:
            yield
        finally:
            if packed is not None:
                content, places = packed
                pages = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)) if places else b""
                vars(scene).update(pickle.loads(content, buffers=[pages[a:b] for a, b in places]))


def _written(scene: Scene, file: BinaryIO) -> tuple[bytes, list[tuple[int, int]]]:
    """The scene without the content of its arrays, and where each array begins and ends in the file."""
    arrays: list[pickle.PickleBuffer] = []
    content, places = pickle.dumps(vars(scene), protocol=5, buffer_callback=arrays.append), []
    for array in arrays:
        raw = array.raw()
        file.write(bytes(-file.tell() % _ALIGNED))
        places.append((file.tell(), file.tell() + raw.nbytes))
        file.write(raw)
    file.flush()
    return content, places

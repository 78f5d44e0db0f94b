"""A scene that is put on disk while its parts are worked on: rank 0 then holds no more than the others."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from orchestrator.scene.model import Scene


@contextmanager
def set_aside(scene: Scene | None, wanted: bool = True) -> Iterator[None]:
    """While the block runs the scene is empty, for all who hold it; then it is what it was.

    Where the disk has no room it stays as it is.
    """
    with tempfile.TemporaryFile() as file:
        aside = False
        if wanted and scene is not None:
            with suppress(OSError):
                pickle.dump(vars(scene), file, pickle.HIGHEST_PROTOCOL)
                file.flush()
                aside = True
        if aside:
            vars(scene).clear()
        try:
            yield
        finally:
            if aside:
                file.seek(0)
                vars(scene).update(pickle.load(file))

"""Single files that a command writes where its user says: only its own earlier ones are replaced, which a seal at their end tells."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from orchestrator.errors import wrong

_SEAL = re.compile(rb"\n<!-- orchestrator ([0-9a-f]{64}) -->\n\Z")


def write_sealed(path: Path, content: bytes) -> None:
    """Writes the file, with a seal behind what its readers look at.

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

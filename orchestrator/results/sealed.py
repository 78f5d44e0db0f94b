"""A page that is written where the user says: it ends with a seal of its own, so that no other file is ever replaced by one."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from orchestrator.errors import InputError, Problem

_SEAL = re.compile(rb"\n<!-- orchestrator ([0-9a-f]{64}) -->\n\Z")


def write_sealed(path: Path, page: bytes) -> None:
    """Writes the page.

    Raises
    ------
    InputError : a file is there that is no such page, or was changed since; it cannot be written
    """
    try:
        if path.is_symlink() or path.exists() and not _sealed(path.read_bytes()):
            raise InputError(Problem((), f"{path}, which is there already and was not written by this program, or changed since",
                                     "a file that is not, or a page of an earlier call", "name another one, or remove it"))
        path.write_bytes(page + f"\n<!-- orchestrator {hashlib.sha256(page).hexdigest()} -->\n".encode())
    except OSError as error:
        raise InputError(Problem((), f"{path}: {error.strerror}", "a place that can be written to", "name another one")) from error


def _sealed(content: bytes) -> bool:
    seal = _SEAL.search(content)
    return seal is not None and hashlib.sha256(content[: seal.start()]).hexdigest().encode() == seal[1]

"""Folders for the files exchanged with programs, and their removal whatever happens.

A folder carries host, boot and process of its owner in its name, and holds a file that the owner
keeps locked for as long as it lives: the kernel opens the lock when the owner ends, however that
happens. What a killed owner left is swept by whoever starts next on that host. The temporary folder
may be shared: folders of another host stay, since nobody can tell from here whether their owners
live, and so do those whose lock is held, be their owner in another container or not to be seen from
here. (``filelock`` does not tell whether the file that it has locked is still the one in the
folder.)

Files .npz are written whole or not at all, and their damage is found wherever it is.
"""

from __future__ import annotations

import fcntl
import io
import os
import re
import shutil
import socket
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import numpy as np

from orchestrator.errors import wrong

_PREFIX, _LOCK = "orchestrator", "owner"
_held: dict[Path, int] = {}  # the locks of this process's folders


@cache
def here() -> tuple[str, str]:
    """Name of the host, and what tells this boot of its kernel from all others; without hyphens."""
    host, boot = re.sub(r"[^A-Za-z0-9.]", "_", socket.gethostname()) or "unknown", "unknown"
    with suppress(OSError):
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip().replace("-", "")[:12]
    return host, boot


def make(below: str | None = None) -> Path:
    """A new folder under the temporary folder (TMPDIR), or another one; raises InputError when it
    cannot be.
    """
    below = below or tempfile.gettempdir()
    sweep(below)
    lock = None
    try:
        while lock is None:  # someone may sweep it before it is locked
            path = Path(tempfile.mkdtemp(prefix="-".join([_PREFIX, *here(), str(os.getpid()), ""]),
                                         dir=below))
            lock = _locked(path)
    except OSError as error:
        raise wrong((), f"no folder can be made in {below}: {error.strerror}",
                    "a writable temporary folder with room",
                    "free some room, or set TMPDIR to another folder") from error
    _held[path] = lock
    return path


def sweep(below: str | None = None) -> None:
    """Remove the folders of owners on this host that are no more; those of other users stay."""
    host, boot = here()
    for path in Path(below or tempfile.gettempdir()).glob(f"{_PREFIX}-*-*-*-*"):
        its_host, its_boot, *_ = path.name.rsplit("-", 4)[1:]
        with suppress(OSError):  # swept by someone else meanwhile, or a file system without locks
            # one kernel, whatever its containers call themselves; or this host before it was
            # started anew
            if (
                path in _held
                or boot != its_boot
                and host != its_host
                or path.stat().st_uid != os.getuid()
            ):
                continue
            if (lock := _locked(path)) is not None:
                shutil.rmtree(path, ignore_errors=True)
                os.close(lock)


def remove(path: Path) -> None:
    """Remove a folder and all in it; may be called twice."""
    for _ in range(3):  # a thread may just be writing into it
        shutil.rmtree(path, ignore_errors=True)
        if not path.exists():
            break
    if (lock := _held.pop(path, None)) is not None:
        os.close(lock)


@contextmanager
def temporary() -> Iterator[Path]:
    """An empty folder that goes on leaving."""
    path = make()
    try:
        (inner := path / "work").mkdir()
        yield inner
    finally:
        remove(path)


def _locked(folder: Path) -> int | None:
    """Descriptor of a folder's lock, now held; None while another process holds it, or if the
    folder is gone.
    """
    try:
        lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o600)
    except FileNotFoundError:
        return None
    held = False
    try:
        with suppress(BlockingIOError, FileNotFoundError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held = os.path.samestat(os.fstat(lock), os.stat(folder / _LOCK))
    finally:
        if not held:
            os.close(lock)
    return lock if held else None


def write_arrays(path: Path, **arrays: object) -> None:
    """An .npz file, packed, in a folder that is made where it is not there; whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}")
    with unfinished.open("wb") as file:
        np.savez_compressed(file, **arrays)
    os.replace(unfinished, path)


def read_arrays(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """All arrays of an .npz file.

    Each is unpacked to its end, where its checksum is compared. ``numpy.load`` stops where the
    array's own header says: a bit that makes (225,) of it (205,) leaves the checksum unasked.

    Raises OSError, ValueError, EOFError, zlib.error, zipfile.BadZipFile: it cannot be read, or is
    not as it was written
    """
    with zipfile.ZipFile(path) as packed:
        return {
            name.removesuffix(".npy"): np.lib.format.read_array(
                io.BytesIO(packed.read(name)), allow_pickle=False)
                for name in packed.namelist()}

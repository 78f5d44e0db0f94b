"""The mesh of a run that lasts: meshing takes minutes, so that a run that goes on does it no second time.

``checkpoint-mesh.npz`` holds what a source has made, under a hash of all that it depends on. It goes with the checkpoint.
"""

from __future__ import annotations

import hashlib
import json
import time
import zipfile
from collections.abc import Callable
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.errors import InputError
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.model import Mesh

NAME = "checkpoint-mesh.npz"
DEAR = 1.0  # seconds of meshing from which it is worth keeping


def kept_mesh(folder: ResultsFolder, sections: list[Any]) -> Callable[[Callable[[], Mesh]], Mesh]:
    """What gives the mesh that an earlier run has left in the folder, or makes it and leaves it there if that was dear.

    Parameters
    ----------
    sections : ``mesh`` of the configuration, or its ``parts``
    """
    key = _key(sections)

    def mesh(make: Callable[[], Mesh]) -> Mesh:
        known = _read(folder, key)
        if known is not None:
            return known
        begin = time.monotonic()
        made = make()
        folder.remove(NAME)
        if time.monotonic() - begin > DEAR:
            _write(folder, key, made)
        return made

    return mesh


def forget_mesh(folder: ResultsFolder) -> None:
    """The run is over: its mesh goes."""
    folder.remove(NAME)


def _key(sections: list[Any]) -> str:
    """Hash of the sections, of the files that they name, and of the mesher's version."""
    digest = hashlib.sha256()
    for section in sections:
        digest.update(section.model_dump_json().encode())
        mesh = getattr(section, "mesh", section)
        if mesh is None:  # of parts whose mesh is not ours nothing is kept
            continue
        for name in (mesh.file, mesh.step):
            if name is not None:
                with suppress(OSError):  # missing: making the mesh tells
                    digest.update(Path(name).read_bytes())
    for package in ("gmsh", "orchestrator"):
        with suppress(metadata.PackageNotFoundError):
            digest.update(metadata.version(package).encode())
    return digest.hexdigest()


def _content(mesh: Mesh) -> dict[str, np.ndarray]:
    return {"nodes": mesh.nodes, "cells": mesh.cells, "volume": mesh.volume,
            **{f"surface_{i}": triangles for i, triangles in enumerate(mesh.surfaces.values())}}


def _digest(key: str, arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256(key.encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _write(folder: ResultsFolder, key: str, mesh: Mesh) -> None:
    arrays = _content(mesh)
    names = {"volumes": mesh.volumes, "surfaces": list(mesh.surfaces), "source": mesh.source,
             "remarks": mesh.remarks, "smooth": mesh.smooth}
    with suppress(InputError), folder.replacing(NAME) as temporary, open(temporary, "wb") as file:
        np.savez(file, about=np.array([json.dumps(names), key, _digest(key, arrays)]), **arrays)


def _read(folder: ResultsFolder, key: str) -> Mesh | None:
    """None: there is none, it is of another section, or damaged."""
    try:
        with np.load(folder / NAME, allow_pickle=False) as data:
            names, theirs, digest = data["about"]
            if theirs != key:
                return None
            arrays = {name: data[name] for name in data.files if name != "about"}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    if _digest(key, arrays) != digest:
        return None
    about = json.loads(str(names))
    surfaces = {name: arrays[f"surface_{i}"] for i, name in enumerate(about["surfaces"])}
    return Mesh(arrays["nodes"], arrays["cells"], arrays["volume"], about["volumes"], surfaces, about["source"],
                about["remarks"], about["smooth"])

"""The mesh of a run that lasts: meshing takes minutes, so that a run that goes on does it no second time.

``checkpoint/mesh.log`` holds what a source has made, with a hash of all that it depends on. It goes with the checkpoint.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from importlib import metadata
from typing import Any

import orchestrator
from orchestrator.errors import InputError
from orchestrator.results.fingerprint import digest_of, problem_of
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.record_file import Damaged, OtherVersion, read_record, write_record
from orchestrator.scene.mesh.mesh import Mesh

NAME = "checkpoint/mesh.log"
DEAR = 1.0  # seconds of meshing from which it is worth keeping


def kept_mesh(folder: ResultsFolder, sections: list[Any], resume: bool) -> Callable[[Callable[[], Mesh]], Mesh]:
    """What makes a mesh and leaves it in the folder if that was dear, or gives the one that the interrupted run has left there.

    Parameters
    ----------
    sections : ``mesh`` of the configuration, or its ``parts``
    resume : whether there is an interrupted run to go on from; a run that begins anew meshes anew
    """
    key = _key(sections)

    def mesh(make: Callable[[], Mesh]) -> Mesh:
        if resume and (known := _read(folder, key)) is not None:
            return known
        begin = time.monotonic()
        made = make()
        folder.remove(NAME)
        if time.monotonic() - begin > DEAR:
            _write(folder, key, made)
        return made

    return mesh


def _key(sections: list[Any]) -> str:
    """Hash of the sections, of the files that they name and of those that these include, and of the meshers' versions."""
    problem = problem_of({"sections": [section.model_dump(mode="json") for section in sections]})
    with suppress(metadata.PackageNotFoundError):
        problem["gmsh"] = metadata.version("gmsh")
    return digest_of({**problem, "orchestrator": orchestrator.__version__})


def _write(folder: ResultsFolder, key: str, mesh: Mesh) -> None:
    about = {"volumes": mesh.volumes, "surfaces": list(mesh.surfaces), "source": mesh.source, "remarks": mesh.remarks,
             "smooth": mesh.smooth}
    arrays = {"nodes": mesh.nodes, "cells": mesh.cells, "volume": mesh.volume,
              **{f"surface {i}": triangles for i, triangles in enumerate(mesh.surfaces.values())}}
    with suppress(InputError), folder.replacing(NAME) as temporary:
        write_record(temporary, key, about, arrays)


def _read(folder: ResultsFolder, key: str) -> Mesh | None:
    """None: there is none, it is of another section, or damaged."""
    try:
        found = read_record(folder / NAME)
    except (OSError, Damaged, OtherVersion):
        return None
    if found.header["problem"] != key:
        return None
    about, arrays = found.header, found.arrays
    surfaces = {name: arrays[f"surface {i}"] for i, name in enumerate(about["surfaces"])}
    return Mesh(arrays["nodes"], arrays["cells"], arrays["volume"], about["volumes"], surfaces, about["source"],
                about["remarks"], about["smooth"])

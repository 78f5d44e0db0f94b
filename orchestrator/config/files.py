"""Files that a configuration names, looked up beside its YAML file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from orchestrator.config.blackbox import settings_class
from orchestrator.config.paths import get
from orchestrator.errors import KeyPath, Problem

# Models that come with gmsh; the scene knows where they are.
SHIPPED = "gmsh:"


def with_meshes(data: Any, folder: Path) -> tuple[Any, list[Problem]]:
    """The data with mesh files looked up beside the YAML file first, then in the current folder; what is not there."""
    problems: list[Problem] = []
    if isinstance(mesh := get(data, "mesh"), dict):
        data = {**data, "mesh": _beside(mesh, ("mesh",), folder, problems)}
    if isinstance(parts := get(data, "parts"), list):
        data = {**data, "parts": [
            {**part, "mesh": _beside(part["mesh"], ("parts", i, "mesh"), folder, problems)}
            if isinstance(part, dict) and isinstance(part.get("mesh"), dict) else part for i, part in enumerate(parts)]}
    return data, problems


def _beside(mesh: dict[str, Any], path: KeyPath, folder: Path, problems: list[Problem]) -> dict[str, Any]:
    for key in ("file", "step"):
        name = mesh.get(key)
        if not isinstance(name, str) or not name:
            continue
        if key == "step" and name.startswith(SHIPPED):
            continue
        places = [os.path.normpath(folder / name), os.path.normpath(name)]
        found = next((place for place in places if os.path.isfile(place)), None)
        if found:
            mesh = {**mesh, key: found}
        else:
            problems.append(Problem((*path, key), f"no file {' nor '.join(dict.fromkeys(places))}",
                                    "an existing file", "paths are relative to the YAML file's folder"))
    return mesh


def with_files_of_codes(data: Any, folder: Path) -> Any:
    """The data with the folder of files that entries of ``blackbox`` name and that stand beside the YAML file."""
    def found(entry: Any) -> Any:
        return settings_class(entry).beside(entry, folder) if isinstance(entry, dict) else entry

    entry = get(data, "blackbox")
    if entry is None:
        return data
    return {**data, "blackbox": [found(e) for e in entry] if isinstance(entry, list) else found(entry)}

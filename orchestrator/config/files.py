"""Files that a configuration names, looked up beside its YAML file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from orchestrator.config.blackbox import settings_class
from orchestrator.config.foreign_parts import file_keys
from orchestrator.config.paths import get
from orchestrator.errors import KeyPath, Problem
from orchestrator.registry import IN_VOLUMES

# Models that come with gmsh; the scene knows where they are.
SHIPPED = "gmsh:"


def with_meshes(data: Any, folder: Path) -> tuple[Any, list[Problem]]:
    """The data with mesh files looked up beside the YAML file first, then in the current folder; what is not there."""
    problems: list[Problem] = []
    if isinstance(mesh := get(data, "mesh"), dict):
        data = {**data, "mesh": _beside(mesh, ("mesh",), folder, problems)}
    if isinstance(parts := get(data, "parts"), list):
        data = {**data, "parts": [_part(part, ("parts", i), folder, problems) if isinstance(part, dict) else part
                                  for i, part in enumerate(parts)]}
    if isinstance(loads := get(data, "loads"), list):
        data = {**data, "loads": [_load(load, ("loads", i), folder, problems) for i, load in enumerate(loads)]}
    return data, problems


def _load(load: Any, path: KeyPath, folder: Path, problems: list[Problem]) -> Any:
    """An entry of ``loads`` with the files of its kind looked up."""
    for name, kind in IN_VOLUMES.items():
        for key in kind.files:
            if (file := get(load, name, key)) is not None:
                load = {**load, name: {**load[name], key: _found(file, (*path, name, key), folder, problems)}}
    return load


def _part(part: dict[str, Any], path: KeyPath, folder: Path, problems: list[Problem]) -> dict[str, Any]:
    """A part with its mesh's files, or those of its model, looked up."""
    if isinstance(mesh := part.get("mesh"), dict):
        part = {**part, "mesh": _beside(mesh, (*path, "mesh"), folder, problems)}
    for kind, key in file_keys(part):
        if (named := part[kind].get(key)) is not None:
            part = {**part, kind: {**part[kind], key: _found(named, (*path, kind, key), folder, problems)}}
    return part


def _beside(mesh: dict[str, Any], path: KeyPath, folder: Path, problems: list[Problem]) -> dict[str, Any]:
    for key in ("file", "step"):
        name = mesh.get(key)
        if key in mesh and not (key == "step" and isinstance(name, str) and name.startswith(SHIPPED)):
            mesh = {**mesh, key: _found(name, (*path, key), folder, problems)}
    return mesh


def _found(name: Any, path: KeyPath, folder: Path, problems: list[Problem]) -> Any:
    """A file's path, or a list of such; what is no name is left as it is."""
    if isinstance(name, list):
        return [_found(one, (*path, i), folder, problems) for i, one in enumerate(name)]
    if not isinstance(name, str) or not name:
        return name
    places = [os.path.normpath(folder / name), os.path.normpath(name)]
    found = next((place for place in places if os.path.isfile(place)), None)
    if found is None:
        problems.append(Problem(path, f"no file {' nor '.join(dict.fromkeys(places))}",
                                "an existing file", "paths are relative to the YAML file's folder"))
    return found or name


def with_files_of_codes(data: Any, folder: Path) -> Any:
    """The data with the folder of files that entries of ``blackbox`` name and that stand beside the YAML file."""
    def found(entry: Any) -> Any:
        return settings_class(entry).beside(entry, folder) if isinstance(entry, dict) else entry

    entry = get(data, "blackbox")
    if entry is None:
        return data
    return {**data, "blackbox": [found(e) for e in entry] if isinstance(entry, list) else found(entry)}

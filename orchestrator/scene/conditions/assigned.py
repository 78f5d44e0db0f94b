"""What the YAML gives to volumes and subdomains by their names: matter, loads, codes, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.config.blackbox import CodeSettings, entry_path
from orchestrator.config.model import Figures
from orchestrator.errors import KeyPath, Problems, some
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Material, Subdomain
from orchestrator.scene.names import matching, patterns_of, suggestion


def assign_materials(mesh: Mesh, entries: list[Any], problems: Problems) -> tuple[list[Material], np.ndarray]:
    """The materials and, per tet, (m,) int which one; of several that match, the last wins."""
    chosen = np.full(len(mesh.volumes), -1)
    for i, entry in enumerate(entries):
        chosen[volumes_named(mesh, entry.on, ("materials", i, "on"), problems)] = i
    materials = [Material(float(e.young), float(e.poisson), float(e.expansion or 0.0)) for e in entries]
    own = {name for e in entries if getattr(e, "on", None) is not None for name in patterns_of(e.on)}
    for stand in mesh.foreign:
        if stand.matter is not None and mesh.volumes[stand.volume] not in own:  # what it tells of itself, unless it is named
            chosen[stand.volume] = len(materials)
            materials.append(Material(*stand.matter))
    without = [name for name, material in zip(mesh.volumes, chosen) if material < 0]
    if without:
        problems.add(("materials",), f"no material for {some(without, 8)}",
                     "a material for each volume", 'name these volumes under on:, or begin the list with a material '
                     'without on:, which holds for all')
    return materials, chosen[mesh.volume]


def volumes_named(mesh: Mesh, on: Any, path: tuple[str | int, ...], problems: Problems) -> list[int]:
    """Indices of the volumes an ``on`` entry names; a name that matches none is a problem."""
    found: dict[int, None] = {}
    for pattern in patterns_of(on):
        names = matching(pattern, mesh.volumes)
        if not names:
            problems.add(path, f"no volume is called {pattern!r}", "names of volumes, shell wildcards allowed",
                         suggestion(pattern, mesh.volumes, "volume"))
        found.update(dict.fromkeys(mesh.volumes.index(name) for name in names))
    return list(found)


def cells_loaded(mesh: Mesh, on: Any, path: tuple[str | int, ...], problems: Problems) -> np.ndarray:
    """(k,) int, cells of the volumes that a load names; parts whose mesh is not ours bring their loads along."""
    cells = np.flatnonzero(np.isin(mesh.volume, volumes_named(mesh, on, path, problems)))
    if not mesh.foreign:
        return cells
    foreign = mesh.is_foreign(cells)
    if len(cells) and foreign.all():
        problems.add(path, f"a load on {mesh.volumes[mesh.volume[cells[0]]]!r} alone, whose mesh is not this program's",
                     "loads on parts with a mesh", "put it in the part's own loads")
    return cells[~foreign]


def assign_codes(mesh: Mesh, subdomains: list[Subdomain], entries: Sequence[CodeSettings]) -> None:
    """Give every subdomain the index of the last entry that matches its name or that of the volume it is in.

    Raises InputError: an entry that matches nothing, a subdomain that none matches
    """
    problems, chosen = Problems(), np.full(len(subdomains), -1)
    names = [_names(mesh, s) for s in subdomains]
    known = [name for own in names for name in own]
    for i, entry in enumerate(entries):
        for pattern in entry.on:
            meant = set(matching(pattern, known))
            hit = [not meant.isdisjoint(own) for own in names]
            if not any(hit):
                problems.add((*entry_path(i, entries), "on"), f"no subdomain and no volume is called {pattern!r}",
                             "names of subdomains, shell wildcards allowed", suggestion(pattern, known, "subdomain"))
            chosen[hit] = i
    left = [s.name for s, code in zip(subdomains, chosen) if code < 0]
    if left:
        problems.add(("blackbox",), f"no entry for {some(left, 8)}", "a black box for each subdomain",
                     "begin the list with an entry without on:, which holds for all")
    problems.raise_if_any()
    for subdomain, code in zip(subdomains, chosen.tolist()):
        subdomain.code, subdomain.remembers = code, entries[code].remembers


def _names(mesh: Mesh, subdomain: Subdomain) -> list[str]:
    """What a subdomain goes by: its own name and, if it lies in one volume, that volume's."""
    inside = np.unique(mesh.volume[subdomain.cells])
    return [subdomain.name] + ([mesh.volumes[inside[0]]] if len(inside) == 1 else [])


def check_figures(nodes: np.ndarray, volumes: list[str], figures: Figures, path: KeyPath, problems: Problems) -> None:
    """Parts that are drawn exist, and a cut leaves something on either side.

    nodes : (n, 3); volumes : names of the parts
    path : of ``figures`` in the YAML
    """
    for name in figures.parts or ():
        if not matching(name, volumes):
            problems.add((*path, "parts"), f"no volume is called {name!r}", "names of volumes, shell wildcards allowed",
                         suggestion(name, volumes, "volume"))
    if (cut := figures.cut) is not None:
        along = nodes[:, "xyz".index(cut.plane)]
        if not along.min() < cut.at < along.max():
            problems.add((*path, "cut", "at"), f"{cut.plane} = {cut.at:g}, which cuts nothing", f"a plane through the model, "
                         f"which spans {cut.plane} from {along.min():.6g} to {along.max():.6g}",
                         f"take at: {(along.min() + along.max()) / 2:.6g} for its middle")

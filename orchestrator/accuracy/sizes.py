"""How small elements have to be, where and how many: from the error of each, and from how fast the
error has fallen so far.

With elements r_K times as large there are Σ r_K⁻³ in place of one each, and the error becomes Σ
η_K² r_K^2p, p = 1 or 2 the order of the elements. The least error with N elements has

    r_K = c η_K^(−2/(2p+3)),       c from Σ r_K⁻³ = N,

and falls with N^(−p/3). Near edges where stresses have no limit it falls more slowly; mesh after
mesh is graded further there. So N for an error ε is taken from the rate s of the last two meshes, N
(η/ε)^(1/s). No element becomes larger.

O. C. Zienkiewicz, J. Z. Zhu, 1987, as in ``method.stopping.recovered_stresses``; L. Y. Li, P.
Bettess, Notes on mesh optimal criteria in adaptive finite element computations, Comm. Numer. Meth.
Engng 11, 1995, 911–915.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from orchestrator.config.mesh import MeshEntry as Source
from orchestrator.config.model import Config
from orchestrator.scene.conditions.ground import GROUND
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.size_map import WHOLE, SizeMap, edge_lengths
from orchestrator.scene.mesh.sources import moved
from orchestrator.scene.names import INSIDE

# elements are asked to be at most this much smaller than those that the error was estimated on
FINER = 8.0
# a mesh has at most this many times as many elements as the one before, which does not know better
# where
GROWTH = 6.0
SLOWEST = 1 / 6  # rate s of meshes that are not graded, at the tip of a crack: h^½ is N^(−1/6)
WORTH = 1.1  # a part that is to get fewer than this times as many elements keeps its mesh

Key = tuple[int, str]  # part, and the volume of it that is meshed by itself, or WHOLE
Maps = dict[Key, SizeMap]


def needed(elements: list[int], errors: list[float], target: float, order: int) -> float:
    """How many elements will leave the error ``target``, from the meshes so far and what they
    left.
    """
    rate = order / 3
    if len(elements) > 1 and elements[-1] > elements[-2]:
        rate = float(np.clip(np.log(errors[-2] / errors[-1]) / np.log(elements[-1] / elements[-2]),
                             SLOWEST, rate))
    return elements[-1] * (errors[-1] / target) ** (1 / rate)


def ratios(errors: np.ndarray, order: int, count: float) -> np.ndarray:
    """(m,) new size over the old one of every element, so that about ``count`` have the least
    error.

    errors : (m,) of the elements; order : 1 or 2
    """
    logs = np.log(np.maximum(errors, 1e-12 * errors.max(initial=0.0) or 1.0))
    low, high = logs.min() - 10.0, logs.max() + 10.0
    for _ in range(60):
        middle = (low + high) / 2
        found = np.clip(np.exp(2 / (2 * order + 3) * (middle - logs)), 1 / FINER, 1.0)
        low, high = (middle, high) if (found**-3).sum() > count else (low, middle)
    return found


@dataclass(frozen=True)
class WantedMesh:
    """A finer mesh, before it is made; by default the one that the configuration says.

    maps : of all that is not as the configuration says
    elements : how many there will be, about; 0 where nothing is asked for
    refined : names of what is meshed anew; kept : of what stays as it is
    had : share of the squared error where it is meshed anew
    """

    maps: Maps = field(default_factory=dict)
    elements: float = 0.0
    refined: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    had: float = 0.0


def wanted(config: Config, mesh: Mesh, errors: np.ndarray, count: float, known: Maps,
           smallest: float) -> WantedMesh:
    """Sizes for about ``count`` elements, part by part: what is fine enough keeps the mesh that it
    has.

    mesh : of the scene; errors : (T, m) of its elements at every load step; the largest counts
    known : maps that it was made with
    smallest : no element is asked to be smaller; length
    """
    corners, order = mesh.cells[:, :4], 2 if mesh.cells.shape[1] == 10 else 1
    old = edge_lengths(mesh.nodes, corners)
    size = np.maximum(ratios(errors.max(axis=0), order, count) * old, np.minimum(smallest, old))
    squares = errors.max(axis=0) ** 2
    maps, elements, refined, kept, had = dict(known), 0.0, [], [], 0.0
    for key, own, name in _pieces(config, mesh):
        more = ((old[own] / size[own]) ** 3).sum()
        if more < WORTH * len(own):
            kept.append(name)
            elements += len(own)
            continue
        refined.append(name)
        elements += more
        had += squares[own].sum()
        used, local = np.unique(corners[own], return_inverse=True)
        local = local.reshape(-1, 4)
        beside = np.bincount(local.ravel(), minlength=len(used))
        at_nodes = np.exp(np.bincount(local.ravel(), np.repeat(np.log(size[own]), 4), len(used))
                          / beside)
        factor, points = _source(config, key[0]).scale, mesh.nodes[used]
        # back to where they are in the part's own mesh
        if config.parts and (move := config.parts[key[0]].move) is not None:
            frame = moved(np.vstack([np.zeros(3), np.eye(3)]), move)
            points = (points - frame[0]) @ (frame[1:] - frame[0]).T
        maps[key] = SizeMap(points / factor, local, at_nodes / factor)
    return WantedMesh(maps, elements, refined, kept, float(had / (squares.sum() or 1.0)))


def _source(config: Config, part: int) -> Source:
    return config.mesh if config.mesh else config.parts[part].mesh


def _pieces(config: Config, mesh: Mesh) -> list[tuple[Key, np.ndarray, str]]:
    """Return what is meshed by itself: its key, its cells, its name."""
    found: dict[Key, tuple[list[int], str]] = {}
    for volume, name in enumerate(mesh.volumes):
        part, inside = -1 if name.startswith(f"{GROUND}[") else 0, name
        if config.parts:
            head, _, inside = name.partition(INSIDE)
            part = next((i for i, p in enumerate(config.parts) if p.name == head), -1)
        if part < 0:
            continue
        source = _source(config, part)
        apart = source.step is not None and source.conforming is False
        called = name if apart else config.parts[part].name if config.parts else config.name
        found.setdefault((part, inside if apart else WHOLE), ([], called))[0].append(volume)
    return [(key, np.flatnonzero(np.isin(mesh.volume, volumes)), name)
            for key, (volumes, name) in found.items()]

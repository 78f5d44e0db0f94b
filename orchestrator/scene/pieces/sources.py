"""Meshes that ranks read or make in shares: bricks, files in partitions, grains, parts and solids meshed apart, some each; others rank 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from orchestrator.config.mesh import OnePart
from orchestrator.config.model import Config
from orchestrator.errors import InputError, Problems
from orchestrator.parallel.numbering import numbered
from orchestrator.parallel.team import Team
from orchestrator.scene.body import Meshed
from orchestrator.scene.mesh.faces import MAX_NODES, pieces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.partitioned import check_whole, in_partitions
from orchestrator.scene.mesh.sources import finished, grid_of, joined, make_mesh, placed
from orchestrator.scene.partition import AXES, Partition, block_name, layers, make_partition, slice_name
from orchestrator.scene.pieces.dealt import Dealt
from orchestrator.scene.pieces.piece import Share

T = TypeVar("T")


def agreed(made: Callable[[], T], team: Team) -> T | None:
    """What each rank makes; None on all of them where any has found something wrong, or what hangs on others."""
    try:
        own = made()
    except InputError:
        own = None
    return None if team.max(float(own is None))[0] else own


def dealt(config: Config, team: Team, meshed: Meshed) -> Dealt | None:
    """The configuration's mesh in its subdomains; None, on all ranks, where they cannot make it together.

    meshed : what makes a mesh on rank 0, and keeps it
    """
    mesh, subdomains = config.mesh, config.subdomains
    by_volume = subdomains.groups and subdomains.split_above is None
    if mesh is None:
        return _of_parts(config.parts, team) if by_volume else None
    if (mesh.box or mesh.beam) and (subdomains.grid or subdomains.slices):
        return _of_bricks(mesh, subdomains, team)
    if mesh.step and mesh.conforming is False and by_volume:
        return _of_made(lambda: [make_mesh(mesh, share=(team.rank, team.size))[0]], team)
    if mesh.polycrystal and by_volume:
        return _of_grains(mesh, team)
    if mesh.file and by_volume and team.share(bool(in_partitions(Path(mesh.file)))):
        return _of_partitions(mesh, team)
    return _of_one(config, team, meshed)


def _of_bricks(mesh: Any, subdomains: Any, team: Team) -> Dealt | None:
    """A box or beam cut into equal blocks or slices, of which each rank makes some bricks; ``mesh`` and ``subdomains`` of the configuration."""
    bricks, factor, sliced = grid_of(mesh), float(mesh.scale or 1.0), subdomains.slices
    blocks = [int(count) for count in subdomains.grid or [sliced.count if axis == sliced.axis else 1 for axis in AXES]]
    if np.prod(bricks.counts + 1.0) > MAX_NODES / 2 * team.size or not 0 < np.prod(blocks, dtype=float) <= bricks.bricks:
        return None
    names = [slice_name(max(index)) if sliced else block_name(*index) for index in np.ndindex(*blocks)]
    made, number, cells = bricks.some(np.arange(team.rank * bricks.bricks // team.size, (team.rank + 1) * bricks.bricks // team.size))
    made = replace(made, nodes=factor * made.nodes, within=factor * np.stack([np.zeros(3), bricks.size]))
    block = np.ravel_multi_index([layers(made, axis, count) for axis, count in enumerate(blocks)], blocks)
    return Dealt(Share(made, Partition(block, names), number, cells), int(np.prod(bricks.counts + 1)), team)


def _of_one(config: Config, team: Team, meshed: Meshed) -> Dealt | None:
    """What rank 0 reads or makes, and cuts, and nobody keeps."""
    share = agreed(lambda: False if team.rank else _cut(config, meshed), team)
    if share is None:
        return None
    nodes, known = team.share(None if team.rank else (len(share.number), share.without_cells))
    return Dealt(known if team.rank else share, nodes, team)


def _cut(config: Config, meshed: Meshed) -> Share | None:
    """All of a mesh, cut; None where volumes are cut of a mesh in several pieces, which may be near, or in, each other."""
    if config.subdomains.split_above is None:
        mesh, faces = meshed.of_corners(config)
    else:  # which counts nodes in the middle of edges
        body = meshed(config, False, Problems())
        mesh, faces = body.mesh, body.faces
    partition = make_partition(mesh, faces, config.subdomains)
    if partition.names != mesh.volumes and pieces(faces, np.zeros(len(mesh.cells), dtype=int))[0] > 1:
        return None
    corners = replace(mesh, nodes=mesh.nodes[:faces.nodes], cells=mesh.cells[:, :4])
    return Share(corners, partition, np.arange(faces.nodes), np.arange(len(mesh.cells)))


def _by_volume(mesh: Mesh, number: np.ndarray, cell_number: np.ndarray, nodes: int, team: Team) -> Dealt:
    """A share whose volumes are the subdomains."""
    return Dealt(Share(mesh, Partition(mesh.volume, mesh.volumes), number, cell_number), nodes, team)


def _of_grains(mesh: Any, team: Team) -> Dealt | None:
    """Grains, of which each rank meshes some; ``mesh`` of the configuration."""
    from orchestrator.scene.mesh.polycrystal import check, share  # with it comes SciPy

    if mesh.polycrystal.grains < team.size or agreed(lambda: [check(mesh, team.size)], team) is None:
        return None
    try:
        own, node_tags, cell_tags = share(mesh, team)
        own = finished(own, mesh, "polycrystal")
    except InputError:  # on all of them
        return None
    number, nodes = numbered(node_tags, team)
    return _by_volume(own, number, numbered(cell_tags, team)[0], nodes, team)


def _of_partitions(mesh: Any, team: Team) -> Dealt | None:
    """A file in partitions; ``mesh`` of the configuration."""
    from orchestrator.scene.mesh.files import read_share  # with it comes meshio

    read = agreed(lambda: read_share(Path(mesh.file), team.rank, team.size), team)
    if read is None:
        return None
    told = team.all_gather((read.volumes, list(read.mesh.surfaces), read.listed))
    volumes = sorted({volume for volumes, _, _ in told for volume in volumes})
    names, place = [name for _, name in volumes], {volume: i for i, volume in enumerate(volumes)}
    surfaces = dict.fromkeys(name for _, names, _ in told for name in names)
    own = np.array([place[volume] for volume in read.volumes], dtype=int)[read.mesh.volume]
    whole = replace(read.mesh, volume=own, volumes=names, surfaces=_with_all(read.mesh.surfaces, surfaces))
    try:
        check_whole([listed for _, _, every in told for listed in every], {number for number, _ in volumes}, Path(mesh.file))
        whole = finished(whole, mesh, "file")
    except InputError:  # on all of them
        return None
    number, nodes = numbered(read.node_tags, team)
    return _by_volume(whole, number, numbered(read.cell_tags, team)[0], nodes, team)


def _of_parts(parts: list[OnePart], team: Team) -> Dealt | None:
    """Parts, of which each rank makes some."""
    if len(parts) < team.size or any(part.mesh is None for part in parts):
        return None
    own = parts[team.rank * len(parts) // team.size : (team.rank + 1) * len(parts) // team.size]
    return _of_made(lambda: [placed(make_mesh(part.source)[0], part.name, part.move) for part in own], team)


def _of_made(make: Callable[[], list[Mesh]], team: Team) -> Dealt | None:
    """Meshes that share no nodes, of which each rank makes some."""
    made = agreed(make, team)
    if made is None or team.max(float(sum(len(mesh.nodes) for mesh in made)))[0] > MAX_NODES:
        return None
    told = team.all_gather([((len(mesh.nodes), len(mesh.cells), len(mesh.volumes)), mesh.hollow) for mesh in made])
    counts, every = zip(*(part for rank in told for part in rank))
    nodes, cells, volumes = np.array(counts)[: sum(len(rank) for rank in told[: team.rank])].sum(axis=0)
    mesh, names = joined(made), [name for part in every for name in part.volumes]
    if len(set(names)) < len(names):
        return None
    whole = replace(mesh, volume=mesh.volume + volumes, volumes=names,
                    surfaces=_with_all(mesh.surfaces, [name for part in every for name in part.surfaces]),
                    source=" + ".join(dict.fromkeys(part.source for part in every)),
                    remarks=list(dict.fromkeys(text for part in every for text in part.remarks)),
                    smooth={name: mesh.smooth.get(name, shape) for part in every for name, shape in part.smooth.items()})
    return _by_volume(whole, nodes + np.arange(len(mesh.nodes)), cells + np.arange(len(mesh.cells)), sum(count[0] for count in counts), team)


def _with_all(own: dict[str, np.ndarray], names: Any) -> dict[str, np.ndarray]:
    """Surfaces by all names, of which some have no triangles here."""
    return {name: own.get(name, np.empty((0, 3), dtype=int)) for name in names}

"""Meshes that ranks read or make in shares: bricks, files in partitions, grains, parts and solids meshed apart, some each; other files rank 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from orchestrator.config.mesh import OnePart
from orchestrator.config.model import Config
from orchestrator.errors import InputError
from orchestrator.parallel.numbering import numbered
from orchestrator.parallel.team import Team
from orchestrator.scene.mesh.faces import MAX_NODES
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.partitioned import check_whole, in_partitions
from orchestrator.scene.mesh.sources import finished, grid_of, joined, make_mesh, placed
from orchestrator.scene.partition import AXES, block_name, layers, slice_name
from orchestrator.scene.pieces.dealt import Dealt
from orchestrator.scene.pieces.share import Share

T = TypeVar("T")


def agreed(made: Callable[[], T], team: Team) -> T | None:
    """What each rank makes; None on all of them where any has found something wrong, or what hangs on others."""
    try:
        own = made()
    except InputError:
        own = None
    return None if team.max(float(own is None))[0] else own


def dealt(config: Config, team: Team) -> Dealt | None:
    """The configuration's mesh, each volume a subdomain, or cut in blocks; None, on all ranks, where they cannot make it together."""
    if config.mesh and (config.mesh.box or config.mesh.beam) and (config.subdomains.grid or config.subdomains.slices):
        return _of_bricks(config.mesh, config.subdomains, team)
    if not config.subdomains.groups or config.subdomains.split_above is not None:
        return None
    if config.parts is not None:
        return _of_parts(config.parts, team)
    if config.mesh.step and config.mesh.conforming is False:
        return _of_made(lambda: [make_mesh(config.mesh, share=(team.rank, team.size))[0]], team)
    if config.mesh.polycrystal:
        return _of_grains(config.mesh, team)
    if not config.mesh.file:
        return None
    divided = config.mesh.file and team.share(bool(in_partitions(Path(config.mesh.file))))
    return (_of_partitions if divided else _of_one)(config.mesh, team)


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
    return Dealt(Share(replace(made, volume=block, volumes=names), number, cells), int(np.prod(bricks.counts + 1)), team, bricks.name)


def _of_one(mesh: Any, team: Team) -> Dealt | None:
    """A file that rank 0 reads, and nobody keeps; ``mesh`` of the configuration."""
    read = agreed(lambda: False if team.rank else make_mesh(mesh)[0], team)
    if read is None:
        return None
    known = team.share(None if team.rank else replace(read, nodes=read.nodes[:0], cells=read.cells[:0], volume=read.volume[:0],
                                                      surfaces=_with_all({}, read.surfaces)))
    nodes, share = team.share(0 if team.rank else len(read.nodes)), known if team.rank else read
    return Dealt(Share(share, np.arange(len(share.nodes)), np.arange(len(share.cells))), nodes, team)


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
    return Dealt(Share(own, number, numbered(cell_tags, team)[0]), nodes, team)


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
    return Dealt(Share(whole, number, numbered(read.cell_tags, team)[0]), nodes, team)


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
    told = team.all_gather([(len(m.nodes), len(m.cells), m.volumes, list(m.surfaces), m.source, m.remarks,
                             {name: shape.of(slice(0)) for name, shape in m.smooth.items()}) for m in made])
    every, first = [part for rank in told for part in rank], sum(len(rank) for rank in told[: team.rank])
    counts = np.array([[nodes, cells, len(volumes)] for nodes, cells, volumes, *_ in every])
    nodes, cells, volumes = counts[:first].sum(axis=0)
    mesh, names = joined(made), [name for part in every for name in part[2]]
    if len(set(names)) < len(names):
        return None
    whole = replace(mesh, volume=mesh.volume + volumes, volumes=names,
                    surfaces=_with_all(mesh.surfaces, [name for part in every for name in part[3]]),
                    source=" + ".join(dict.fromkeys(part[4] for part in every)),
                    remarks=list(dict.fromkeys(text for part in every for text in part[5])),
                    smooth={name: mesh.smooth.get(name, shape) for part in every for name, shape in part[6].items()})
    return Dealt(Share(whole, nodes + np.arange(len(mesh.nodes)), cells + np.arange(len(mesh.cells))), int(counts[:, 0].sum()), team)


def _with_all(own: dict[str, np.ndarray], names: Any) -> dict[str, np.ndarray]:
    """Surfaces by all names, of which some have no triangles here."""
    return {name: own.get(name, np.empty((0, 3), dtype=int)) for name in names}

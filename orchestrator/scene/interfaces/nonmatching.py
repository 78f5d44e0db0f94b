"""Interfaces between parts whose faces lie opposite each other and whose nodes do not match."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orchestrator.scene.interfaces.distances import surface_gap
from orchestrator.scene.interfaces.facing import Facing, facing
from orchestrator.scene.interfaces.mortar.moving import whole_faces
from orchestrator.scene.interfaces.mortar.segments import FACING
from orchestrator.scene.interfaces.mortar.surfaces import Asked, Surfaces, facing_surfaces, slave_of, surfaces_of
from orchestrator.scene.interfaces.pairing import COINCIDE, Body, Patch
from orchestrator.scene.interfaces.proximity import may_face
from orchestrator.scene.interfaces.search import Search
from orchestrator.scene.interfaces.skins import Skin, Skins
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.geometry import local_size
from orchestrator.scene.model import Interface


def nonmatching(search: Search, pair: tuple[Body, Body], skins: Skins, patches: list[Patch], index: int) -> Iterator[Interface]:
    """Interfaces of two bodies across faces that do not match; none where all that lie opposite each other do.

    Where some match and others do not, all count as not matching: a corner that happens to fit is no reason for another
    interface. So they do where they are paired anew as they slide.

    patches : of faces that match
    index : of the governing entry
    """
    mesh, laws, problems = search.mesh, search.laws, search.problems
    within, opposite, follows = laws.reach(index), laws.opposite(index), laws.follows(index)
    names = [search.known(b) for b in pair]
    alone = list(_near(*pair, within))
    if patches and not follows:
        alone = [own[~np.isin(pack(body.triangles[own, :3], len(mesh.nodes)), _matched(patches, side, len(mesh.nodes)))]
                 for side, (body, own) in enumerate(zip(pair, alone))]
    if not may_face(*(body.normal[own] for body, own in zip(pair, alone)), opposite):
        return
    found = _facing(search, skins, pair, index)
    if not any(np.isin(f.facets[0], alone[0]).any() for f in found):
        return
    asked = Asked(laws.as_one(index), laws.slave(index, *names), max(FACING, opposite))
    if asked.slave is None and mesh.foreign and (quadratic := _quadratic(mesh, pair)) is not None:
        asked = replace(asked, slave=quadratic if asked.as_one else 1 - quadratic)
    chosen = _for_all_pieces(search, skins, pair, index, asked)
    if follows and (why := _rests(search, pair)):
        problems.add(("interfaces", index, "pairing"), f"follow between {names[0][0]} and {names[1][0]}, {why[0]}", *why[1:])
        return
    for patch in found:
        more = tuple(whole_faces(skins(b), own) for b, own in zip(pair, patch.facets)) if follows else None
        slave, surfaces = facing_surfaces(mesh.nodes, pair, patch.segments, search.matter, asked, chosen, more)
        if mesh.foreign and _same_nodes(surfaces):
            problems.warnings.append(f"all {len(surfaces.nodes[0])} nodes of {names[0][0]} | {names[1][0]} coincide, and faces between "
                                     "them are cut otherwise: forces are carried from face to face, not from node to node; "
                                     "give both sides the same faces")
        turn = slice(None, None, -1 if slave else 1)
        yield _interface(search, surfaces, [skins(body) for body in pair[turn]], names[turn], index)


def _facing(search: Search, skins: Skins, pair: tuple[Body, Body], index: int) -> list[Facing]:
    """Where two bodies lie on each other as an entry has it."""
    laws = search.laws
    return facing(skins(pair[0]), skins(pair[1]), laws.tolerance(index), laws.reach(index), laws.opposite(index), bool(laws.apart(index)))


def _rests(search: Search, pair: tuple[Body, Body]) -> tuple[str, str, str] | None:
    """Why two bodies cannot slide on each other, what could, and the cure."""
    if any(map(search.cut_further, pair)):
        return ("pieces of bodies that are cut further", "bodies in one piece each: a node has one piece to slide on",
                "leave split_above out, or write pairing: fixed")
    if any(stand.volume == b.volume for stand in search.mesh.foreign for b in pair):
        return ("of which one has a mesh that is not ours", "parts with meshes of ours: where nodes of another's have gone was not tried",
                "write pairing: fixed")
    return None


def _same_nodes(surfaces: Surfaces) -> bool:
    """Whether each node of either side coincides with one of the other's."""
    from scipy.spatial import cKDTree  # parts of other programs alone are asked

    one, two = surfaces.points
    near = COINCIDE * local_size(one, surfaces.triangles[0])
    return len(one) == len(two) and bool((cKDTree(two).query(one)[0] <= near).all())


def _quadratic(mesh: Mesh, pair: tuple[Body, Body]) -> int | None:
    """Which of two bodies is a part of quadratic elements whose mesh is not ours; None: neither, or both.

    Bonded it is the slave: its nodes' forces are then any, and its functions between nodes, which are not the triangles', are
    not asked for. Under a law that opens it is the master: uniform pressure is tension at the corners of its faces.
    """
    known = [any(stand.quadratic and stand.volume == b.volume for stand in mesh.foreign) for b in pair]
    return known.index(True) if sum(known) == 1 else None


def _for_all_pieces(search: Search, skins: Skins, pair: tuple[Body, Body], index: int, asked: Asked) -> int | None:
    """Which side is the slave, by all pieces of two bodies of which one is cut further; None: it is to be seen."""
    if asked.slave is not None or not any(map(search.cut_further, pair)):
        return asked.slave
    named = tuple(search.partition.body(b.subdomain) for b in pair)
    ordered = tuple(sorted(named))
    if ordered not in skins.slaves:
        pieces = [[b for b in skins.bodies if search.partition.body(b.subdomain) == name] for name in ordered]
        patches = [surfaces_of(search.mesh.nodes, (one, two), f.segments) for one in pieces[0] for two in pieces[1]
                   for f in _facing(search, skins, (one, two), index)]
        skins.slaves[ordered] = ordered[slave_of(patches, search.matter, asked)]
    return named.index(skins.slaves[ordered])


def _interface(search: Search, surfaces: Surfaces, skins: list[Skin], names: list[tuple[str, str]], index: int) -> Interface:
    interface = search.interface(tuple(skin.body.subdomain for skin in skins), surfaces.nodes, surfaces.triangles[0], surfaces.behind[0],
                                 surfaces=surfaces)
    distance = None
    if apart := search.laws.apart(index):
        bulge = tuple(skin.bulge_of(nodes[t]) for skin, nodes, t in zip(skins, surfaces.nodes, surfaces.triangles))
        distance = surface_gap(search, interface.name, surfaces, bulge, (index, apart))
    search.laws.apply(index, interface, names[0], distance)
    return interface


def _near(one: Body, two: Body, within: float | None) -> tuple[np.ndarray, np.ndarray]:
    """The facets of either body that come near the other's box."""
    room = within or 0.0
    (low, high), (other_low, other_high) = one.box, two.box
    return one.near(other_low - room, other_high + room), two.near(low - room, high + room)


def _matched(patches: list[Patch], side: int, nodes: int) -> np.ndarray:
    """Keys of the faces of one side that match."""
    found = [(p.opposite if side else p.triangles)[:, :3] for p in patches]
    return pack(np.concatenate([np.empty((0, 3), int), *found]), nodes)

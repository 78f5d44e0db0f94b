"""Interfaces between parts whose faces lie opposite each other and whose nodes do not match."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.facing import facing
from orchestrator.scene.interfaces.initial_gap import initial_gap
from orchestrator.scene.interfaces.mortar.assembly import corner_vectors, covered_around, make_mortar
from orchestrator.scene.interfaces.mortar.moving import Moving, whole_faces
from orchestrator.scene.interfaces.mortar.segments import FACING
from orchestrator.scene.interfaces.mortar.sides import Asked, Matter, facing_surfaces, slave_of, surfaces_of
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.pairing import Body, Patch
from orchestrator.scene.interfaces.proximity import may_face
from orchestrator.scene.interfaces.skins import Skin, Skins
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.model import Interface, Mesh
from orchestrator.scene.partition.numbering import SplitNumbering
from orchestrator.scene.partition.partition import Partition

# Areas around a node that differ by less than this are alike: the first piece of an interface has the point.
ALIKE = 1e-6


def nonmatching(mesh: Mesh, pair: tuple[Body, Body], skins: Skins, patches: list[Patch], partition: Partition,
                numbering: SplitNumbering, laws: Laws, index: int, matter: Matter, problems: Problems) -> Iterator[Interface]:
    """Interfaces of two bodies across faces that do not match; none where all that lie opposite each other do.

    Where some match and others do not, all count as not matching: a corner that happens to fit is no reason for another
    interface. So they do where they are paired anew as they slide.

    Parameters
    ----------
    patches : of faces that match
    index : of the governing entry
    """
    within, opposite, follows = laws.reach(index), laws.opposite(index), laws.follows(index)
    names = [(partition.names[b.subdomain], mesh.volumes[b.volume]) for b in pair]
    alone = list(_near(*pair, within))
    if patches and not follows:
        alone = [own[~np.isin(pack(body.triangles[own, :3], len(mesh.nodes)), _matched(patches, side, len(mesh.nodes)))]
                 for side, (body, own) in enumerate(zip(pair, alone))]
    if not may_face(*(body.normal[own] for body, own in zip(pair, alone)), opposite):
        return
    found = facing(skins(pair[0]), skins(pair[1]), laws.tolerance(index), within, opposite)
    if not any(np.isin(f.facets[0], alone[0]).any() for f in found):
        return
    asked = Asked(laws.as_one(index), laws.slave(index, *names), max(FACING, opposite))
    if asked.slave is None and asked.as_one and mesh.foreign:
        asked = replace(asked, slave=_quadratic(mesh, pair))
    chosen = _for_all_pieces(mesh, pair, skins, partition, laws, index, matter, asked)
    if follows and any(partition.body(b.subdomain) != partition.names[b.subdomain] for b in pair):
        problems.add(("interfaces", index, "pairing"), f"follow between {names[0][0]} and {names[1][0]}, pieces of bodies that are "
                     "cut further", "bodies in one piece each: a node has one piece to slide on",
                     "leave split_above out, or write pairing: fixed")
        return
    for patch in found:
        more = tuple(whole_faces(skins(b), own) for b, own in zip(pair, patch.facets)) if follows else None
        slave, surfaces = facing_surfaces(mesh.nodes, pair, patch.segments, matter, asked, chosen, more)
        turn = slice(None, None, -1 if slave else 1)
        yield _interface(surfaces, [skins(body) for body in pair[turn]], names[turn], numbering, laws, index, problems)


def _quadratic(mesh: Mesh, pair: tuple[Body, Body]) -> int | None:
    """Which of two bodies is a part of quadratic elements whose mesh is not ours: its nodes' forces are then any, and its
    functions between nodes, which are not the triangles', are not asked for. None: neither, or both."""
    known = [any(stand.quadratic and stand.volume == b.volume for stand in mesh.foreign) for b in pair]
    return known.index(True) if sum(known) == 1 else None


def _for_all_pieces(mesh: Mesh, pair: tuple[Body, Body], skins: Skins, partition: Partition, laws: Laws, index: int,
                    matter: Matter, asked: Asked) -> int | None:
    """Which side is the slave, by all pieces of two bodies of which one is cut further; None: it is to be seen."""
    named = tuple(partition.body(b.subdomain) for b in pair)
    if asked.slave is not None or named == tuple(partition.names[b.subdomain] for b in pair):
        return asked.slave
    ordered = tuple(sorted(named))
    if ordered not in skins.slaves:
        pieces = [[b for b in skins.bodies if partition.body(b.subdomain) == name] for name in ordered]
        patches = [surfaces_of(mesh.nodes, (one, two), f.segments) for one in pieces[0] for two in pieces[1]
                   for f in facing(skins(one), skins(two), laws.tolerance(index), laws.reach(index), laws.opposite(index))]
        skins.slaves[ordered] = ordered[slave_of(patches, matter, asked)]
    return named.index(skins.slaves[ordered])


def _interface(surfaces: Surfaces, skins: list[Skin], names: list[tuple[str, str]], numbering: SplitNumbering,
               laws: Laws, index: int, problems: Problems) -> Interface:
    sides = tuple(skin.body.subdomain for skin in skins)
    own = tuple(numbering.find(np.int64(i), nodes) - numbering.offsets[i] for i, nodes in zip(sides, surfaces.nodes))
    interface = Interface(-1, " | ".join(name for name, _ in names), sides, surfaces.nodes[0], own, surfaces.triangles[0],
                          surfaces.behind[0], np.ones((len(own[0]), 3), dtype=bool), surfaces=surfaces)
    distance = None
    if apart := laws.apart(index):
        bulge = tuple(skin.bulge_of(nodes[t]) for skin, nodes, t in zip(skins, surfaces.nodes, surfaces.triangles))
        distance = initial_gap(interface.name, surfaces, bulge, (index, apart), problems)
    laws.apply(index, interface, names[0], distance)
    return interface


def give_operators(interfaces: list[Interface], fixed: np.ndarray, numbering: SplitNumbering, bodies: list[str],
                   problems: Problems) -> None:
    """Makes the operators of all interfaces whose nodes do not match, once it is known what is prescribed.

    A slave's node carries one point at most. Where bodies are cut further, it has it in the piece of the interface in which
    most around it is covered; where interfaces of several bodies meet, it has none.

    Parameters
    ----------
    fixed : (N, 3) bool, prescribed components of split nodes
    bodies : name of the body of each subdomain
    """
    waiting = [i for i in interfaces if i.surfaces is not None]
    if not waiting:
        return
    group = [tuple(bodies[e] for e in i.subdomains) for i in waiting]
    alike = {pair: number for number, pair in enumerate(dict.fromkeys(map(frozenset, group)))}
    met = np.zeros((len(alike), numbering.total), dtype=bool)  # nodes of each pair of bodies
    covered = {pair: np.zeros(numbering.total) for pair in group}  # the largest covered area around slave nodes, by pieces
    leader = {pair: np.full(numbering.total, -1) for pair in group}
    vectors = {pair: np.zeros((numbering.total, 3)) for pair in group}
    for number, (i, pair) in enumerate(zip(waiting, group)):
        for nodes in i.surfaces.overlapping if i.law.follows else i.surfaces.nodes:
            met[alike[frozenset(pair)], nodes] = True
        nodes, area = i.surfaces.nodes[0], covered_around(i.surfaces)
        better = area > (1 + ALIKE) * covered[pair][nodes]
        covered[pair][nodes[better]], leader[pair][nodes[better]] = area[better], number
        vectors[pair][nodes] += corner_vectors(i.surfaces.points[0], i.surfaces.triangles[0])
    crossing, taken = met.sum(axis=0) > 1, np.zeros(numbering.total, dtype=bool)
    slides = np.full(numbering.total, -1)  # which interface has points on a node that follow the other side
    known = []
    for number, (i, pair) in enumerate(zip(waiting, group)):
        nodes = i.surfaces.nodes[0]
        joined = [k.global_nodes for k in interfaces if k.matching and sorted(k.subdomains) == sorted(i.subdomains)]
        others = leader[pair][nodes] != number if not i.law.follows else np.zeros(len(nodes), dtype=bool)  # in one piece
        crossed = crossing[nodes] | others | np.isin(nodes, np.concatenate([[-1], *joined]))
        free = tuple(~fixed[numbering.offsets[e] + own] for e, own in zip(i.subdomains, i.nodes))
        known.append((bool((crossed | ~free[0].all(axis=1)).all()), crossed, free))
    # small pieces on which no node is left come last, and take nodes that have no point yet
    for number in sorted(range(len(waiting)), key=lambda number: known[number][0]):
        i, (rest, crossed, free), nodes = waiting[number], known[number], waiting[number].surfaces.nodes[0]
        i.free, crossed = free[0], taken[nodes] if rest else crossed
        if i.law.follows:
            i.moving = Moving(i.surfaces, free, crossed)
            i.mortar = i.moving.first()
            if (slides[nodes] >= 0).any():
                other = waiting[int(slides[nodes].max())]
                problems.add(("interfaces", i.entry, "pairing"), f"follow: the same face of {bodies[i.subdomains[0]]} carries the points of "
                             f"{i.name} and of {other.name}", "a face of its own for each body that slides",
                             f"slave: {bodies[i.subdomains[1]]}, or pairing: fixed")
            slides[nodes] = number
        else:
            i.mortar = make_mortar(i.surfaces, i.law.perfect, free, crossed, vectors[group[number]][nodes])
        taken[nodes[i.mortar.points]] = True
    for i in waiting:
        i.surfaces = None


def _near(one: Body, two: Body, within: float | None) -> tuple[np.ndarray, np.ndarray]:
    """The facets of either body that come near the other's box."""
    room = within or 0.0
    (low, high), (other_low, other_high) = one.box, two.box
    return one.near(other_low - room, other_high + room), two.near(low - room, high + room)


def _matched(patches: list[Patch], side: int, nodes: int) -> np.ndarray:
    """Keys of the faces of one side that match."""
    found = [(p.opposite if side else p.triangles)[:, :3] for p in patches]
    return pack(np.concatenate([np.empty((0, 3), int), *found]), nodes)

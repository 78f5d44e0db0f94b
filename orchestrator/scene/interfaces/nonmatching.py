"""Interfaces between parts whose faces lie opposite each other and whose nodes do not match."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.facing import facing
from orchestrator.scene.interfaces.initial_gap import initial_gap
from orchestrator.scene.interfaces.mortar.assembly import make_mortar
from orchestrator.scene.interfaces.mortar.segments import FACING
from orchestrator.scene.interfaces.mortar.sides import Asked, Matter, facing_surfaces
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.pairing import Body, Patch
from orchestrator.scene.interfaces.proximity import may_face
from orchestrator.scene.interfaces.skins import Skin, Skins
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.model import Interface, Mesh
from orchestrator.scene.partition.numbering import SplitNumbering
from orchestrator.scene.partition.partition import Partition


def nonmatching(mesh: Mesh, pair: tuple[Body, Body], skins: Skins, patches: list[Patch], partition: Partition,
                numbering: SplitNumbering, laws: Laws, index: int, matter: Matter, problems: Problems) -> Iterator[Interface]:
    """Interfaces of two bodies across faces that do not match; none where all that lie opposite each other do.

    Where some match and others do not, all count as not matching: a corner that happens to fit is no reason for another
    interface.

    Parameters
    ----------
    patches : of faces that match
    index : of the governing entry
    """
    within, opposite = laws.reach(index), laws.opposite(index)
    names = [(partition.names[b.subdomain], mesh.volumes[b.volume]) for b in pair]
    alone = list(_near(*pair, within))
    if patches:
        alone = [own[~np.isin(pack(body.triangles[own, :3], len(mesh.nodes)), _matched(patches, side, len(mesh.nodes)))]
                 for side, (body, own) in enumerate(zip(pair, alone))]
    if not may_face(*(body.normal[own] for body, own in zip(pair, alone)), opposite):
        return
    found = facing(skins(pair[0]), skins(pair[1]), laws.tolerance(index), within, opposite)
    if not any(np.isin(f.facets[0], alone[0]).any() for f in found):
        return
    for patch in found:
        asked = Asked(laws.as_one(index), laws.slave(index, *names), max(FACING, opposite))
        slave, surfaces = facing_surfaces(mesh.nodes, pair, patch.segments, matter, asked)
        turn = slice(None, None, -1 if slave else 1)
        yield _interface(surfaces, [skins(body) for body in pair[turn]], names[turn], numbering, laws, index, problems)


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


def give_operators(interfaces: list[Interface], fixed: np.ndarray, numbering: SplitNumbering) -> None:
    """Makes the operators of all interfaces whose nodes do not match, once it is known what is prescribed.

    Parameters
    ----------
    fixed : (N, 3) bool, prescribed components of split nodes
    """
    waiting = [i for i in interfaces if i.surfaces is not None]
    if not waiting:
        return
    # a slave's node may carry one point: on edges where several such interfaces meet it carries none, unless there is no
    # other, as on small pieces of a body that is cut further
    met, taken = np.zeros(numbering.total, dtype=int), np.zeros(numbering.total, dtype=bool)
    for i in waiting:
        for nodes in i.surfaces.nodes:
            met[nodes] += 1
    known = []
    for i in waiting:
        joined = [k.global_nodes for k in interfaces if k.matching and sorted(k.subdomains) == sorted(i.subdomains)]
        crossed = (met[i.surfaces.nodes[0]] > 1) | np.isin(i.surfaces.nodes[0], np.concatenate([[-1], *joined]))
        free = tuple(~fixed[numbering.offsets[e] + own] for e, own in zip(i.subdomains, i.nodes))
        known.append((bool((crossed | ~free[0].all(axis=1)).all()), crossed, free))
    for number in sorted(range(len(waiting)), key=lambda number: known[number][0]):
        i, (rest, crossed, free) = waiting[number], known[number]
        i.free, i.mortar = free[0], make_mortar(
            i.surfaces, i.law.perfect, free, taken[i.surfaces.nodes[0]] if rest else crossed)
        taken[i.surfaces.nodes[0][i.mortar.points]] = True
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

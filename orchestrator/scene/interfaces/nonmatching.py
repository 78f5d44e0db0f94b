"""Interfaces between parts whose faces lie opposite each other and whose nodes do not match."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.curvature import smooth_faces
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.facing import Skin, facing
from orchestrator.scene.interfaces.mortar.assembly import make_mortar, node_gaps, point_normals, sagitta, weights_of
from orchestrator.scene.interfaces.mortar.segments import FACING
from orchestrator.scene.interfaces.mortar.sides import Asked, Matter, facing_surfaces
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.pairing import COINCIDE, OPPOSITE, REACH, Body, Patch
from orchestrator.scene.interfaces.proximity import may_face
from orchestrator.scene.mesh.faces import Faces, pack
from orchestrator.scene.mesh.patch import local_size
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.model import Interface, Mesh
from orchestrator.scene.partition.numbering import SplitNumbering
from orchestrator.scene.partition.partition import Partition


class Skins:
    """The outer faces of bodies and the surfaces they stand for, made when asked for."""

    def __init__(self, mesh: Mesh, faces: Faces):
        self.mesh, self.faces = mesh, faces
        self._made: dict[int, Skin] = {}

    def __call__(self, body: Body) -> Skin:
        if id(body) not in self._made:
            at = self._smooth[self.faces.find(body.triangles[:, :3])]
            self._made[id(body)] = Skin.of(body, self.mesh.nodes, at)
        return self._made[id(body)]

    @cached_property
    def _smooth(self) -> np.ndarray:
        return smooth_faces(self.mesh, self.faces)


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
    entry = laws.entries[index]
    tolerance = REACH if entry.apart else COINCIDE if entry.tolerance == "auto" else entry.tolerance
    opposite = OPPOSITE if entry.angle is None else -np.cos(np.deg2rad(entry.angle))
    names = [(partition.names[b.subdomain], mesh.volumes[b.volume]) for b in pair]
    alone = [own[~np.isin(pack(body.triangles[own, :3], len(mesh.nodes)), _matched(patches, side, len(mesh.nodes)))]
             for side, (body, own) in enumerate(zip(pair, _near(*pair, entry.reach)))]
    if not may_face(*(body.normal[own] for body, own in zip(pair, alone)), opposite):
        return
    found = facing(skins(pair[0]), skins(pair[1]), tolerance, entry.reach, opposite)
    if not any(np.isin(f.facets[0], alone[0]).any() for f in found):
        return
    for patch in found:
        slave, surfaces = facing_surfaces(mesh.nodes, pair, patch.segments, matter, Asked(laws.as_one(index), laws.slave(index, *names), max(FACING, opposite)))
        yield _interface(surfaces, pair[::-1] if slave else pair, names[::-1] if slave else names, numbering, laws,
                         index, problems)


def _interface(surfaces: Surfaces, pair: tuple[Body, Body], names: list[tuple[str, str]], numbering: SplitNumbering,
               laws: Laws, index: int, problems: Problems) -> Interface:
    sides = tuple(b.subdomain for b in pair)
    own = tuple(numbering.find(np.int64(i), nodes) - numbering.offsets[i] for i, nodes in zip(sides, surfaces.nodes))
    interface = Interface(-1, " | ".join(name for name, _ in names), sides, surfaces.nodes[0], own, surfaces.triangles[0],
                          surfaces.behind[0], np.ones((len(own[0]), 3), dtype=bool), surfaces=surfaces)
    apart = laws.apart(index)
    laws.apply(index, interface, names[0], _measured(interface, surfaces, (index, apart), problems) if apart else None)
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
    # a slave's node may carry one point: on edges where several such interfaces meet it carries none
    met = np.zeros(numbering.total, dtype=int)
    for i in waiting:
        for nodes in i.surfaces.nodes:
            met[nodes] += 1
    for i in waiting:
        joined = [k.global_nodes for k in interfaces if k.matching and sorted(k.subdomains) == sorted(i.subdomains)]
        crossed = (met[i.surfaces.nodes[0]] > 1) | np.isin(i.surfaces.nodes[0], np.concatenate([[-1], *joined]))
        free = tuple(~fixed[numbering.offsets[e] + own] for e, own in zip(i.subdomains, i.nodes))
        i.free, i.mortar, i.surfaces = free[0], make_mortar(i.surfaces, i.law.perfect, free, crossed), None


def _near(one: Body, two: Body, within: float | None) -> tuple[np.ndarray, np.ndarray]:
    """The facets of either body that come near the other's box."""
    room = within or 0.0
    (low, high), (other_low, other_high) = one.box, two.box
    return one.near(other_low - room, other_high + room), two.near(low - room, high + room)


def _matched(patches: list[Patch], side: int, nodes: int) -> np.ndarray:
    """Keys of the faces of one side that match."""
    found = [(p.opposite if side else p.triangles)[:, :3] for p in patches]
    return pack(np.concatenate([np.empty((0, 3), int), *found]), nodes)


def _measured(interface: Interface, surfaces: Surfaces, key: tuple[int, str], problems: Problems) -> np.ndarray:
    """(n₁,) initial gap at the slave's nodes; none where facets are in each other by less than they are off the curved
    surfaces that they stand for."""
    x1, x2 = surfaces.points
    weights = weights_of(surfaces, perfect=False)
    gap = node_gaps(surfaces, weights, point_normals(x1, surfaces.triangles[0]))
    beneath = sagitta(x2, surfaces.triangles[1])[surfaces.triangles[1][:, :3]].max(axis=1)  # of each master facet
    reached = np.zeros(len(x1))
    for corner in surfaces.triangles[0][:, :3].T:
        np.maximum.at(reached, corner[surfaces.segments.slave], beneath[surfaces.segments.master])
    allowed = sagitta(x1, surfaces.triangles[0]) + reached
    h = local_size(x1, surfaces.triangles[0])
    deep = gap < -(allowed + COINCIDE * h)
    if deep.any():
        worst = int(np.where(deep, gap, 0.0).argmin())
        problems.add(("interfaces", *key), f"{interface.name} penetrate each other in the initial geometry, at "
                     f"{deep.sum()} nodes by up to {-gap[worst]:.3g} at {format_point(x1[worst])}", "sides that touch or are "
                     f"apart; there, facets stand for a surface that is off them by {allowed[worst]:.3g} at most",
                     "move the parts, or ask for a press fit by a number: gap: -0.01")
    elif (chords := (gap < 0) & (gap < -COINCIDE * h)).any():
        problems.warnings.append(
            f"{interface.name}: facets are in each other by up to {-gap[chords].min():.3g}, less than they are off the curved "
            "surfaces that they stand for; this counts as touching")
    return np.where(np.abs(gap) <= COINCIDE * h * 1e-3, 0.0, np.maximum(gap, 0.0))

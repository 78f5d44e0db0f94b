"""Interfaces between parts whose faces lie opposite each other and whose nodes do not match."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.mortar.assembly import make_mortar, node_gaps, point_normals, sagitta, weights_of
from orchestrator.scene.interfaces.mortar.sides import Asked, Matter, facing_surfaces
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.pairing import COINCIDE, DEEP, REACH, Body, Patch
from orchestrator.scene.interfaces.proximity import TOUCHING, may_face
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.mesh.patch import local_size
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.model import Interface, Mesh
from orchestrator.scene.partition.numbering import SplitNumbering
from orchestrator.scene.partition.partition import Partition

# What is left over beside faces that match has to overlap by this share of a facet: less is where edges meet.
WORTH = 0.01


def nonmatching(mesh: Mesh, pair: tuple[Body, Body], patches: list[Patch], partition: Partition, numbering: SplitNumbering,
                laws: Laws, index: int, matter: Matter, problems: Problems) -> Iterator[Interface]:
    """Interfaces of two bodies across faces that do not match; none where all that lie opposite each other do.

    Where some match and others do not, all count as not matching: a corner that happens to fit is no reason for another
    interface.

    Parameters
    ----------
    patches : of faces that match
    index : of the governing entry
    """
    entry = laws.entries[index]
    names = [(partition.names[b.subdomain], mesh.volumes[b.volume]) for b in pair]
    asked = Asked(as_one=laws.as_one(index), reach=REACH if entry.apart else TOUCHING, depth=DEEP if entry.apart else TOUCHING,
                  within=entry.reach)
    near = _near(*pair, entry.reach)
    alone = [own[~np.isin(pack(body.triangles[own, :3], len(mesh.nodes)), _matched(patches, side, len(mesh.nodes)))]
             for side, (body, own) in enumerate(zip(pair, near))]
    if not may_face(pair[0].normal[alone[0]], pair[1].normal[alone[1]], asked.facing):
        return
    if patches and not any(_worth(s) for _, s in facing_surfaces(mesh.nodes, pair, tuple(alone), matter, asked)):
        return
    for slave, surfaces in facing_surfaces(mesh.nodes, pair, near, matter, asked):
        if _worth(surfaces):
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


def _worth(surfaces: Surfaces) -> bool:
    """Whether the sides have more in common than where edges cross."""
    found = surfaces.segments
    return bool(found.area.sum() > WORTH * surfaces.area.min())


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

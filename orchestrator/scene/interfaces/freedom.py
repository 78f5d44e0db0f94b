"""Components that boundary conditions leave free on interfaces, and the axis along which laws of
bolts act there.

A bolt's cut runs along faces of tets, a zigzag; the force that it carries and the jump of its sides
are along its axis all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.linalg import WRITTEN
from orchestrator.scene.interfaces.carrying import dragged, give_operators
from orchestrator.scene.interfaces.mortar.moving import paired_mortar
from orchestrator.scene.interfaces.governing import govern
from orchestrator.scene.interfaces.skins import surface_of
from orchestrator.scene.mesh.faces import edge_patches
from orchestrator.scene.mesh.geometry import (
    area_vectors, format_point, node_normals, node_vectors, unit)
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import PlacedBolt
from orchestrator.scene.bolts import BoltCut
from orchestrator.scene.conditions.boundary import Held
from orchestrator.scene.partition import Partition


def leave_free(mesh: Mesh, found: list[Interface], partition: Partition, numbering: SplitNumbering,
               held: Held, entries: list[Any], problems: Problems) -> list[Interface]:
    """The interfaces on which something is to be found, numbered, with ``free`` and the normals of
    whole bodies.

    Patches on which everything is prescribed on both sides are left out.

    found : all interfaces
    held : what is prescribed
    entries : of ``interfaces:`` in the YAML
    """
    kept: list[Interface] = []
    bodies, fixed = [partition.body(i) for i in range(len(partition.names))], held.fixed
    give_operators(found, held, numbering, bodies, problems)
    for interface in found:
        if interface.mortar is not None:
            if not len(interface.mortar):
                if not (interface.free.any() or interface.mortar.free.any()):
                    continue
                others = numbering.sides(interface)[1]
                other = "" if fixed[others].any(
                    axis=1).all() else f"slave: {partition.names[interface.subdomains[1]]}, "
                problems.add(("interfaces", interface.entry),
                             f"no node of {partition.names[interface.subdomains[0]]}, the slave of "
                             f"{interface.name}, is free: nothing would carry the interface",
                             "on one side, nodes on which boundary conditions leave the normal "
                             "free",
                             f"{other}more than one element across, or meshes that match")
        else:
            one, two = (fixed[own] for own in numbering.sides(interface))
            interface.free = ~(one & two)
            if not interface.free.any():
                continue
        interface.index = len(kept)
        kept.append(interface)
    for entry in sorted({i.entry for i in found} - {i.entry for i in kept}):
        if entry >= 0 and not entries[entry].kind.perfect:
            problems.add(("interfaces", entry, "law"),
                         f"{entries[entry].law}, where boundary conditions prescribe every node "
                         "on both sides",
                         "interfaces with nodes that are free to open or slip",
                         "hold the parts elsewhere, or leave the law out")
    _number_patches(kept)
    _share_normals(mesh, numbering, kept, bodies)
    for interface in kept:
        if interface.matching and not interface.law.perfect:
            _give_points(interface, mesh, numbering, held, problems)
    return kept


def _give_points(interface: Interface, mesh: Mesh, numbering: SplitNumbering, held: Held,
                 problems: Problems) -> None:
    """Give an interface whose nodes are paired its normals, what is free, and its points where
    these are middles of edges.
    """
    own = numbering.sides(interface)
    points = sum(mesh.nodes[numbering.nodes[side]] for side in own) / 2
    if interface.tool is None:  # which has normals of its own
        _curve(interface, points)
    normals = interface.normals
    if normals is None:
        normals = node_normals(points, interface.triangles)
    one, two = (held.fixed[side] for side in own)
    slides = dragged(interface, one & two, normals,
                     held.values[:, own[1]] - held.values[:, own[0]], problems)
    if not interface.amid:
        interface.free |= slides
        return
    interface.mortar = paired_mortar(
        points, interface.triangles, interface.cells, interface.normals,
        np.broadcast_to(interface.law.distance, len(points)), (one & ~slides, two))
    interface.free = ~one


def _curve(interface: Interface, points: np.ndarray) -> None:
    """Give an interface whose nodes are paired, at points (n, 3), the normals of the surfaces that
    its facets stand for, where these
    are known."""
    known = surface_of(points, interface.triangles, -1, interface.given).normals
    sure = np.zeros(len(points), bool)
    sure[interface.triangles[~np.isnan(known).any(axis=2)]] = True
    if sure.any():
        normals = unit(node_vectors(points, interface.triangles, interface.shares, known))
        interface.normals = normals if interface.normals is None else np.where(
            sure[:, None], normals, interface.normals)


def _number_patches(found: list[Interface]) -> None:
    """Adds "(patch 1)", "(patch 2)" … to the names of pairs that touch in several places."""
    by_pair: dict[tuple[int, int], list[Interface]] = {}
    for interface in found:
        by_pair.setdefault(interface.subdomains, []).append(interface)
    for group in by_pair.values():
        if len(group) > 1:
            for number, interface in enumerate(group, start=1):
                interface.name += f" (patch {number})"


def _share_normals(mesh: Mesh, numbering: SplitNumbering, interfaces: list[Interface],
                   bodies: list[str]) -> None:
    """Sets ``normals`` of all interfaces with a law between bodies of which one is cut further.

    At a node where pieces of one surface meet, each piece alone has another normal, and what may
    slide along one is stopped by the other. So the normals come from the surface as it is between
    the whole bodies.

    bodies : per subdomain, the name of its body; the pieces of a body follow one another
    """
    surfaces: dict[tuple[str, str], list[Interface]] = {}
    for i in interfaces:
        if not i.law.perfect and i.matching and i.tool is None:
            surfaces.setdefault(tuple(bodies[e] for e in i.subdomains), []).append(i)
    for pieces in surfaces.values():
        if len({i.subdomains for i in pieces}) > 1:
            _share(mesh, numbering, pieces)


def _share(mesh: Mesh, numbering: SplitNumbering, pieces: list[Interface]) -> None:
    ends = np.cumsum([0] + [len(i.triangles) for i in pieces])
    triangles = np.concatenate([i.global_nodes[i.triangles] for i in pieces])
    patch = edge_patches(triangles)[1]
    # a node in which two patches only touch has a normal in each of them
    keys, local = np.unique(patch[:, None] * np.int64(len(mesh.nodes)) + triangles,
                            return_inverse=True)
    points = np.empty((len(keys), 3))
    at = []
    for i, first in zip(pieces, ends[:-1]):
        at.append(np.searchsorted(keys, patch[first] * np.int64(len(mesh.nodes)) + i.global_nodes))
        points[at[-1]] = sum(mesh.nodes[numbering.nodes[own]] for own in numbering.sides(i)) / 2
    normals = unit(node_vectors(points, local.reshape(triangles.shape), pieces[0].shares))
    for i, own in zip(pieces, at):
        i.normals = normals[own]


def join_bolts(cuts: Sequence[BoltCut], interfaces: list[Interface], entries: Sequence[Any],
               factors: Sequence[Sequence[float]], problems: Problems) -> list[PlacedBolt]:
    """Give the interfaces at the cuts the law of their bolts.

    entries : of ``bolts``; factors : per entry (steps,) what multiplies it
    """
    placed = []
    for cut in cuts:
        sides = {(a, b) for a in cut.behind for b in cut.ahead} | {
            (b, a) for a in cut.behind for b in cut.ahead}
        found = [i for i in interfaces if i.subdomains in sides]
        if len(found) != 1:
            problems.add(("bolts", cut.index, "cut"),
                         f"a cut of {cut.name} that is in {len(found)} interfaces: between "
                         f"{len(cut.behind)} subdomains on one side and {len(cut.ahead)} on the "
                         "other",
                         "one subdomain on either side of the cut, and one piece of its section",
                         "leave bolts whole: write subdomains: groups, without split_above or "
                         "with a larger one; or move the plane")
            continue
        interface, = found
        govern(interface, entries[cut.index].law, factors[cut.index])
        interface.entry = -1
        axis = cut.axis if interface.subdomains[0] in cut.behind else -cut.axis
        placed.append(PlacedBolt(cut.name, interface, axis, cut.point, cut.index))
    return placed


def straighten(mesh: Mesh, interfaces: list[Interface], bolts: list[PlacedBolt],
               problems: Problems) -> list[PlacedBolt]:
    """Give interfaces of laws with an axis the same normal everywhere: the bolt's, or the mean of
    their own.

    Returns the bolts, and interfaces of such laws between parts as bolts of the interface's name
    """
    axes, others = {id(bolt.interface): bolt for bolt in bolts}, []
    for i in interfaces:
        if not i.law.axial:
            continue
        if not i.matching:
            problems.add(("interfaces", i.entry, "law"),
                         f"{i.law.name} on {i.name}, whose nodes do not match",
                         "sides that share faces, or have opposite ones with matching nodes",
                         "mesh both sides alike, or name a bolt under bolts:, which is cut where "
                         "it is meshed")
            continue
        bolt = axes.get(id(i))
        axis = area_vectors(mesh.nodes,
                            i.global_nodes[i.triangles]).sum(axis=0) if bolt is None else bolt.axis
        axis = axis / np.linalg.norm(axis)
        i.normals = np.tile(axis, (len(i.global_nodes), 1))
        if bolt is None:
            others.append(PlacedBolt(i.name, i, axis, mesh.nodes[i.global_nodes].mean(axis=0)))
        held = ~i.free & (np.abs(axis) > WRITTEN)
        if held.any():
            where = format_point(mesh.nodes[i.global_nodes[np.flatnonzero(held.any(axis=1))[0]]])
            problems.add(("interfaces", i.entry) if bolt is None else ("boundary",),
                         f"a support that holds {i.name} along the axis of its law, at {where}",
                         "sides that are free along the axis: both move by what the force asks for",
                         "hold the bolt elsewhere, or move the cut")
    return [*bolts, *others]

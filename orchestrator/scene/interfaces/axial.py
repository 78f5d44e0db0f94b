"""Interfaces whose law acts along one axis: the cuts of bolts, and others of such laws.

A cut runs along faces of tets, a zigzag; the force that it carries and the jump of its sides are along the bolt's axis all
the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import govern
from orchestrator.scene.mesh.geometry import area_vectors, format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface, PlacedBolt
from orchestrator.scene.bolts import BoltCut

ALONG = 1e-6  # share of the axis that a prescribed component may have


def join_bolts(cuts: Sequence[BoltCut], interfaces: list[Interface], entries: Sequence[Any],
               factors: Sequence[Sequence[float]], problems: Problems) -> list[PlacedBolt]:
    """Give the interfaces at the cuts the law of their bolts.

    entries : of ``bolts``; factors : per entry (steps,) what multiplies it
    """
    placed = []
    for cut in cuts:
        sides = {(a, b) for a in cut.behind for b in cut.ahead} | {(b, a) for a in cut.behind for b in cut.ahead}
        found = [i for i in interfaces if i.subdomains in sides]
        if len(found) != 1:
            problems.add(("bolts", cut.index, "cut"), f"a cut of {cut.name} that is in {len(found)} interfaces: between "
                         f"{len(cut.behind)} subdomains on one side and {len(cut.ahead)} on the other",
                         "one subdomain on either side of the cut, and one piece of its section",
                         "leave bolts whole: write subdomains: groups, without split_above or with a larger one; or move the plane")
            continue
        interface, = found
        govern(interface, entries[cut.index].law, factors[cut.index])
        interface.entry = -1
        axis = cut.axis if interface.subdomains[0] in cut.behind else -cut.axis
        placed.append(PlacedBolt(cut.name, interface, axis, cut.point))
    return placed


def straighten(mesh: Mesh, interfaces: list[Interface], bolts: list[PlacedBolt], problems: Problems) -> list[PlacedBolt]:
    """Give interfaces of laws with an axis the same normal everywhere: the bolt's, or the mean of their own.

    Returns the bolts, and interfaces of such laws between parts as bolts of the interface's name
    """
    axes, others = {id(bolt.interface): bolt for bolt in bolts}, []
    for i in interfaces:
        if not i.law.axial:
            continue
        if not i.matching:
            problems.add(("interfaces", i.entry, "law"), f"{i.law.name} on {i.name}, whose nodes do not match",
                         "sides that share faces, or have opposite ones with matching nodes",
                         "mesh both sides alike, or name a bolt under bolts:, which is cut where it is meshed")
            continue
        bolt = axes.get(id(i))
        axis = area_vectors(mesh.nodes, i.global_nodes[i.triangles]).sum(axis=0) if bolt is None else bolt.axis
        axis = axis / np.linalg.norm(axis)
        i.normals = np.tile(axis, (len(i.global_nodes), 1))
        if bolt is None:
            others.append(PlacedBolt(i.name, i, axis, mesh.nodes[i.global_nodes].mean(axis=0)))
        held = ~i.free & (np.abs(axis) > ALONG)
        if held.any():
            where = format_point(mesh.nodes[i.global_nodes[np.flatnonzero(held.any(axis=1))[0]]])
            problems.add(("interfaces", i.entry) if bolt is None else ("boundary",),
                         f"a support that holds {i.name} along the axis of its law, at {where}",
                         "sides that are free along the axis: both move by what the force asks for",
                         "hold the bolt elsewhere, or move the cut")
    return [*bolts, *others]

"""Many small models side by side in few: requests for a stiffness that are not worth a message each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.protocol import Model, Origin

# Nodes of one packet at the same place. FreeFEM's search tree gives up on more than eight; half of them, as
# nodes that differ by rounding may be taken for two places.
CROWD = 4
GRID = 1 << 21  # steps along each axis, by which places are told apart


def joined(models: Sequence[Model], count: int) -> list[tuple[Model, list[int]]]:
    """About ``count`` models per code that hold all the given ones together, of about equal size.

    Returns
    -------
    list of (joined model, indices of the models in it, in order)

    Notes
    -----
    Hundreds of tiny requests cost more in messages than in arithmetic; side by side they are one.
    Each model stays where it is, so that its stiffness is the same bit for bit whatever it is joined with, on
    any number of ranks, and for a sole also the same as within an extended subdomain: s − k w would show the
    rounding of another place. Of models that meet in a cross point, only so many are joined.
    """
    packets = []
    for members in _packets(models, count):
        parts = [models[i] for i in members]
        node_shift = np.cumsum([0] + [len(m.nodes) for m in parts])
        region_shift = np.cumsum([0] + [len(m.materials) for m in parts])
        packets.append((Model(
            name=f"{parts[0].name} … {parts[-1].name}",
            nodes=np.vstack([m.nodes for m in parts]),
            cells=np.vstack([m.cells + s for m, s in zip(parts, node_shift)]),
            region=np.concatenate([m.region + s for m, s in zip(parts, region_shift)]),
            materials=np.vstack([m.materials for m in parts]),
            fixed=np.vstack([m.fixed for m in parts]),
            trace=np.empty(0, int), code=parts[0].code, origin=Origin.side_by_side(parts),
        ), members))
    return packets


@dataclass(eq=False)
class _Packet:
    """Models that are to be joined: their indices, their tets, and how many of their nodes are at each point."""

    members: list[int]
    crowd: np.ndarray
    tets: int = 0


def _packets(models: Sequence[Model], count: int) -> list[list[int]]:
    """Indices of models of the same code, about ``count`` lists for each, in none of which nodes crowd."""
    codes, points, packets = np.array([m.code for m in models]), _points([m.nodes for m in models]), []
    beyond = max(own.max() for own in points) + 1
    for code in np.unique(codes):
        own = np.flatnonzero(codes == code).tolist()
        enough = sum(len(models[i].cells) for i in own) / count
        open_ones: list[_Packet] = []
        for i in own:
            packet = next((p for p in open_ones if p.crowd[points[i]].max() < CROWD), None)
            if packet is None:
                packet = _Packet([], np.zeros(beyond, np.int8))
                open_ones.append(packet)
                packets.append(packet.members)
            packet.members.append(i)
            packet.crowd[points[i]] += 1
            packet.tets += len(models[i].cells)
            if packet.tets >= enough:
                open_ones.remove(packet)
    return packets


def _points(clouds: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per cloud (n, 3) of nodes, the number (n,) of the point each is at: the same for nodes that coincide."""
    nodes = np.vstack(clouds)
    lowest, extent = nodes.min(axis=0), np.ptp(nodes, axis=0).max()
    cells = np.round((nodes - lowest) * ((GRID - 1) / extent)).astype(np.int64)
    points = np.unique(cells @ np.array([GRID**2, GRID, 1]), return_inverse=True)[1]
    return np.split(points, np.cumsum([len(c) for c in clouds])[:-1])

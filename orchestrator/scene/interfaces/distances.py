"""How far apart paired sides are before anything is loaded: as the geometry has it, down to the rounding of coordinates.

Sides that are in each other by less than a thousandth of the element size are pressed together by as much, and that is told;
deeper ones are refused: nobody is taken to have meant them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.pairing import COINCIDE
from orchestrator.scene.mesh.patch import local_size, node_normals
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface
from orchestrator.scene.partition.numbering import SplitNumbering
from orchestrator.scene.partition.partition import Partition

# Distances below this share of the element size, and of the coordinates, are rounding; from ``TOLD`` of it they are told.
ROUNDING, OF_COORDINATES, TOLD = 1e-9, 64 * np.finfo(float).eps, 1e-6
# Normals of one plane face differ by rounding alone.
PLANE = 1e-9


def paired_gap(mesh: Mesh, interface: Interface, others: np.ndarray, key: tuple[int, str], problems: Problems) -> np.ndarray:
    """(n,) distance along the normal of the sides of an interface whose nodes are paired, negative inside each other.

    Parameters
    ----------
    others : (n,) int, the nodes on side 2
    key : the entry of the YAML and what in it asks for the distance
    """
    one, two = mesh.nodes[interface.global_nodes], mesh.nodes[others]
    middle = (one + two) / 2
    gap = np.einsum("ij,ij->i", node_normals(middle, interface.triangles), two - one)
    h = local_size(middle, interface.triangles)
    deep = gap < -COINCIDE * h
    if deep.any():
        worst = int(gap.argmin())
        problems.add(("interfaces", *key), f"{interface.name} penetrate each other in the initial geometry, at "
                     f"{deep.sum()} nodes by up to {-gap[worst]:.3g} at {format_point(middle[worst])}", "sides that touch or are apart",
                     "move the parts, or ask for a press fit by a number: gap: -0.01")
    return np.where(np.abs(gap) <= rounding(middle, h), 0.0, gap)


def rounding(points: np.ndarray, h: np.ndarray) -> np.ndarray:
    """(n,) distances that coordinates of points (n, 3) and arithmetic leave open, where elements measure h (n,)."""
    return np.maximum(ROUNDING * h, OF_COORDINATES * np.abs(points).max(initial=0.0))


def tell_distances(mesh: Mesh, partition: Partition, numbering: SplitNumbering, found: Sequence[Interface], laws: Laws,
                   problems: Problems) -> None:
    """Warns, once per pair of bodies, where the geometry presses sides together, and where it has sides apart, or in each other,
    that count as touching because nothing is said of their gap."""
    worst: dict[tuple[bool, tuple[str, ...]], tuple[float, np.ndarray]] = {}
    for interface in found:
        read = bool(laws.apart(interface.entry))
        if not (read or laws.unread(interface.entry)):
            continue
        points = mesh.nodes[interface.global_nodes]
        gap = np.minimum(interface.law.distance, 0.0) if read else _apart(mesh, numbering, interface, points)
        h = local_size(points, interface.triangles)
        size = np.where(np.abs(gap) > np.maximum(TOLD * h, rounding(points, h)), np.abs(gap), 0.0)
        at, key = int(size.argmax()), (read, tuple(sorted(partition.body(e) for e in interface.subdomains)))
        if size[at] > abs(worst[key][0] if key in worst else 0.0):
            worst[key] = float(gap[at]), points[at]
    for (read, names), (gap, point) in worst.items():
        where = f"{abs(gap):.2g} {'apart' if gap > 0 else 'inside each other'} in the initial geometry, at {format_point(point)}, and "
        problems.warnings.append(f"{' | '.join(names)}: sides are up to {where}" + (
            "are pressed together by as much; gap: 0 takes them as touching" if read else
            "count as touching; gap: geometry reads the distance, gap: 0 says that they touch"))


def _apart(mesh: Mesh, numbering: SplitNumbering, interface: Interface, points: np.ndarray) -> np.ndarray:
    """(n,) distance along the normal of sides that count as touching; zero on curved faces that do not match: facets are
    apart there where their surfaces touch."""
    normal = node_normals(points, interface.triangles)
    if interface.surfaces is not None:
        from orchestrator.scene.interfaces.mortar.assembly import node_gaps, weights_of

        plane = np.abs(normal - normal[0]).max() <= PLANE
        return node_gaps(interface.surfaces, weights_of(interface.surfaces, quadratic=False), normal) if plane else np.zeros(len(points))
    others = numbering.nodes[numbering.offsets[interface.subdomains[1]] + interface.nodes[1]]
    return np.einsum("ij,ij->i", normal, mesh.nodes[others] - points)

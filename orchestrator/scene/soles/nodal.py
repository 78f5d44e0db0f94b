"""How much stiffer than its area says a sole of springs has to be at single nodes, where nodes do not couple.

What a spring serves at a node are all waves that move it. The longest, of the body's size L, meet E A/L, A being the
node's area on the interface. The shortest, the node alone, meet what matter there is behind it, E A'/h, A' being its area
on all interfaces of the body together: at an edge between grains each of them has but a part of what moves as one. The
geometric mean is E √(A A'/(h L)), that is √(A'/A) times E A/√(h L). A node of one interface is left as it is, and with it
uniform pressure between two blocks, which springs in proportion to their areas pass on without an error.

Beside a node that is prescribed all the yielding is the other side's: the spring that does as much is twice that of two
sides in series.
"""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.geometry import node_areas
from orchestrator.scene.model import Interface, Scene

WALL = 2.0  # beside a prescribed node


def stiffer(scene: Scene, interface: Interface, side: int) -> np.ndarray:
    """(n,) factor on a sole's stiffness at the nodes of side 0 (the first) or 1.

    1 where a node has no area, and where nodes do not match: there a point has many nodes behind it.
    """
    if not interface.matching:
        return np.ones(len(interface.nodes[side]))
    area = node_areas(scene.side_points(interface, side), interface.triangles)
    ends = [(scene.subdomains[e], nodes) for e, nodes in zip(interface.subdomains, interface.nodes)]
    total = 0.5 * sum(s.contact_area[nodes] for s, nodes in ends)
    factor = np.sqrt(np.divide(total, area, out=np.ones(len(area)), where=area > 0))
    one, two = (s.fixed[nodes] for s, nodes in ends)
    factor[(one != two).any(axis=1)] *= WALL
    return factor

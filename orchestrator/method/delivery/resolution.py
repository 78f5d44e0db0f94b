"""Contact that elements are too large for: places where neither pressures nor the estimated error of the mesh are to be believed.

Curved sides, or an edge on a face, meet in a place that grows with the force. Where it is hardly wider than a face, one mean gap keeps
sides apart, hardly any stress is there, and no estimate knows. A closed point i is at the border of its place where a point j beside it
is open by shape, its gap half or more what both differed by before anything was loaded,

    ½ gⱼ ≤ g₀ⱼ − g₀ᵢ

Plane sides that part have g₀ⱼ = g₀ᵢ: what is closed between them is no place of that kind, however few points it has, and stresses show
its border. A place is resolved where a share of its force is carried within.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.parallel.team import Team
from orchestrator.scene.model import Scene

WITHIN = 0.1  # share of the force that has to be carried within: by a round place some three faces across, by a long one two
CARRIES = 0.01  # of the largest force between two bodies, below which a place has no say in the error
ALIKE = 1e-9  # of the distance of two points, what rounding makes their first gaps differ by


def unresolved(scene: Scene, fields: InterfaceFields, team: Team) -> dict[str, tuple[int, int]]:
    """Pairs of bodies whose place of contact is not resolved at some load step → how many points carry it at the first such step, from 1,
    and that step; of all ranks' interfaces."""
    ends, shape = _beside(fields)
    names, number = np.unique([" | ".join(sorted(scene.subdomains[e].body for e in i.subdomains)) for i in scene.opening], return_inverse=True)
    pair = number[fields.index][fields.interface_of_node]
    forces, sums = np.maximum(fields.pressure, 0.0) * fields.areas, np.zeros((3, fields.steps, len(names)))
    for t, force in enumerate(forces):
        border = (force[ends[0]] > 0) & (force[ends[1]] == 0) & (fields.areas[t, ends[1]] > 0) & (fields.gap[t, ends[1]] <= 2 * shape)
        within = force.copy()
        within[ends[0, border]] = 0.0
        sums[:, t] = [np.bincount(pair, values, len(names)) for values in (force, within, force > 0)]
    (whole, carried, count), found = team.sum(sums)[0], {}
    for t, k in np.argwhere((whole > CARRIES * whole.max(initial=0.0)) & (carried < WITHIN * whole)):
        found.setdefault(str(names[k]), (int(count[t, k]), int(t) + 1))
    return found


def _beside(fields: InterfaceFields) -> tuple[np.ndarray, np.ndarray]:
    """(2, e) int, points beside each other, either way; (e,) by how much more the second's sides are apart by shape, −1 for no more."""
    edges = np.unique(np.sort(fields.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    ends = np.concatenate([edges, edges[:, ::-1]]).T
    (one, two), points = fields.initial_gap[ends], fields.points[0, ends]
    return ends, np.where(two - one > ALIKE * np.linalg.norm(points[1] - points[0], axis=1), two - one, -1.0)

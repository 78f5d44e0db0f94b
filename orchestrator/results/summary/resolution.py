"""Contact that elements are too large for, and pairs that stay as they are: sentences on places that are not resolved, where neither
pressures nor the estimated error of the mesh are to be believed, and on sides that have slid too far, see ``delivery.slid``.

Curved sides, or an edge on a face, meet in a place that grows with the force. Where it is hardly wider than a face, one mean gap keeps
sides apart, hardly any stress is there, and no estimate knows. A closed point i is at the border of its place where a point j beside it
is open by shape, its gap half or more what both differed by before anything was loaded,

    ½ gⱼ ≤ g₀ⱼ − g₀ᵢ

Plane sides that part have g₀ⱼ = g₀ᵢ: what is closed between them is no place of that kind, however few points it has, and stresses show
its border. A place is resolved where a share of its force is carried within.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.errors import some
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.model import Scene

WITHIN = 0.1  # share of the force that has to be carried within: by a round place some three faces across, by a long one two
CARRIES = 0.01  # of the largest force between two bodies, below which a place has no say in the error
ALIKE = 1e-9  # of the distance of two points, what rounding makes their first gaps differ by
FIFTH = 0.2  # of an element, slips beyond which are told; beyond the whole of it pairs no longer face each other
WRONG = 0.1  # share of pressures, by which curved sides that slide may have them wrong, from which they are told


def unresolved(scene: Scene, fields: InterfaceFields) -> Iterator[str]:
    """A sentence for pairs of bodies whose place of contact is not resolved at some load step."""
    ends, shape = _beside(fields)
    bodies = [" | ".join(sorted(scene.subdomains[e].body for e in pair)) for pair in fields.subdomains]
    names, number = np.unique(bodies, return_inverse=True)
    pair, found = number[fields.interface_of_node], {}
    forces = np.maximum(fields.pressure, 0.0) * fields.areas
    whole = np.stack([np.bincount(pair, force, len(names)) for force in forces])
    for t, force in enumerate(forces):
        border = (force[ends[0]] > 0) & (force[ends[1]] == 0) & (fields.areas[t, ends[1]] > 0) & (fields.gap[t, ends[1]] <= 2 * shape)
        within = force.copy()
        within[ends[0, border]] = 0.0
        carried = np.bincount(pair, within, len(names))
        for k in np.flatnonzero((whole[t] > CARRIES * whole.max()) & (carried < WITHIN * whole[t])):
            found.setdefault(str(names[k]), f"{names[k]} ({np.count_nonzero(force[pair == k])} points carry it at load step {t + 1})")
    if found:
        yield (f"the place of contact is hardly wider than a face: {some(list(found.values()))}; neither its pressures nor the estimated "
               "error of the mesh are to be believed there: make elements smaller")


def _beside(fields: InterfaceFields) -> tuple[np.ndarray, np.ndarray]:
    """(2, e) int, points beside each other, either way; (e,) by how much more the second's sides are apart by shape, −1 for no more."""
    edges = np.unique(np.sort(fields.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    ends = np.concatenate([edges, edges[:, ::-1]]).T
    (one, two), points = fields.initial_gap[ends], fields.points[0, ends]
    return ends, np.where(two - one > ALIKE * np.linalg.norm(points[1] - points[0], axis=1), two - one, -1.0)


def sliding(fields: InterfaceFields) -> Iterator[str]:
    """A sentence for those that slid by more than an element, by more than a fifth, and on curved faces by too much for these."""
    far, bent = slides(fields), dict(zip(fields.names.tolist(), fields.amiss.tolist()))
    if much := [name for name, share in far.items() if share > 1]:
        yield (f"{some(much)} slid by more than an element: node pairs do not follow, "
               "large sliding is outside small perturbations; between parts meshed each on its own contact has pairing: follow")
    if more := {name: share for name, share in far.items() if FIFTH < share <= 1}:
        yield (f"{some(sorted(more, key=more.get, reverse=True))} slid by up to {max(more.values()):.2g} of an element: node pairs do not "
               "follow, and forces act where they did before loading; between parts meshed each on its own contact has pairing: follow")
    if wrong := {name: share for name, far_ in far.items() if far_ <= 1 and (share := bent[name]) > WRONG}:
        yield (f"{some(sorted(wrong, key=wrong.get, reverse=True))} slid on curved faces that do not conform: pressures may be off by "
               f"{min(max(wrong.values()), 1.0):.0%} of the largest, as node pairs do not follow; between parts meshed each on its own "
               "contact has pairing: follow")


def slides(fields: InterfaceFields) -> dict[str, float]:
    """Interface → how far its sides have slid, in elements, where they hold; of those whose pairs stay as they are."""
    return {name: far for name, far in zip(fields.names.tolist(), fields.slid.tolist()) if far == far}

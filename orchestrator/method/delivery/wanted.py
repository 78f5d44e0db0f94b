"""Quantities to be certified: probes, as maps of nodes' displacements; other forces, by their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.errors import Refusal
from orchestrator.method.delivery.flux import FORCES, Carrier, Measured, Rim
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.conditions.probes import Point, Surface
from orchestrator.scene.copies import Copies
from orchestrator.scene.elasticity import strain, stress
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES, tet_functions
from orchestrator.scene.model import Scene, Subdomain

STRESS, RESULTANT = "stress", "resultant"  # quantities of probes
REACTIONS, BOLTS, SECTIONS, RESULTANTS = KINDS = ("reactions", "bolts", "sections", "resultants")


@dataclass(frozen=True)
class Wanted:
    """Quantities asked for.

    probes : name → what is asked of displacements; forces : name → what carries the forces of a probe
    carried : the same as ``forces`` of all such probes, certified or not; within : name → (k,) int, subdomains that carry them
    reactions : whether those are; entries : numbers of the entries of ``boundary`` that hold something then
    interfaces : numbers of the interfaces whose forces are
    about : (3,) what moments of reactions are about; length : of the scene
    bolts : name → number of the interface at its cut, and axis (3,)
    balanced : whether forces are to be in balance to rounding, though nothing is certified: an accuracy is asked for
    rims : name of a resultant → what others do at its rim, certified or not, where they do anything
    """

    probes: dict[str, Measured] = field(default_factory=dict)
    forces: dict[str, Measured] = field(default_factory=dict)
    reactions: bool = False
    entries: list[int] = field(default_factory=list)
    interfaces: list[int] = field(default_factory=list)
    about: np.ndarray = field(default_factory=lambda: np.zeros(3))
    length: float = 1.0
    bolts: dict[str, tuple[int, np.ndarray]] = field(default_factory=dict)
    balanced: bool = False
    rims: dict[str, list[Rim]] = field(default_factory=dict)
    carried: dict[str, Measured] = field(default_factory=dict)
    within: dict[str, np.ndarray] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.probes or self.forces or self.reactions or self.interfaces or self.bolts)

    @classmethod
    def of(cls, scene: Scene, names: Sequence[str], kinds: Sequence[str], about: Sequence[float], rank_of: np.ndarray | None = None,
           team: Team = ALONE) -> Wanted:
        """Quantities asked of a scene; of parts of it each rank gets what is on its own subdomains, and all ask together.

        names : of its probes, but for extremes and those along lines; kinds : of ``KINDS``
        about : a point, which moments of reactions are about
        rank_of : as of ``Copies``

        Raises Refusal: a probe in a part whose mesh is not ours
        """
        forced = [p for p in scene.probes if p.quantity in FORCES]
        asked = [p for p in scene.probes if p.name in names and p.quantity not in FORCES]
        copies = Copies.of(scene, rank_of, team) if forced or asked else None
        carriers = {p.name: Carrier(p, copies) for p in forced}
        probes = {p.name: _measured(copies, p) for p in asked}
        carried = {name: carrier.measured for name, carrier in carriers.items()}
        for name, probe in (probes | carried).items():
            if name in names and any(scene.subdomains[e].foreign for e in probe.weights):
                raise Refusal("certified in a foreign part", name=name)
        within = {name: np.flatnonzero(team.sum(np.bincount(list(probe.weights), minlength=len(scene.subdomains)))[0])
                  for name, probe in carried.items()}
        found = {p.name: carriers[p.name].rims() for p in forced if p.quantity == RESULTANT}
        return cls(probes, {name: probe for name, probe in carried.items() if name in names}, REACTIONS in kinds,
                   [b.index for b in scene.boundary if not b.forces and REACTIONS in kinds],
                   [i.index for i in scene.interfaces if (SECTIONS if i.law.perfect else RESULTANTS) in kinds],
                   np.array(about, dtype=float), scene.length,
                   {b.name: (b.interface.index, b.axis) for b in scene.bolts if BOLTS in kinds},
                   rims={name: rims for name, rims in found.items() if team.max(float(len(rims)))[0]}, carried=carried, within=within)

    def check(self, own: Sequence[Subdomain], blackbox: BlackBox) -> None:
        """Raises Refusal: a stress or a force in matter of a code's own, of which nobody knows the moduli.

        own : subdomains of this rank
        """
        for name, probe in (self.probes | self.forces).items():
            for s in own:
                if probe.matter and s.index in probe.weights and blackbox.traits(s.code).own_matter:
                    raise Refusal("certified stress in own matter", name=name)


def _measured(copies: Copies, probe: Point | Surface) -> Measured:
    """A probe's values as a map of nodes' displacements: of stresses the mean over the tet at a point, or over those behind faces."""
    scene, stress = copies.scene, STRESS in (getattr(probe, "of", ""), probe.quantity)
    if isinstance(probe, Point):  # whose tet may be another rank's
        cells = np.array([probe.cell]) if scene.cell_number is None else np.flatnonzero(copies.own & (scene.cell_number == probe.cell))
        local, share = np.arange(scene.mesh.cells.shape[1])[None], np.ones(len(cells))
        shape = tet_functions(probe.weights, scene.mesh.cells.shape[1])
    else:
        cells, local, shape = probe.cells, probe.corners, TRIANGLE_SHARES[probe.corners.shape[1]]
        share = np.linalg.norm(probe.area, axis=1) / probe.total
    given = np.zeros((scene.steps, 6 if stress else 3))
    if stress:
        local = np.broadcast_to(np.arange(scene.mesh.cells.shape[1]), (len(cells), scene.mesh.cells.shape[1]))
        each = share[:, None, None] * _stress_of_nodes(scene, cells)  # (6, k, n, 3)
        if scene.thermal is not None:
            lam, mu = scene.lame[cells].T
            given[:, :3] = -((share * (3 * lam + 2 * mu)) @ scene.thermal[:, cells].mean(axis=2).T)[:, None]
    else:
        each = np.einsum("k,n,ci->ckni", share, shape, np.eye(3))
    nodes = copies.cells[cells[:, None], local].ravel()
    given, = copies.meeting.team.sum(given)
    return Measured(Measured.at(copies, nodes, each.reshape(len(each), len(nodes), 3)), given, stress)


def _stress_of_nodes(scene: Scene, cells: np.ndarray) -> np.ndarray:
    """(6, k, 4 or 10, 3) mean stress of some cells (k,) by the displacement of each of their nodes."""
    size = scene.mesh.cells.shape[1]
    gradients, apart = shape_gradients(scene.mesh.nodes, scene.mesh.cells[cells, :4])[0], np.arange(len(cells) * size).reshape(-1, size)
    result = np.empty((6, len(cells), size, 3))
    for node in range(size):
        for component in range(3):
            u = np.zeros((apart.size, 3))
            u[apart[:, node], component] = 1.0
            result[:, :, node, component] = stress(strain(gradients, apart, u), scene.lame[cells]).T
    return result

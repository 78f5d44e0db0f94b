"""Displacements of every load step on the whole mesh, and the stresses that follow from them.

Stress has six components per cell, in VTK's order XX, YY, ZZ, XY, YZ, XZ. On ten-node tets it is
the cell's mean; the largest von Mises stress at the cell's nodes is beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from dataclasses import fields as dataclass_fields
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.extremes import Nodal
from orchestrator.scene import elasticity as recovery
from orchestrator.scene.copies import Copies
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.scene.mesh.quadratic import TET_EDGES
from orchestrator.scene.mesh.mesh import SplitNumbering, split_numbering

if TYPE_CHECKING:
    from orchestrator.method.delivery.interface_fields import InterfaceFields
    from orchestrator.scene.model import Scene


@dataclass(frozen=True)
class Fields:
    """Displacements of every load step on the undecomposed mesh, and what follows from them.

    nodes : (n, 3) float, in the order of the input mesh, mid-edge nodes last; cells : (m, 4 or 10)
        int, VTK's order
    subdomain : (m,) int
    lame : (m, 2), Lamé's λ and μ per cell; 0 of cells that stand for a part of another program, a
        ground or a rigid tool
    displacement : (steps, n, 3); where interfaces open, the mean over the subdomains that have the
        node
    sides : per subdomain (steps, n_E, 3) on its own nodes (``numbering``); None where nothing opens
    interfaces : fields of the interfaces that are not perfect, if there are any
    discretisation_error : (steps, m) estimate of it per cell, relative, energy norm; None where not
        estimated
    part : (m,) int, index into ``parts``, their names; one without a name where it is None
    joined : (N,) int, per node of ``numbering`` a label, equal where perfect interfaces make nodes
        one; None where nothing opens
    believed : (m,) bool, where stresses are those of the matter that was computed; None: everywhere
    thermal : (steps, m, 4) thermal strain at the cells' corners; None where nothing is heated
    """

    nodes: np.ndarray
    cells: np.ndarray
    subdomain: np.ndarray
    lame: np.ndarray
    displacement: np.ndarray
    sides: list[np.ndarray] | None = None
    interfaces: InterfaceFields | None = None
    discretisation_error: np.ndarray | None = None
    part: np.ndarray | None = None
    parts: tuple[str, ...] = ()
    joined: np.ndarray | None = None
    believed: np.ndarray | None = None
    thermal: np.ndarray | None = None

    @classmethod
    def of(cls, scene: Scene, displacement: np.ndarray, sides: list[np.ndarray] | None = None,
           *others: object,
           believed: np.ndarray | None = None) -> Fields:
        """Fields of a solved scene: ``displacement`` and the parameters after it as for the
        class.
        """
        joined = None if sides is None else Copies.of(scene).label
        return cls(scene.mesh.nodes, scene.mesh.cells, scene.cell_subdomain, shown_moduli(scene),
                   displacement, sides, *others,
                   part=scene.mesh.volume, parts=tuple(scene.mesh.volumes), joined=joined,
                   believed=believed, thermal=scene.thermal)

    @property
    def steps(self) -> int:
        return len(self.displacement)

    @cached_property
    def numbering(self) -> SplitNumbering:
        """The nodes of all subdomains, one subdomain after another."""
        return split_numbering(self.cells, self.subdomain, len(self.nodes))

    @cached_property
    def opened(self) -> Fields:
        """The same on a mesh whose subdomains share no nodes; these fields themselves where nothing
        opens.
        """
        if self.sides is None:
            return self
        split = self.numbering
        return replace(self, nodes=self.nodes[split.nodes], cells=split.corners, sides=None,
                       displacement=np.concatenate(self.sides, axis=1))

    @cached_property
    def nodal(self) -> Nodal:
        """Stresses at the nodes."""
        return Nodal(self)

    def with_error(self, cells: np.ndarray | None) -> Fields:
        """The same with an estimate of the discretisation error (steps, m), and with all that has
        been found of them.
        """
        result = replace(self, discretisation_error=cells)
        found = ("numbering", "material", "volumes", "_geometry", "nodal")
        vars(result).update({name: vars(self)[name] for name in found if name in vars(self)})
        return result

    def __getstate__(self) -> dict[str, object]:
        """Return what others cannot compute themselves."""
        return {field.name: getattr(self, field.name) for field in dataclass_fields(self)}

    def interface_displacement(self, side: int) -> np.ndarray:
        """(steps, N, 3) displacement of side 0 (the first) or 1 at the nodes of ``interfaces``."""
        i = self.interfaces
        return self.opened.displacement[:,
                                        self.numbering.find(i.subdomains[i.interface_of_node, side],
                                                            (i.nodes, i.others)[side])]

    @cached_property
    def _geometry(self) -> tuple[np.ndarray, np.ndarray]:
        return shape_gradients(self.nodes, self.cells)

    @cached_property
    def volumes(self) -> np.ndarray:
        """(m,) volumes of the cells."""
        return self._geometry[1]

    @cached_property
    def material(self) -> np.ndarray:
        """(m,) int: cells of equal λ and μ share a number."""
        if (self.lame == self.lame[:1]).all():
            return np.zeros(len(self.lame), dtype=int)
        pairs = np.ascontiguousarray(self.lame).view(np.complex128).ravel()
        return np.unique(pairs, return_inverse=True)[1].ravel()

    def stress(self, step: int) -> np.ndarray:
        """(m, 6) mean stress of the cells at one load step."""
        epsilon = recovery.strain(self._geometry[0], self.cells, self.displacement[step])
        return recovery.stress(self._elastic(epsilon, step, recovery.CENTRE), self.lame)

    def _elastic(self, epsilon: np.ndarray, step: int, at: np.ndarray) -> np.ndarray:
        """Strains (m, 6) at barycentric coordinates (4,) without what matter expands by itself."""
        if self.thermal is not None:
            epsilon[:, :3] -= (self.thermal[step] @ at)[:, None]
        return epsilon

    def von_mises(self, step: int) -> np.ndarray:
        """(m,) von Mises stress of the mean stress at one load step."""
        return recovery.von_mises(self.stress(step))

    def corner_stress(self, step: int) -> np.ndarray:
        """(m, 4, 6) stress in the cells' corners, each cell by itself: what is largest in a
        ten-node tet is there.
        """
        if self.cells.shape[1] == 4:
            return np.broadcast_to(self.stress(step)[:, None], (len(self.cells), 4, 6))
        strains = (
            self._elastic(recovery.strain(self._geometry[0], self.cells, self.displacement[step],
                                          at), step, at) for at in np.eye(4))
        return np.stack([recovery.stress(epsilon, self.lame) for epsilon in strains], axis=1)

    def nodal_von_mises(self, step: int) -> np.ndarray:
        """(m, 4 or 10) von Mises stress at the cells' nodes, each cell by itself."""
        if self.cells.shape[1] == 4:
            return np.broadcast_to(self.von_mises(step)[:, None], self.cells.shape)
        corners = self.corner_stress(step)
        return recovery.von_mises(np.concatenate([corners, corners[:, TET_EDGES].mean(axis=2)],
                                                 axis=1))


def shown_moduli(scene: Scene) -> np.ndarray:
    """(m, 2) Lamé's λ and μ per cell, as in ``Fields``."""
    if not scene.stand_ins.any():
        return scene.lame
    return np.where(scene.stand_ins[scene.cell_subdomain][:, None], 0.0, scene.lame)

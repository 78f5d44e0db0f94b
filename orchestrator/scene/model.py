"""Parts of a scene: a mesh, its subdomains, their interfaces.

Indices are zero-based. Lengths, forces and moduli are in the user's units.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.elasticity import lame
from orchestrator.scene.interface import Beside, Interface, Overview
from orchestrator.scene.loads.base import Forces, Ground, Prescribed
from orchestrator.scene.mesh.geometry import tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.tools.motion import Rigid


@dataclass
class Subdomain:
    """One part of the decomposition, in its own numbering.

    index, name : position in ``Scene.subdomains`` and a name for messages
    cells : (m_E,) int, global cell indices
    nodes : (n_E,) int, sorted global node ids; local node l is global node nodes[l]
    connectivity : (m_E, 4 or 10) int, local node indices
    material : (m_E,) int, index into ``Scene.materials``
    fixed : (n_E, 3) bool, prescribed displacement components
    prescribed : (steps, n_E, 3) float, their values (zero elsewhere)
    loads : (steps, n_E, 3) float, consistent nodal forces of tractions, pressures, body forces
    held_by : (n_E, 3) int, entry of ``boundary`` that prescribes each component, −1 for none
    code : index of the entry of the YAML's ``blackbox`` that solves it
    contact_area : (n_E,) float, area of its interfaces that are not perfect, all of them together
    body : name of the body that it is a piece of; its own where bodies are not cut further
    heated : whether its loads have thermal strain of the YAML's matter among them
    foreign : its cells stand for a part whose mesh is not ours
    remembers : whether its matter is nonlinear and remembers load steps
    """

    index: int
    name: str
    cells: np.ndarray
    nodes: np.ndarray
    connectivity: np.ndarray
    material: np.ndarray
    fixed: np.ndarray
    prescribed: np.ndarray
    loads: np.ndarray
    held_by: np.ndarray
    code: int = 0
    contact_area: np.ndarray = field(default_factory=lambda: np.zeros(0))
    body: str = ""
    heated: bool = False
    foreign: bool = False
    remembers: bool = False

    def __post_init__(self) -> None:
        self.body = self.body or self.name


@dataclass(frozen=True)
class Material:
    """Isotropic linear elasticity: Young's modulus (force/length²), Poisson's ratio, thermal strain
    per temperature.
    """

    young: float
    poisson: float
    expansion: float = 0.0

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé's λ and μ."""
        return lame(self.young, self.poisson)


@dataclass
class BoundaryEntry:
    """One resolved entry of ``boundary:`` in the YAML.

    index : position in the list
    kind : its name, for messages
    triangles : (k, 3 or 6) int, global node ids of the selected boundary faces, outward oriented
    cells : (k, 2) int, the tet each face belongs to, and the one behind it, −1 on the outer
        boundary
    nodes : (p,) int, global ids of all nodes on those faces
    does : what acts there; forces are those of its faces
    drives : the rigid tool that it drives; such entries come after those of the YAML, and are none
        of them
    """

    index: int
    kind: str
    triangles: np.ndarray
    cells: np.ndarray
    nodes: np.ndarray
    does: Forces | Prescribed | Ground
    drives: Rigid | None = None

    @property
    def name(self) -> str:
        """In messages: its place, or what it drives."""
        return self.drives.name if self.drives else f"boundary[{self.index}]"

    @property
    def forces(self) -> Forces | None:
        """Its forces, if it loads the faces."""
        return self.does if isinstance(self.does, Forces) else None

    @property
    def prescribed(self) -> Prescribed | None:
        """The displacements that it prescribes, if it does."""
        return self.does if isinstance(self.does, Prescribed) else None

    @property
    def ground(self) -> Ground | None:
        """Return what is behind the faces, if they stand on something."""
        return self.does if isinstance(self.does, Ground) else None

    def of(self, faces: np.ndarray) -> BoundaryEntry:
        """The entry on some of its faces, indices or bool."""
        triangles = self.triangles[faces]
        return replace(self, triangles=triangles, cells=self.cells[faces],
                       nodes=np.unique(triangles),
                       does=self.forces.of(faces) if self.forces else self.does)


@dataclass(frozen=True)
class PlacedBolt:
    """A bolt of the YAML, cut.

    name : of its volume
    interface : at the cut
    axis : (3,) unit vector along which it pulls, from side 1 to side 2 of the interface
    point : (3,) where the cut meets the axis, or any point of the plane
    entry : position in the YAML's ``bolts``, −1 of an interface with the law of one
    """

    name: str
    interface: Interface
    axis: np.ndarray
    point: np.ndarray
    entry: int = -1


@dataclass
class Scene:
    """Everything the method needs to know of the problem.

    name : of the configuration
    mesh : the undecomposed mesh
    cell_subdomain : (m,) int
    cell_material : (m,) int, index into ``materials``
    materials, subdomains, interfaces, boundary : lists
    fixed : (n, 3) bool and prescribed : (steps, n, 3), the boundary conditions on global nodes; a
        node that several bodies share where interfaces open is fixed if it is in one of them
    loads : (steps, n, 3), consistent nodal forces on global nodes
    steps : number of load steps
    warnings : sentences on what is no error but may be meant otherwise
    near : pairs of volumes with faces opposite each other, within reach, that belong to no
        interface; and what is said of each
    covered : (entries of ``boundary``, volumes) int, how many faces that an entry loads lie on
        another part
    sagitta : of these volumes, where they are all there, how far surfaces are off their outer
        faces, see ``interfaces.overlap``
    bolts : those that are cut
    probes : what is asked for, see ``conditions.probes``; the whole scene has them
    element : which one was chosen, and why, where that was left open, see ``mesh.quadratic``
    thermal : (steps, m, 4) α ΔT at the corners of every cell; None where nothing is heated
    body_force : (steps, m, 1 or 4, 3) force/volume of every cell, at its corners where it varies;
        None where there is none
    overview : of the whole scene, where this is a part of it
    number : (n,) int, ascending, the nodes' numbers in the whole scene, where this is a part of it
    brought : whether models of its codes have, or may have, loads of their own that are not in
        ``loads``
    """

    name: str
    mesh: Mesh
    cell_subdomain: np.ndarray
    cell_material: np.ndarray
    materials: list[Material]
    subdomains: list[Subdomain]
    interfaces: list[Interface]
    boundary: list[BoundaryEntry]
    fixed: np.ndarray
    prescribed: np.ndarray
    loads: np.ndarray
    steps: int
    warnings: list[str] = field(default_factory=list)
    near: dict[tuple[int, int], Beside] = field(default_factory=dict)
    sagitta: dict[int, np.ndarray] = field(default_factory=dict)
    bolts: list[PlacedBolt] = field(default_factory=list)
    thermal: np.ndarray | None = None
    overview: Overview | None = None
    number: np.ndarray | None = None
    probes: list = field(default_factory=list)
    element: object = None
    body_force: np.ndarray | None = None
    brought: bool = False
    covered: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), dtype=int))

    def side_nodes(self, interface: Interface, side: int) -> np.ndarray:
        """(n,) global ids of an interface's nodes on side 0 (the first) or 1."""
        return self.subdomains[interface.subdomains[side]].nodes[interface.nodes[side]]

    def side_points(self, interface: Interface, side: int) -> np.ndarray:
        """(n, 3) where an interface's nodes are on side 0 (the first) or 1."""
        return self.mesh.nodes[self.side_nodes(interface, side)]

    def points(self, interface: Interface) -> np.ndarray:
        """(n, 3) where an interface is: halfway between its sides, which gives normals and areas
        without a favourite.

        Where they do not match it is on side 1.
        """
        if not interface.paired:
            return self.side_points(interface, 0)
        return 0.5 * (self.side_points(interface, 0) + self.side_points(interface, 1))

    @cached_property
    def lame(self) -> np.ndarray:
        """(m, 2) float, Lamé's λ and μ of each cell."""
        return np.array([material.lame for material in self.materials])[self.cell_material]

    @property
    def used(self) -> np.ndarray:
        """(k,) int, ascending, the materials that some cell has."""
        return np.unique(self.cell_material)

    @property
    def opening(self) -> list[Interface]:
        """Those of its interfaces that are not perfect."""
        return [i for i in self.interfaces if not i.law.perfect]

    @property
    def length(self) -> float:
        """Half the diagonal of the box around all nodes."""
        return 0.5 * float(
            np.linalg.norm(np.ptp(self.mesh.box if self.overview is None else self.overview.box,
                                  axis=0)))

    @property
    def matched(self) -> np.ndarray:
        """(interfaces,) bool, whether the points of each are pairs of nodes."""
        if self.overview is not None:
            return self.overview.matched
        return np.array([i.mortar is None for i in self.interfaces], dtype=bool)

    @property
    def prints(self) -> np.ndarray:
        """(subdomains, 32) uint8, hash of the nodes and cells of each: whether another scene has
        the same mesh, cut alike.
        """
        made = [hashlib.sha256(np.ascontiguousarray(self.mesh.nodes[s.nodes]).tobytes()
                               + np.ascontiguousarray(s.connectivity).tobytes())
                for s in self.subdomains]
        return np.frombuffer(b"".join(each.digest() for each in made), np.uint8).reshape(-1, 32)

    @property
    def conforming(self) -> bool:
        """Whether all is bonded, subdomains that share a node share it on an interface, and no
        others meet: one elastic body of one mesh, cut."""
        if self.overview is not None:
            return self.overview.conforming
        sides = [(self.side_nodes(i, 0), self.side_nodes(i, 1)) for i in self.interfaces]
        if not sides or not self.bonded or any(s.foreign or s.remembers for s in self.subdomains):
            return False
        if not all(i.matching and np.array_equal(*both) for i, both in zip(self.interfaces, sides)):
            return False
        on = np.unique(np.concatenate([e * len(self.mesh.nodes) + one for i, (one, _) in zip(
            self.interfaces, sides) for e in i.subdomains]))
        return len(on) == self.shared.nnz

    @cached_property
    def shared(self) -> sp.csr_array:
        """(nodes, subdomains) whose elements have a node; empty rows where they are one's alone."""
        cells, count = self.mesh.cells, len(self.subdomains)
        of = np.broadcast_to(self.cell_subdomain[:, None], cells.shape)
        shape = len(self.mesh.nodes), count
        low, high = np.full(shape[0], count), np.full(shape[0], -1)
        np.minimum.at(low, cells, of)
        np.maximum.at(high, cells, of)
        there = (low < high)[cells]
        node, subdomain = np.divmod(np.unique(cells[there] * count + of[there]), count)
        return sp.csr_array((np.ones(len(node)), (node, subdomain)), shape=shape)

    @property
    def bonded(self) -> bool:
        """Whether all interfaces are perfect."""
        return all(i.law.perfect for i in self.interfaces)

    @property
    def remembers(self) -> bool:
        """Whether the matter of some subdomain is nonlinear and remembers load steps."""
        return any(s.remembers for s in self.subdomains)

    @cached_property
    def moduli(self) -> np.ndarray:
        """(materials, 2) float, E and ν of each."""
        return np.array([[m.young, m.poisson] for m in self.materials]).reshape(-1, 2)

    @cached_property
    def stand_ins(self) -> np.ndarray:
        """(subdomains,) bool, those that have no matter of the scene's: grounds, rigid tools, parts
        of other programs.
        """
        behind = [i.subdomains[1] for i in self.interfaces if i.tool is not None or i.ground]
        return np.isin(np.arange(len(self.subdomains)),
                       behind) | np.array([s.foreign for s in self.subdomains], dtype=bool)

    @cached_property
    def sizes(self) -> np.ndarray:
        """(subdomains,) cube root of each subdomain's volume, a length."""
        if self.overview is not None:
            return self.overview.sizes
        volume = np.abs(tet_volumes(self.mesh.nodes, self.mesh.cells))
        sizes = np.cbrt(np.bincount(self.cell_subdomain, weights=volume,
                                    minlength=len(self.subdomains)))
        for stand in self.mesh.foreign:
            sizes[np.unique(self.cell_subdomain[self.mesh.volume == stand.volume])] = stand.size
        return sizes

    def __repr__(self) -> str:
        return (
            f"Scene({self.name}: {len(self.subdomains)} subdomains, {len(self.interfaces)} "
            f"interfaces, {3 * len(self.mesh.nodes)} dofs, {self.steps} load steps)")

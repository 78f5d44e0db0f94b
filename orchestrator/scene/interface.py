"""Interfaces: patches of faces where two subdomains meet, with what acts there.

Knowledge of a whole scene where a part of it is at hand: numbers per subdomain and
interface, what is difficult, what is near.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from orchestrator.laws.base import Law
from orchestrator.laws.perfect import Perfect
from orchestrator.scene.interfaces.mortar.moving import Moving
from orchestrator.scene.interfaces.mortar.operators import Mortar
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.mesh.quadratic import (
    CORNER_SHARES, LUMPED_SHARES, QUARTERS, TRIANGLE_SHARES)
from orchestrator.scene.tools.motion import Rigid


@dataclass
class Interface:
    """One connected patch of faces shared by two subdomains, or of opposite faces whose nodes are
    paired; or nodes that two subdomains share where no faces hold them together, without triangles;
    and what acts there. Where the sides are meshed each on its own, what is said of nodes,
    triangles and free components is said of side 1, the slave, and so are, per node, the law's
    parameters.

    index, name : position in ``Scene.interfaces`` and a name for messages
    subdomains : (E1, E2), indices of the two sides
    global_nodes : (n,) int, global node ids of the patch on side 1, ascending; on side 2 they are
        the same unless the sides share no faces, see ``Scene.side_nodes``
    nodes : two (n,) int arrays, local node indices in E1 and E2, paired unless there is a
        ``mortar``
    triangles : (k, 3 or 6) int, indices into the patch's nodes, the corners first, oriented outward
        of E1
    cells : (k, 2) int, global cells behind each triangle, in E1 and in E2
    free : (n, 3) bool, components that boundary conditions do not prescribe on both sides; where
        they do on one, the other meets what is prescribed there
    law : the interface law, with its parameters
    normals : (n, 3) unit normals from E1 to E2, where more than the patch's facets shape them: it
        is a piece of a larger one between bodies that are cut further, or their surface is known
    given : (k, 3 or 6, 3) those of the surfaces at the triangles' nodes, where a CAD model knows
        some of them and nodes of two bodies are paired, nan where they are not known
    called : names by which an entry of ``interfaces`` may call either side
    entry : position in the YAML's ``interfaces`` of the entry that governs it, −1 for none
    mortar : points and transfer operators between sides that do not match; None where nodes are
        paired
    surfaces : what the operators are made of, until they are: boundary conditions have a say in it
    law_at_steps : the law at every load step, where its parameters differ between them, and ``law``
        is the one that asks for most; else empty
    moving : what they are made of anew where the sides have slid to, if they are
    tool : the rigid tool that side 2 is, if it is one
    ground : whether side 2 is a rigid ground, and the law that of one
    follows : the sides are paired anew as they slide, load step after load step
    """

    index: int
    name: str
    subdomains: tuple[int, int]
    global_nodes: np.ndarray
    nodes: tuple[np.ndarray, np.ndarray]
    triangles: np.ndarray
    cells: np.ndarray
    free: np.ndarray
    law: Law = field(default_factory=Perfect)
    normals: np.ndarray | None = None
    given: np.ndarray | None = None
    called: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    entry: int = -1
    mortar: Mortar | None = None
    surfaces: Surfaces | None = None
    law_at_steps: list[Law] = field(default_factory=list)
    moving: Moving | None = None
    tool: Rigid | None = None
    ground: bool = False
    follows: bool = False

    def govern(self, laws: list[Law], vary: bool) -> None:
        """Give it the law of every load step, of which one holds for all unless they ``vary``."""
        self.law = max(laws, key=lambda law: law.imposed)
        self.law_at_steps = laws if vary else []

    @property
    def has_history(self) -> bool:
        """Whether the answer depends on earlier load steps."""
        return self.follows or not self.law.convex

    @property
    def matching(self) -> bool:
        """Whether its points are pairs of nodes."""
        return self.mortar is None and self.surfaces is None

    @property
    def paired(self) -> bool:
        """Whether its nodes are paired, if not its points, see ``mortar.paired``."""
        return self.matching or self.mortar is not None and self.mortar.paired

    @property
    def amid(self) -> bool:
        """Whether its points are the nodes in the middle of the edges of six-node faces."""
        return self.triangles.shape[1] == 6 and not self.law.as_one

    @property
    def shares(self) -> np.ndarray:
        """(3 or 6,) of a facet's area that a law acts on at each of its nodes."""
        unpaired = LUMPED_SHARES if self.matching else CORNER_SHARES
        return (TRIANGLE_SHARES if self.amid else unpaired)[self.triangles.shape[1]]

    @property
    def shown_shares(self) -> np.ndarray:
        """(3 or 6,) the same at the nodes that fields are told at."""
        return (TRIANGLE_SHARES if self.amid else CORNER_SHARES)[self.triangles.shape[1]]

    @property
    def shown(self) -> np.ndarray:
        """(c,) int, ascending, the nodes that fields are told at: corners, and middles of edges
        where these are the points.
        """
        return np.unique(self.shown_triangles)

    @property
    def shown_triangles(self) -> np.ndarray:
        """(m, 3) int, triangles between these: a quarter of a face each where middles of edges are
        shown.
        """
        return self.triangles[:, QUARTERS].reshape(-1, 3) if self.amid else self.triangles[:, :3]

    def traced(self, side: int) -> np.ndarray:
        """(n, 3) bool, the components of the nodes on side 0 or 1 that have trace dofs: where
        points are no pairs, all of them,
        so that the other side meets what is prescribed."""
        return self.free if self.mortar is None else np.ones((len(self.nodes[side]), 3), dtype=bool)

    def distances(self, steps: int) -> np.ndarray:
        """(steps, n) how far the sides are apart before they move, as the law has it at every load
        step.
        """
        return np.stack([np.broadcast_to(law.distance, len(self.free)) for law in self.laws(steps)])

    def laws(self, steps: int) -> list[Law]:
        """The law at every load step."""
        return self.law_at_steps or [self.law] * steps

    def triangles_on(self, side: int) -> np.ndarray:
        """(k, 3 or 6) int, the facets of side 0 (the first) or 1, indices into its nodes, looking
        from E1 to E2.
        """
        return self.mortar.triangles if side and self.mortar else self.triangles

    def cells_on(self, side: int) -> np.ndarray:
        """(k, 2) int, global cells behind each of these facets, in E1 and in E2."""
        return self.mortar.cells if side and self.mortar else self.cells


def ends_of(interfaces: Iterable[Interface]) -> np.ndarray:
    """(n, 2) int, the subdomains of each."""
    return np.array([i.subdomains for i in interfaces], dtype=int).reshape(-1, 2)


@dataclass(frozen=True)
class Beside:
    """Two volumes with faces opposite each other, within reach, that belong to no interface.

    gap : a sentence on their gap; empty where they touch
    said : a sentence on what may come of it; empty where something connects the two and that is
        enough
    """

    gap: str
    said: str = ""


@dataclass(frozen=True)
class Difficulty:
    """Difficulties of a scene.

    mixed_moduli : (interfaces,) bool, stiff and soft cells side by side
    incompressible_or_slender : (subdomains,) bool, nearly incompressible, or slender or flat
    soft : (subdomains,) bool, those of them that affine macro functions do not do for
    softest : (subdomains,) bool, those that coarse nodes do not do for either
    slenderness : (subdomains,) largest over smallest extent
    """

    mixed_moduli: np.ndarray
    incompressible_or_slender: np.ndarray
    soft: np.ndarray
    softest: np.ndarray
    slenderness: np.ndarray


@dataclass(frozen=True)
class Overview:
    """Overview that a part of a scene has of all of it: a number per subdomain, interface or
    node, and what is one for all.

    sizes : (subdomains,) as of the ``Scene``
    loose : (subdomains,) bool, bodies that nothing but contact could hold
    difficulty : what is difficult about the interfaces and subdomains
    matched, conforming : (interfaces,) bool, and bool, as of the ``Scene``
    supports : what holds the subdomains as rigid bodies, see ``conditions.supports``
    box : (2, 3) around all nodes of the mesh
    islands : (nodes of the whole scene,) int, see ``soles.overlap``
    """

    sizes: np.ndarray
    loose: np.ndarray
    difficulty: Difficulty
    matched: np.ndarray
    conforming: bool
    supports: object
    box: np.ndarray
    islands: np.ndarray

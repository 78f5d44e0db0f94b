"""The mesh of a scene and its matter, whole and in subdomains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.scene.conditions.selection import assign_materials
from orchestrator.scene.mesh.checks import check_memory
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.bolts import BoltCut
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.mesh.quadratic import (
    TET_EDGES, choose_element, edges_of, quadratic, stiffest)
from orchestrator.scene.mesh.size_map import Sizes
from orchestrator.scene.mesh.sources import make_mesh, make_parts
from orchestrator.scene.model import Material
from orchestrator.scene.partition import Partition

# Per node and load step: loads and prescribed displacements, on the whole mesh and on the
# subdomains.
STEP_BYTES = 5 * 3 * 8
# Per corner of a mesh that gets a node in the middle of every edge, at most while its scene is
# made, measured.
QUADRATIC_BYTES = 5800.0


@dataclass(frozen=True)
class Body:
    """The mesh and its matter.

    material : (m,) int, index into ``materials``, −1 for none
    choice : of the element, where that was left open
    """

    mesh: Mesh
    faces: Faces
    materials: list[Material]
    material: np.ndarray
    choice: object = None


@dataclass(frozen=True)
class Divided:
    """A body in subdomains.

    bolts : the cuts of bolts
    failed : it could not be cut, and is judged whole
    """

    body: Body
    partition: Partition
    numbering: SplitNumbering
    bolts: Sequence[BoltCut] = ()
    failed: bool = False


class Meshed:
    """Makes meshes, and keeps the last one: the next configuration may have the same.

    One that models or programs of others have a part in is never kept.

    sizes : part, 0 where there is only ``mesh`` → how small its elements are asked to be, beside
        what the configuration says
    call : what calls the functions that make them, perhaps in another process
    """

    def __init__(self, sizes: Mapping[int, Sizes] | None = None,
                 call: Callable[..., Any] = lambda make, *given: make(*given)) -> None:
        self._sizes, self._call = sizes or {}, call
        self._asked: object = None
        self._made: tuple[Mesh, Faces] | None = None
        self._quadratic: tuple[Mesh, Faces] | None = None  # the same of ten-node tets

    def __call__(self, config: Config, run_programs: bool, problems: Problems) -> Body:
        """The mesh of a configuration, of four- or ten-node tets, and which matter each has; what
        is wrong goes to ``problems``.
        """
        parts = config.parts and [part.model_dump(exclude={"material"}) for part in config.parts]
        if self._made is None or (config.mesh, parts) != self._asked or self._made[0].foreign:
            self.let_go()  # not both at once
            self._made = (self._call(make_mesh, config.mesh, None, self._sizes.get(0))
                          if config.mesh else
                          self._call(make_parts, config.parts, run_programs, self._sizes))
            self._asked = config.mesh, parts
        mesh, faces = self._made
        element, choice = config.codes[0].element, None
        if element == "auto":
            unknowns = 3 * (len(mesh.nodes) + len(edges_of(mesh.cells, TET_EDGES)[0]))
            choice = choose_element(unknowns,
                                    stiffest(*assign_materials(mesh, config.matter, Problems())),
                                    bool(mesh.foreign))
            element = choice.element
        if element == "P2":
            check_memory(QUADRATIC_BYTES * len(mesh.nodes), ("blackbox",),
                         f"element: P2 on a mesh of {len(mesh.nodes)} corners",
                         "use a coarser mesh, or element: P1")
            self._quadratic = self._quadratic or quadratic(mesh, faces)
            mesh, faces = self._quadratic
        count = config.steps
        check_memory(STEP_BYTES * count * len(mesh.nodes), ("histories",),
                     f"{count} load steps on {len(mesh.nodes)} nodes",
                     "give fewer load steps, or a coarser mesh")
        return Body(mesh, faces, *assign_materials(mesh, config.matter, problems), choice)

    def once(self, config: Config, run_programs: bool, problems: Problems) -> Body:
        """As when called, and keeps nothing."""
        body = self(config, run_programs, problems)
        self.let_go()
        return body

    def let_go(self) -> None:
        """Keeps the last one no longer."""
        self._made = self._quadratic = None

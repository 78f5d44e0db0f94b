"""Sentences on scenes that can be solved, but hardly are what was meant: ``check`` says them, and every summary."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.config.model import Units
from orchestrator.scene.interfaces.search import paired_faces
from orchestrator.scene.mesh.quadratic import LOCKING
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import BoundaryEntry, Scene, Subdomain
from orchestrator.scene.overview import Beside
from orchestrator.errors import some

# Units of length in m, and of force in N.
LENGTHS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6,
           "nm": 1e-9, "km": 1e3, "in": 0.0254, "inch": 0.0254, "ft": 0.3048}
FORCES = {"N": 1.0, "daN": 10.0, "kN": 1e3, "MN": 1e6, "GN": 1e9, "mN": 1e-3, "µN": 1e-6,
          "μN": 1e-6, "uN": 1e-6, "lbf": 4.4482216, "lb": 4.4482216, "kip": 4448.2216,
          "kips": 4448.2216, "kgf": 9.80665, "kp": 9.80665, "dyn": 1e-5}
# Young's moduli in Pa: the softest gels, what rubber and foam stay below, diamond; and metals, to
# tell what may be meant.
SOFTEST, SOFT, STIFFEST, METALS = 1e3, 2e9, 1.3e12, (1e10, 7e11)
SOFT_RATIO = 0.35  # of matter that may be softer than that
FLAT = 1e-9  # share of a force, along an axis, that is rounding


def ratios(scene: Scene) -> np.ndarray:
    """(volumes,) the largest Poisson's ratio of each volume's four-node tets; −1 where there are none."""
    found = np.full(len(scene.mesh.volumes), -1.0)
    if scene.mesh.cells.shape[1] == 4:
        np.maximum.at(found, scene.mesh.volume, np.array([material.poisson for material in scene.materials])[scene.cell_material])
    return found


def locking(volumes: Sequence[str], ratio: np.ndarray) -> Iterator[str]:
    """Four-node tets of nearly incompressible matter in volumes of these names, see ``ratios``."""
    stiff = np.flatnonzero(ratio > LOCKING)
    if len(stiff):
        yield (f"Poisson's ratio {ratio.max():g} in {some([volumes[v] for v in stiff])} with four-node tets (P1), which lock from about "
               f"{LOCKING:g} on: they move too little, however small the residuals; take blackbox: {{element: P2}}, which code: freefem has")


def odd_moduli(units: Units | None, moduli: Iterable[tuple[float, float]]) -> Iterator[str]:
    """Yield sentences on Young's moduli, each given with its Poisson's ratio, that no matter has
    in the ``units`` that are said, where these are known here."""
    length = LENGTHS.get(units.length.lower()) if units else None
    force = FORCES.get(units.force) if units else None
    if length is None or force is None:
        return
    for young, poisson in dict.fromkeys(moduli):
        pascal = young * force / length**2
        low = SOFTEST if poisson >= SOFT_RATIO else SOFT
        if low <= pascal <= STIFFEST:
            continue
        per = length**2 / force
        meant = next((young * unit for unit in (1.0, 1e9, 1e6, 1e3)
                      if METALS[0] <= young * unit <= METALS[1]), None)
        cure = "" if meant is None else (
            f"; if {meant / 1e9:.4g} GPa are meant, write young: {meant * per:.4g}")
        yield (f"young: {young:g} is {pascal / 1e9:.3g} GPa with units {units.force} and "
               f"{units.length}, where matter of Poisson's ratio {poisson:g} has {low * per:.3g} "
               f"to {STIFFEST * per:.3g} {units.stress}{cure}")


def noted(scene: Scene) -> Iterator[str]:
    """Cautions noted when the scene was built: parts that are near each other, histories without use."""
    yield from scene.warnings


@dataclass(frozen=True)
class Acting:
    """Displacements, forces and supports that act on a scene, or on some of its subdomains.

    moved : whether displacements are prescribed, or laws act by themselves; loaded : whether there are forces, or models
        that may bear some
    largest : (entries, 3) of each entry of ``boundary`` the largest of its forces, or of the springs that it is
    held : (entries, 3) bool, whether all its nodes have these components prescribed
    """

    moved: bool
    loaded: bool
    largest: np.ndarray
    held: np.ndarray

    @classmethod
    def of(cls, scene: Scene, own: Sequence[Subdomain]) -> Acting:
        """On some subdomains; entries are those of the scene."""
        moved = any(s.prescribed.any() for s in own) or any(law.acts for i in scene.interfaces for law in (i.law, *i.law_at_steps))
        largest = [_largest(scene.mesh, entry) for entry in scene.boundary]
        held = [scene.fixed[entry.nodes].all(axis=0) for entry in scene.boundary]
        loaded = scene.brought or any(s.loads.any() for s in own)
        return cls(moved, loaded, np.array(largest).reshape(-1, 3), np.array(held, dtype=bool).reshape(-1, 3))

    @classmethod
    def joined(cls, several: Sequence[Acting]) -> Acting:
        """Of all from parts."""
        return cls(any(x.moved for x in several), any(x.loaded for x in several), np.max([x.largest for x in several], axis=0),
                   np.all([x.held for x in several], axis=0))

    def sentences(self, boundary: Sequence[BoundaryEntry]) -> Iterator[str]:
        """Nothing acts, or only where it goes straight into a support."""
        if not self.moved and not self.loaded:
            yield ("nothing loads the scene: no traction, no pressure, no body force, no displacement other than zero; "
                   "nothing will move")
        for entry, largest, held in zip(boundary, self.largest, self.held):
            acts = largest > FLAT * largest.max()
            if acts.any() and held[acts].all():
                yield (f"boundary[{entry.index}], a {entry.kind}, acts on faces alone whose displacement is prescribed along "
                       "it: it goes straight into the support and moves nothing")


def _largest(mesh: Mesh, entry: BoundaryEntry) -> np.ndarray:
    """(3,) along x, y and z."""
    if entry.ground is None or not len(entry.triangles):
        return entry.forces.largest if entry.forces else np.zeros(3)
    return entry.ground.gives(mesh.nodes[entry.nodes], np.searchsorted(entry.nodes, entry.triangles))


def unloaded(scene: Scene) -> Iterator[str]:
    """Nothing acts, or only where it goes straight into a support."""
    yield from Acting.of(scene, scene.subdomains).sentences(scene.boundary)


def beside_others(near: Mapping[tuple[int, int], Beside], boundary: Sequence[BoundaryEntry], volumes: Sequence[str],
                  covered: np.ndarray) -> Iterator[str]:
    """Parts that are near others and may pass through them; tractions and pressures on faces that lie on another part.

    near, covered : as of a ``Scene``
    """
    yield from (beside.said for beside in near.values() if beside.said)
    for entry, faces in zip(boundary, covered):
        if faces.any():
            names = sorted(volumes[v] for v in np.flatnonzero(faces))
            yield (f"boundary[{entry.index}], a {entry.kind}, acts on {faces.sum()} faces of {', '.join(names)} that lie on another "
                   "part: name a surface of the part, as part/surface, or a smaller box, if that is not meant")


RULES: list[Callable[[Scene], Iterator[str]]] = [
    lambda scene: locking(scene.mesh.volumes, ratios(scene)), noted,
    lambda scene: beside_others(scene.near, scene.boundary, scene.mesh.volumes, scene.covered), unloaded]


def scene_cautions(scene: Scene) -> list[str]:
    """Cautions that a user should know before the scene is solved."""
    if scene.overview is not None:
        return scene.overview.cautions
    return [sentence for rule in RULES for sentence in rule(scene)]


def loads_on_pairs(mesh: Mesh, boundary: list[BoundaryEntry], interfaces: list[Interface], numbering: SplitNumbering,
                   here: np.ndarray) -> np.ndarray:
    """(entries, volumes) int, on how many faces a traction or pressure acts which an interface pairs with another part's.

    interfaces : all there are; only sides with nodes of their own count, shared faces are no outer ones
    here : (m,) bool, cells behind faces that count
    """
    counts, paired = np.zeros((len(boundary), len(mesh.volumes)), dtype=int), paired_faces(numbering, interfaces)
    for entry, row in zip(boundary, counts):
        if entry.forces and len(entry.triangles) and len(paired):
            cells = entry.cells[np.isin(pack(entry.triangles[:, :3], len(mesh.nodes)), paired), 0]
            np.add.at(row, mesh.volume[cells[here[cells]]], 1)
    return counts

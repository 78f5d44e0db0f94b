"""Sentences on scenes that can be solved, but hardly are what was meant: ``check`` says them, and
every summary.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from orchestrator.config.model import Units
from orchestrator.scene.interfaces.parts import paired_faces
from orchestrator.scene.mesh.quadratic import LOCKING
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import BoundaryEntry, Scene
from orchestrator.errors import some
from orchestrator.linalg import PLACED

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


def locking(scene: Scene) -> Iterator[str]:
    """Yield a sentence on four-node tets of nearly incompressible matter."""
    if scene.mesh.cells.shape[1] != 4:
        return
    ratio = scene.moduli[scene.cell_material, 1]
    stiff = np.unique(scene.mesh.volume[ratio > LOCKING])
    if len(stiff):
        yield (
            f"Poisson's ratio {ratio.max():g} in {some([scene.mesh.volumes[v] for v in stiff])} "
            f"with four-node tets (P1), which lock from about {LOCKING:g} on: they move too "
            f"little, however small the residuals; take blackbox: {{element: P2}}, which code: "
            "freefem has")


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


def _largest(mesh: Mesh, entry: BoundaryEntry) -> np.ndarray:
    """(3,) along x, y and z."""
    if entry.ground is None or not len(entry.triangles):
        return entry.forces.largest if entry.forces else np.zeros(3)
    return entry.ground.gives(mesh.nodes[entry.nodes],
                              np.searchsorted(entry.nodes, entry.triangles))


def unloaded(scene: Scene) -> Iterator[str]:
    """Yield sentences where nothing acts, or only where it goes straight into a support."""
    moved = any(s.prescribed.any() for s in scene.subdomains) or any(
        law.acts for i in scene.interfaces for law in (i.law, *i.law_at_steps))
    if not (moved or scene.brought or any(s.loads.any() for s in scene.subdomains)):
        yield (
            "nothing loads the scene: no traction, no pressure, no body force, no displacement "
            "other than zero; nothing will move")
    for entry in scene.boundary:
        largest = _largest(scene.mesh, entry)
        acts = largest > PLACED * largest.max()
        if acts.any() and scene.fixed[entry.nodes].all(axis=0)[acts].all():
            yield (
                f"boundary[{entry.index}], a {entry.kind}, acts on faces alone whose displacement "
                "is prescribed along it: it goes straight into the support and moves nothing")


def beside_others(scene: Scene) -> Iterator[str]:
    """Yield sentences on parts that are near others and may pass through them; on tractions and
    pressures on faces that lie on another part."""
    yield from (beside.said for beside in scene.near.values() if beside.said)
    for entry, faces in zip(scene.boundary, scene.covered):
        if faces.any():
            names = sorted(scene.mesh.volumes[v] for v in np.flatnonzero(faces))
            yield (
                f"boundary[{entry.index}], a {entry.kind}, acts on {faces.sum()} faces of "
                f"{', '.join(names)} that lie on another part: name a surface of the part, as "
                "part/surface, or a smaller box, if that is not meant")


RULES: list[Callable[[Scene], Iterator[str]]] = [
    locking, lambda scene: iter(scene.warnings), beside_others, unloaded]


def scene_cautions(scene: Scene) -> list[str]:
    """Cautions that a user should know before the scene is solved."""
    return [sentence for rule in RULES for sentence in rule(scene)]


def loads_on_pairs(mesh: Mesh, boundary: list[BoundaryEntry], interfaces: list[Interface],
                   numbering: SplitNumbering) -> np.ndarray:
    """(entries, volumes) int, on how many faces a traction or pressure acts which an interface
    pairs with another part's.

    interfaces : all there are; only sides with nodes of their own count, shared faces are no outer
        ones
    """
    counts, paired = np.zeros((len(boundary), len(mesh.volumes)),
                              dtype=int), paired_faces(numbering, interfaces)
    for entry, row in zip(boundary, counts):
        if entry.forces and len(entry.triangles) and len(paired):
            cells = entry.cells[np.isin(pack(entry.triangles[:, :3], len(mesh.nodes)), paired), 0]
            np.add.at(row, mesh.volume[cells], 1)
    return counts

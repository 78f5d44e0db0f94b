"""Sentences on what a run has done outside the theory it rests on (small perturbations, moderate friction, parts that end up
inside each other where no interface keeps them apart), and on meshes that are too coarse.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from orchestrator.errors import some
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.delivery.moved import Moved
from orchestrator.results.summary.resolution import sliding, unresolved
from orchestrator.scene.cautions import LOCKING, scene_cautions
from orchestrator.scene.conditions.rigid import DISPLACEMENT, ROTATION
from orchestrator.scene.interfaces.overlap import DEEP, Overlap, Solid, overlap
from orchestrator.scene.interfaces.opposite import COINCIDE
from orchestrator.scene.interfaces.skins import smooth_faces, surface_of
from orchestrator.scene.mesh.faces import Faces, faces_of
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.model import Scene

COARSE = 0.1  # estimated discretisation error, relative, energy norm: the energy itself is off by its square


def cautions(scene: Scene, sides: list[np.ndarray], interfaces: InterfaceFields | None = None,
             detached: Iterable[list[str]] = (), discretisation_error: float | None = None, moved: Moved | None = None) -> list[str]:
    """Sentences that a reader of the results must know.

    sides : per subdomain (steps, n_E, 3) displacement; not asked for where the scene is known by its outline alone
    detached : names per load step; where such bodies are means nothing, so that they are left out
    discretisation_error : estimated, relative, energy norm; None: not known
    moved : how subdomains have moved; None: it is found from ``sides``
    """
    lost = {name for step in detached for name in step}
    tools = {i.subdomains[1] for i in scene.interfaces if i.tool is not None}  # which may go anywhere
    moved = Moved.of(scene, scene.subdomains, sides) if moved is None else moved
    kept = [s for s in scene.subdomains if s.body not in lost and s.index not in tools]
    result = [*scene_cautions(scene)]
    if (error := discretisation_error) is not None and error > COARSE:
        finer, linear = "halve the element size where fields/ show large discretisation_error", scene.mesh.cells.shape[1] == 4
        locks = any(scene.materials[m].poisson > LOCKING for m in scene.used)
        cure = finer if not linear else "take blackbox: {element: P2}" + ("" if locks else f", or {finer}")
        result.append(f"the mesh's own error is about {error:.0%} (estimated, relative, energy norm), far above that of the iterations: {cure}")
    far = list(dict.fromkeys(s.body for s in kept if moved.displacement[s.index] > DISPLACEMENT * moved.size[s.index]))
    if far:
        result.append(f"{some(far)} displaced by more than {DISPLACEMENT:.0%} of the body's size: "
                      "outside small perturbations, which the results rest on")
    angle: dict[str, float] = {}
    for s in kept:
        angle[s.body] = max(angle.get(s.body, 0.0), float(moved.rotation[s.index]))
    turned = [name for name, a in angle.items() if a > ROTATION]
    if turned:
        result.append(f"{some(turned)} rotated by up to {max(angle.values()):.2g} rad: outside small perturbations "
                      f"(up to about {ROTATION} rad), which the results rest on")
    result += passing_through(scene, sides, lost)
    return result if interfaces is None else [*result, *_of_interfaces(scene, interfaces)]


def _of_interfaces(scene: Scene, interfaces: InterfaceFields) -> list[str]:
    said: dict[str, list[str]] = {}
    for i in scene.interfaces:
        if i.law.caution:
            said.setdefault(i.law.caution, []).append(i.name)
    result = [*(f"{some(names)} {caution}" for caution, names in said.items()), *sliding(interfaces), *unresolved(scene, interfaces)]
    opening = [i.law.joins for i in scene.interfaces if not i.law.perfect]
    cut = [k for k, (part, joins) in enumerate(zip(interfaces.within, opening)) if part >= 0 and not joins]
    if cut:
        parts = sorted({scene.mesh.volumes[v] for v in interfaces.within[cut]})
        laws = " and ".join(sorted(set(interfaces.laws[cut].tolist())))
        result.append(f"{laws} on {len(cut)} interface{'s' * (len(cut) > 1)} inside one part ({some(parts)}): "
                      "it can open and slip along cuts that the real part does not have")
    return result


def passing_through(scene: Scene, sides: list[np.ndarray], lost: Iterable[str] = ()) -> list[str]:
    """A sentence per pair of parts, for the load step at which they are deepest.

    sides : per subdomain (steps, n_E, 3) displacement
    lost : names of bodies whose place means nothing
    """
    if not scene.near:
        return []
    faces = faces_of(scene.mesh.cells[:, :4], len(scene.mesh.nodes))
    parts = {v: _Part(scene, faces, sides, v, set(lost)) for v in {v for pair in scene.near for v in pair}}
    result, volume = [], scene.mesh.volume
    joined = {tuple(sorted(pair)) for i in scene.interfaces for pair in np.unique(volume[i.cells], axis=0).tolist()}
    pairs = [pair for pair in scene.near if not any(parts[v].lost for v in pair)]
    # beside a pair of theirs nodes of one dip in between those of the other, as discretised contact has it
    deep = [DEEP if tuple(sorted(pair)) in joined else COINCIDE for pair in pairs]

    def overlaps(step: int | None, chosen: Iterable[int]) -> Iterator[tuple[int, Overlap]]:
        """The chosen pairs that are inside each other, and how deep; every part is made once."""
        solids = {v: parts[v].at(step) for v in {v for k in chosen for v in pairs[k]}}
        for k in chosen:
            one, two = pairs[k]
            # chords of curved faces may be inside each other, from the start and as they turn: that is no motion
            if (o := overlap(solids[one], solids[two], (parts[one].sagitta, parts[two].sagitta), deep[k])) is not None:
                yield k, o

    each: dict[int, list[tuple[float, int, Overlap]]] = {}
    for step in range(scene.steps):
        for k, o in overlaps(step, range(len(pairs))):
            each.setdefault(k, []).append((o.depth, step, o))
    rest = dict(overlaps(None, sorted(each)))
    for k in sorted(each):
        (one, two), found = pairs[k], each[k]
        if k in rest:
            found = [f for f in found if f[0] - rest[k].depth > deep[k] * f[2].size]
        if found:
            depth, step, deepest = max(found, key=lambda f: f[0])
            result.append(f"{parts[one].name!r} and {parts[two].name!r} pass through each other by about {depth:.3g} at load "
                          f"step {step + 1}, at {format_point(deepest.where)}, where they have no interface: mesh both sides "
                          "alike there, let the law read the gap (contact: gap: geometry), or have pairs found from farther "
                          "apart (between: auto with tolerance: 1, or within: a length)")
    return result


class _Part:
    """A volume of the mesh as it is displaced."""

    def __init__(self, scene: Scene, faces: Faces, sides: list[np.ndarray], volume: int, lost: set[str]):
        self.name = scene.mesh.volumes[volume]
        chosen = scene.mesh.volume == volume
        self.number, self.cells = np.unique(scene.mesh.cells[chosen], return_inverse=True)
        self.cells = self.cells.reshape(-1, scene.mesh.cells.shape[1])
        self.displacement = np.zeros((scene.steps, len(self.number), 3))
        self.lost = False
        for e in np.unique(scene.cell_subdomain[chosen]):
            s = scene.subdomains[e]
            self.lost |= s.body in lost
            _, own, at = np.intersect1d(s.nodes, self.number, assume_unique=True, return_indices=True)
            self.displacement[:, at] = sides[e][:, own]
        self.points = scene.mesh.nodes[self.number]
        own = faces_of(self.cells[:, :4], len(self.number))
        self.outer = own.triangles[own.outer]
        at = self.number[self.outer]
        self.sagitta = surface_of(scene.mesh.nodes, at, smooth_faces(scene.mesh, faces)[faces.find(at)]).sagitta

    def at(self, step: int | None) -> Solid:
        """The volume at a load step, or at rest."""
        moved = 0.0 if step is None else self.displacement[step]
        return Solid(self.points + moved, self.cells, self.outer)

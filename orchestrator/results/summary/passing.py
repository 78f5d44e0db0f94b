"""Parts that end up inside each other where no interface keeps them apart: of those that were near from the start."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from orchestrator.scene.interfaces.skins import bulges, sagittas, smooth_faces
from orchestrator.scene.interfaces.overlap import DEEP, Solid, overlap
from orchestrator.scene.interfaces.pairing import COINCIDE
from orchestrator.scene.mesh.faces import Faces, faces_of
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.model import Scene


def passing_through(scene: Scene, sides: list[np.ndarray], lost: Iterable[str] = ()) -> list[str]:
    """A sentence per pair of parts, for the load step at which they are deepest.

    sides : per subdomain (steps, n_E, 3) displacement
    lost : names of bodies whose place means nothing
    """
    faces = faces_of(scene.mesh.cells[:, :4], len(scene.mesh.nodes)) if scene.near else None
    parts = {v: _Part(scene, faces, sides, v, set(lost)) for v in {v for pair in scene.near for v in pair}}
    result, volume = [], scene.mesh.volume
    joined = {tuple(sorted(pair)) for i in scene.interfaces for pair in np.unique(volume[i.cells], axis=0).tolist()}
    for one, two in scene.near:
        if parts[one].lost or parts[two].lost:
            continue
        # chords of curved faces may be inside each other, from the start and as they turn: that is no motion
        sagitta = parts[one].sagitta, parts[two].sagitta
        # beside a pair of theirs nodes of one dip in between those of the other, as discretised contact has it
        deep = DEEP if tuple(sorted((one, two))) in joined else COINCIDE
        found = [(o.depth, step, o) for step in range(scene.steps)
                 if (o := overlap(parts[one].at(step), parts[two].at(step), sagitta, deep)) is not None]
        if found and (rest := overlap(parts[one].at(None), parts[two].at(None), sagitta, deep)) is not None:
            found = [f for f in found if f[0] - rest.depth > deep * f[2].size]
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
        self.sagitta = sagittas(bulges(scene.mesh.nodes, at, smooth_faces(scene.mesh, faces)[faces.find(at)]))

    def at(self, step: int | None) -> Solid:
        """At a load step, or at rest."""
        moved = 0.0 if step is None else self.displacement[step]
        return Solid.of(self.name, self.points + moved, self.cells, self.outer)

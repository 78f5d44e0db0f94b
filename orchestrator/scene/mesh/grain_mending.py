"""Bad tets of grains mended together with the grains around them: by whoever has one of these, each for itself and with the same result."""

from __future__ import annotations

import numpy as np

from orchestrator.errors import wrong
from orchestrator.parallel.team import Team
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.grain_meshes import GrainMesh, GrainMesher
from orchestrator.scene.mesh.mending import Fitness, Mended, mend
from orchestrator.scene.mesh.mesh import Mesh


def mended(mesher: GrainMesher, whole: GrainMesh, bad: np.ndarray, fitness: Fitness, team: Team) -> tuple[GrainMesh, Mended]:
    """This rank's grains with bad tets mended, and what was done on all ranks. All ranks ask together.

    A bad tet may change with what is around its own nodes and those next to them: the grains there make a cluster, which is mended by
    itself. What they have in common with others stays.

    whole : this rank's grains, of which no other has one; bad : (m,) bool, of its tets
    Raises InputError: on all ranks, where two have not made the same of a cluster
    """
    patches = [_patch(mesher, whole, bad, grain) for grain in np.unique(whole.grain[bad])]
    clusters = _clusters([patch for several in team.all_gather(patches) for patch in several], mesher.skeleton.grains)
    own, parts, done = set(whole.grain.tolist()), [whole.some(~np.isin(whole.grain, np.concatenate(clusters)))], {}
    for cluster in clusters:
        if own & set(cluster):
            found, what = _mended(mesher, cluster, fitness)
            parts.append(found.some(np.isin(found.grain, [*own])))
            done[cluster[0]] = found.print, what
    known: dict[int, tuple[int, Mended]] = {}
    for first, told in ((first, told) for several in team.all_gather(done) for first, told in several.items()):
        if known.setdefault(first, told) != told:
            raise wrong(("mesh", "polycrystal"), "ranks that have mended grains differently", "machines that round alike")
    return GrainMesh.joined(parts), sum((what for _, what in known.values()), Mended())


def _patch(mesher: GrainMesher, whole: GrainMesh, bad: np.ndarray, grain: int) -> list[int]:
    """Grains at the nodes of a grain's bad tets and at those next to them."""
    near, own = np.zeros(len(whole.tags), dtype=bool), whole.cells[whole.grain == grain]
    near[whole.cells[bad & (whole.grain == grain)]] = True
    near[own[near[own].any(axis=1)]] = True
    return sorted(mesher.skeleton.grains_at(whole.tags[near]))


def _clusters(patches: list[list[int]], grains: int) -> list[list[int]]:
    """Of patches that have grains in common, all their grains; ascending, and so are they."""
    pairs = np.array([(patch[0], grain) for patch in patches for grain in patch])
    _, label = components(*pairs.T, grains)
    return sorted(np.flatnonzero(label == k).tolist() for k in np.unique(label[pairs[:, 0]]))


def _mended(mesher: GrainMesher, cluster: list[int], fitness: Fitness) -> tuple[GrainMesh, Mended]:
    """The grains of a cluster, and what was done."""
    whole, skeleton = GrainMesh.joined(mesher.of(cluster)), mesher.skeleton
    mesh = Mesh(whole.points, whole.cells, np.searchsorted(cluster, whole.grain), [str(grain) for grain in cluster],
                whole.sides(skeleton.cells.size))
    mesh, kept, done = mend(mesh, fitness, ~skeleton.all_at(whole.tags, cluster))
    return GrainMesh(whole.tags[kept], mesh.nodes, mesh.cells, np.array(cluster)[mesh.volume]), done

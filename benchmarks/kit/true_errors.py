"""True errors of a field, of the mesh and of the iterations together.

- All interfaces perfect, supports at rest: the finite element spaces are part of the space of the exact u, whatever
  the mesh, so that for any field ũ of such a space, converged or not,

      ‖u − ũ‖² = ‖u‖² − 2 f·ũ + ‖ũ‖²                (‖u − u_h‖² + ‖u_h − ũ‖², by Galerkin's orthogonality)

  with f the loads; both terms in ũ are computed on its own mesh. ‖u‖² comes from undecomposed solutions of ten-node
  tets, each mesh twice as fine as the one before, by Richardson's extrapolation with their own rate.
- Contact: against our own solution on a finer mesh that contains all others, to which ũ is carried over exactly.
  What that mesh misses is not counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from orchestrator.blackbox.start import make_blackbox
from orchestrator.config import config_from
from orchestrator.method.delivery.reference import undecomposed
from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.method.stopping.stress import von_mises
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.quadratic import TET_EDGES
from orchestrator.scene.model import Scene, Subdomain

NEAR = 30  # cells with the nearest centres, one of which holds a point

Watched = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Exact:
    """What errors are measured against.

    Parameters
    ----------
    energy : ‖u‖², the largest of all load steps
    uncertain : what the extrapolation added to the finest mesh's, relative; nan with contact
    stress : the largest von Mises stress watched
    watched : (n, 3) points → whether their stress counts
    scene, sides : of the finer mesh, with contact
    """

    energy: float
    uncertain: float
    stress: float
    watched: Watched
    scene: Scene | None = None
    sides: list[np.ndarray] | None = None

    def errors(self, scene: Scene, sides: list[np.ndarray]) -> dict[str, float]:
        """Relative errors of energy norm, deflection (work of the loads; without contact) and largest stress.

        Parameters
        ----------
        sides : per subdomain (T, n_E, 3)
        """
        estimator = Estimator.of(scene)
        stress = abs(_largest(estimator, scene, sides, self.watched) / self.stress - 1)
        if self.scene is not None:
            return {"energy_error": self._distance(scene, sides), "stress_error": stress}
        work = _work(scene, sides)
        square = self.energy - 2 * work + estimator.energy(sides)[0]
        return {"energy_error": math.sqrt(max(square, 0.0) / self.energy),
                "deflection_error": abs(1 - work / self.energy), "stress_error": stress}

    def _distance(self, scene: Scene, sides: list[np.ndarray]) -> float:
        """max_t ‖ũ − u‖ / max_t ‖u‖, with ũ carried over to the finer mesh, subdomain by subdomain."""
        gaps = [_carried(s, scene.mesh.nodes[s.nodes], mine, self.scene.mesh.nodes[fine.nodes]) - theirs
                for s, mine, fine, theirs in zip(scene.subdomains, sides, self.scene.subdomains, self.sides)]
        return math.sqrt(Estimator.of(self.scene).energy(gaps).max() / self.energy)


def direct(config: Mapping[str, Any]) -> tuple[Scene, np.ndarray]:
    """FreeFEM's undecomposed solution (T, n, 3), supports at rest, and its scene of one subdomain."""
    settings = config_from({**config, "subdomains": {"grid": [1, 1, 1]},
                            "blackbox": {**config["blackbox"], "workers": 1}})
    scene = build_scene(settings)
    with make_blackbox(settings.blackbox) as blackbox:
        return scene, undecomposed(scene, blackbox)


def extrapolated(configs: Sequence[Mapping[str, Any]], watched: Watched) -> Exact:
    """From three meshes, each twice as fine as the one before."""
    energies = []
    for config in configs:
        scene, displacement = direct(config)
        energies.append(_work(scene, [displacement]))
    first, second, last = energies
    energy = last + (last - second) / ((second - first) / (last - second) - 1)
    return Exact(energy, (energy - last) / energy, _largest(Estimator.of(scene), scene, [displacement], watched), watched)


def finer(config: Mapping[str, Any], watched: Watched) -> Exact:
    """Our own solution on one fine mesh."""
    settings = config_from(dict(config))
    solved = solve(settings, build_scene(settings))
    estimator = Estimator.of(solved.scene)
    return Exact(float(estimator.energy(solved.sides).max()), math.nan,
                 _largest(estimator, solved.scene, solved.sides, watched), watched, solved.scene, solved.sides)


def _work(scene: Scene, sides: list[np.ndarray]) -> float:
    """f·ũ of the one load step."""
    return float(sum(np.sum(s.loads[0] * u[0]) for s, u in zip(scene.subdomains, sides)))


def _largest(estimator: Estimator, scene: Scene, sides: list[np.ndarray], watched: Watched) -> float:
    """Largest von Mises stress watched, over all load steps."""
    chosen = watched(scene.mesh.nodes[estimator.node])
    return float(von_mises(estimator.recovered(sides)[:, chosen]).max())


def _carried(s: Subdomain, nodes: np.ndarray, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(T, p, 3) values (T, n, 3) on a subdomain of nodes (n, 3) at points (p, 3) inside of it.

    Raises
    ------
    ValueError : a point is outside
    """
    gradients, _ = shape_gradients(nodes, s.connectivity)
    centre = nodes[s.connectivity[:, :4]].mean(axis=1)
    near = cKDTree(centre).query(points, min(NEAR, len(centre)))[1]
    # barycentric coordinates in each of the cells
    place = 0.25 + np.einsum("pcij,pcj->pci", gradients[near], points[:, None] - centre[near])
    best = place.min(axis=2).argmax(axis=1)
    rows = np.arange(len(points))
    place, cell = place[rows, best], s.connectivity[near[rows, best]]
    if place.min() < -1e-6:
        raise ValueError("a point lies outside of the subdomain")
    if cell.shape[1] == 10:
        place = np.hstack([place * (2 * place - 1), 4 * place[:, TET_EDGES].prod(axis=2)])
    return np.einsum("pi,tpij->tpj", place, values[:, cell])

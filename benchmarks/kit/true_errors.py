"""True errors of a field, of the mesh and of the iterations together.

- All interfaces perfect, supports at rest: the finite element spaces are part of the space of the exact u, whatever
  the mesh, so that for any field ũ of such a space, converged or not,

      ‖u − ũ‖² = ‖u‖² − 2 f·ũ + ‖ũ‖²                (‖u − u_h‖² + ‖u_h − ũ‖², by Galerkin's orthogonality)

  with f the loads; both terms in ũ are computed on its own mesh. ‖u‖² comes from undecomposed solutions of ten-node
  tets, each mesh twice as fine as the one before, by Richardson's extrapolation with their own rate; where stresses are singular that is
  too rough for errors of a few per cent, and graded meshes tell more.
- Contact: against our own solution on a finer mesh that contains all others, to which ũ is carried over exactly.
  What that mesh misses is not counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.kit.elasticity import EDGES, barycentric, energy, largest_von_mises
from orchestrator import Solution, config_from, solve
from orchestrator.accuracy.loop import run as refined
from orchestrator.accuracy.measured import Energies, energies
from orchestrator.config.load import Loaded
from orchestrator.method.stopping.recovered_stresses import estimator_of
from orchestrator.run import Means

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
    finer : the solution on the finer mesh, with contact
    """

    energy: float
    uncertain: float
    stress: float
    watched: Watched
    finer: Solution | None = None

    def errors(self, solved: Solution) -> dict[str, float]:
        """Relative errors of energy norm, deflection (work of the loads; without contact) and largest stress."""
        stress = abs(_largest(solved, self.watched) / self.stress - 1)
        if self.finer is not None:
            return {"energy_error": self._distance(solved), "stress_error": stress}
        work = _work(solved)
        square = self.energy - 2 * work + energy(solved.scene, solved.sides)[0]
        return {"energy_error": math.sqrt(max(square, 0.0) / self.energy),
                "deflection_error": abs(1 - work / self.energy), "stress_error": stress}

    def _distance(self, solved: Solution) -> float:
        """max_t ‖ũ − u‖ / max_t ‖u‖, with ũ carried over to the finer mesh, subdomain by subdomain."""
        scene, nodes = self.finer.scene, solved.scene.mesh.nodes
        gaps = [carried(nodes[s.nodes], s.connectivity, mine, scene.mesh.nodes[fine.nodes]) - theirs
                for s, mine, fine, theirs in zip(solved.scene.subdomains, solved.sides, scene.subdomains, self.finer.sides)]
        return math.sqrt(energy(scene, gaps).max() / self.energy)


def left(coarse: Energies, fine: Energies) -> float:
    """Relative error of the finer of two solutions: its estimate, by the share that both energies measure of such estimates."""
    return math.sqrt(fine.estimated * (coarse.potential - fine.potential) / (coarse.estimated - fine.estimated) / fine.energy)


def graded(exact: Exact, config: Mapping[str, Any], folder: Path, elements: int) -> Exact:
    """The same with ‖u‖² from the last two of meshes that ``accuracy`` makes, the last one of about so many tets."""
    found: list[Energies] = []

    def kept(solution: Solution) -> Solution:
        estimator = estimator_of(solution.scene)
        found.append(energies(solution, estimator, estimator(solution.sides)))
        return solution

    config = {**config, "method": {"accuracy": {"error": 1e-3, "elements": elements}}}
    refined(Loaded(config_from(config)), output=folder, quiet=True, means=Means(judge=kept))
    square = left(*found[-2:]) ** 2
    return replace(exact, energy=(1 + square) * found[-1].energy, uncertain=square)


def direct(config: Mapping[str, Any]) -> Solution:
    """FreeFEM's solution in one piece."""
    return solve(config_from({**config, "subdomains": {"grid": [1, 1, 1]}, "blackbox": {**config["blackbox"], "workers": 1}}))


def extrapolated(configs: Sequence[Mapping[str, Any]], watched: Watched) -> Exact:
    """From three meshes, each twice as fine as the one before."""
    solutions = [direct(config) for config in configs]
    first, second, last = map(_work, solutions)
    found = last + (last - second) / ((second - first) / (last - second) - 1)
    return Exact(found, (found - last) / found, _largest(solutions[-1], watched), watched)


def finer(config: Mapping[str, Any], watched: Watched) -> Exact:
    """Our own solution on one fine mesh."""
    solved = solve(config_from(dict(config)))
    return Exact(float(energy(solved.scene, solved.sides).max()), math.nan, _largest(solved, watched), watched, solved)


def _work(solved: Solution) -> float:
    """f·ũ of the one load step."""
    return float(np.sum(solved.scene.loads[0] * solved.displacement[0]))


def _largest(solved: Solution, watched: Watched) -> float:
    """Largest von Mises stress watched, over all load steps."""
    return largest_von_mises(solved.scene, solved.displacement, watched(solved.scene.mesh.nodes))


def carried(nodes: np.ndarray, cells: np.ndarray, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(T, p, 3) values (T, n, 3) on a mesh of nodes (n, 3) and tets (m, 4 or 10), at points (p, 3) inside of it.

    Raises
    ------
    ValueError : a point is outside
    """
    gradients, _ = barycentric(nodes, cells)
    centre = nodes[cells[:, :4]].mean(axis=1)
    near = cKDTree(centre).query(points, min(NEAR, len(centre)))[1]
    place = 0.25 + np.einsum("pcij,pcj->pci", gradients[near], points[:, None] - centre[near])  # in each of the cells
    best, rows = place.min(axis=2).argmax(axis=1), np.arange(len(points))
    place, cell = place[rows, best], cells[near[rows, best]]
    if place.min() < -1e-6:
        raise ValueError("a point lies outside of the subdomain")
    if cell.shape[1] == 10:
        place = np.hstack([place * (2 * place - 1), 4 * place[:, EDGES].prod(axis=2)])
    return np.einsum("pi,tpij->tpj", place, values[:, cell])

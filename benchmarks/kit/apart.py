"""How far two solutions on different meshes of the same geometry are apart, in the energy norm."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.kit.elasticity import EDGES, POINTS, barycentric, moduli, strain
from orchestrator import Solution

NEAR, AT_ONCE = (6, 60), 20_000  # cells with the nearest centres, one of which holds a point: few first, then more; points


def apart(coarse: Solution, fine: Solution) -> float:
    """‖u_fine − u_coarse‖ / ‖u_fine‖ at the last load step, by four points in each tet of the fine mesh, subdomain by subdomain.

    Where faces are curved the meshes differ by more than that: planes alone are meant.
    """
    scene, difference, whole = fine.scene, 0.0, 0.0
    lam, mu = moduli(scene)
    for of_coarse, theirs, of_fine, ours in zip(coarse.scene.subdomains, coarse.sides, scene.subdomains, fine.sides):
        nodes, cells = scene.mesh.nodes[of_fine.nodes], of_fine.connectivity
        volume = barycentric(nodes, cells)[1] / len(POINTS)
        for at in POINTS:
            exact = strain(nodes, cells, ours[-1], at)
            points = np.einsum("a,mai->mi", at, nodes[cells[:, :4]])
            left = exact - strains_at(coarse.scene.mesh.nodes[of_coarse.nodes], of_coarse.connectivity, theirs[-1], points)
            weights = volume, lam[of_fine.cells], mu[of_fine.cells]
            difference, whole = difference + _energy(left, *weights), whole + _energy(exact, *weights)
    return float(np.sqrt(difference / whole))


def strains_at(nodes: np.ndarray, cells: np.ndarray, displacement: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(k, 3, 3) strains of a displacement (n, 3) on tets of four or ten nodes, at points (k, 3) within them."""
    slopes, centres = barycentric(nodes, cells)[0], nodes[cells[:, :4]].mean(axis=1)
    tree, found = cKDTree(centres), []
    for begin in range(0, len(points), AT_ONCE):
        cell, place = _within(tree, slopes, centres, points[begin:begin + AT_ONCE])
        g, weights = slopes[cell], displacement[cells[cell]]
        if cells.shape[1] == 10:
            g = np.concatenate([(4 * place - 1)[:, :, None] * g,
                                np.stack([4 * (place[:, i, None] * g[:, j] + place[:, j, None] * g[:, i]) for i, j in EDGES], 1)], 1)
        gradient = np.einsum("mai,maj->mij", weights, g)
        found.append((gradient + gradient.transpose(0, 2, 1)) / 2)
    return np.concatenate(found)


def _within(tree: cKDTree, slopes: np.ndarray, centres: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cell (k,) that holds each point, or all but does, and where in it, barycentric (k, 4)."""
    cell, place = np.zeros(len(points), int), np.full((len(points), 4), -np.inf)
    for count in NEAR:
        left = np.flatnonzero(place.min(axis=1) < 0)
        count = min(count, len(centres))
        near = tree.query(points[left], count)[1].reshape(len(left), count)
        places = 0.25 + np.einsum("pcai,pci->pca", slopes[near], points[left, None] - centres[near])
        best, row = places.min(axis=2).argmax(axis=1), np.arange(len(left))
        cell[left], place[left] = near[row, best], places[row, best]
    return cell, place


def _energy(strains: np.ndarray, volume: np.ndarray, lam: np.ndarray, mu: np.ndarray) -> float:
    return float((volume * (lam * np.trace(strains, axis1=1, axis2=2) ** 2 + 2 * mu * (strains**2).sum(axis=(1, 2)))).sum())

"""Estimates of the discretisation error: what they share, whatever they estimate it by.

They are relative to the exact ‖u‖, of which u_h has more or less. With e = u − u_h

    ‖u‖² = ‖u_h‖² − ‖e‖² + 2 f·e,      f·e = ‖e‖² where loads alone act, 0 where displacements alone
    are prescribed:

a mesh is too stiff, so that loads do too little work on it and prescribed displacements too much.
Where both act f·e is taken for the share of loads in the work, of ‖e‖². Beyond ‖e‖ = ‖u‖, where a
mesh tells nothing, the error is told as one.

What bonded sides of ten-node tets miss of each other where they do not match, in the estimate of
the error.

Multipliers that are linear on the slave's facets close what is linear of a leap [u], and leave what
is quadratic: waves as long as facets are wide, h. Half spaces of moduli E' = E/(1 − ν²) are closed
by the tractions of such a wave, of 2π/h, with the energy

    η² = Σ ∫ π/h · E'₁E'₂/(E'₁ + E'₂) [u]²      over the overlaps of facets of both sides

(K. L. Johnson, Contact Mechanics, Cambridge 1985, §13.2). No problem in a tet sees it: of two
plates that overlap and are pulled .67 of the error was told, .94 is (``tests/test_leaps.py``). On
four-node tets it is a thousandth of the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from orchestrator.method.interface.rows import bounds_of, ratio
from orchestrator.method.linear.loading import NOTHING
from orchestrator.method.stopping.error_estimate import ErrorEstimate
from orchestrator.scene.part import Copies
from orchestrator.scene.elasticity import CENTRE, strain, stress
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.mortar.operators import TURNED
from orchestrator.scene.mesh.geometry import areas, shape_gradients
from orchestrator.scene.mesh.quadratic import DEGREE_4, six_functions
from orchestrator.scene.model import Scene


BATCH = 8  # load steps at once: what is as large as the mesh is there for each
_WEIGHT = (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)  # shear stresses stand twice in the tensor


class Estimator:
    """Estimates on one mesh; a kind for each order of tets, see ``estimator_of``.

    nodes : (n, 3); cells : (m, 4 or 10) int, on nodes of which bodies have their own
    label : (n,) int, equal where perfect interfaces make nodes one
    lame : (m, 2), Lamé's λ and μ
    thermal : (T, m, 4) thermal strain at the corners; None where nothing is heated
    body_force : (T, m, 1 or 4, 3) force/volume of each cell, at its corners where it varies; None
        where there is none
    loads : per subdomain (T, n_E, 3) forces at the nodes, as displacements are given
    joined : (n,) int, the labels, numbered from zero
    gradients, volumes : (m, 4, 3) and (m,), of the linear shape functions
    ours : (m,) bool, cells that have an error: not those that stand for tools, grounds, parts of
        other programs; True: all
    leaps : displacements (T, n, 3) → (k,) cells and their (T, k) η² of leaps between sides that do
        not match, see ``leaps``; None: there are none
    """

    ours: np.ndarray | bool = True
    leaps: Callable[[np.ndarray], list[tuple[np.ndarray, np.ndarray]]] | None = None

    def __init__(self, nodes: np.ndarray, cells: np.ndarray, label: np.ndarray, lame: np.ndarray,
                 thermal: np.ndarray | None = None,
                 body_force: np.ndarray | None = None, loads: Sequence[np.ndarray] = ()):
        self.cells, self.lame = cells, lame
        self.thermal, self.body_force, self.loads = thermal, body_force, loads
        self.joined = np.unique(label, return_inverse=True)[1].ravel()
        self.gradients, self.volumes = shape_gradients(nodes, cells)
        self._prepare(nodes, label)

    def _prepare(self, nodes: np.ndarray, label: np.ndarray) -> None:
        """Prepare what a kind of estimate needs of the mesh."""

    @classmethod
    def of(cls, scene: Scene) -> Estimator:
        """For a whole scene, every subdomain with its own nodes, one after another; cells as the
        mesh has them.
        """
        copies = Copies.of(scene)
        loads = [s.loads for s in scene.subdomains]
        made = cls(scene.mesh.nodes[copies.node], copies.cells, copies.label, scene.lame,
                   scene.thermal, scene.body_force, loads)
        made.ours = ~scene.stand_ins[scene.cell_subdomain]
        if found := leaping(scene):
            starts = bounds_of([len(s.nodes) for s in scene.subdomains])
            made.leaps = lambda u: [leaps(scene, i,
                                          lambda i, side: u[:,
                                                            starts[i.subdomains[side]]
                                                            + i.nodes[side]]) for i in found]
        return made

    def __call__(self, sides: Sequence[np.ndarray],
                 numbers: Sequence[int] | None = None) -> ErrorEstimate:
        """Estimate the error of displacements.

        sides : per subdomain (T, n_E, 3), continuous over perfect interfaces
        numbers : (T,) which load steps of the scene these are; none: all
        """
        displacement = np.concatenate(sides, axis=1)
        numbers = range(len(displacement)) if numbers is None else numbers
        squares, energies = np.empty((2, len(displacement), len(self.cells)))
        alone = np.zeros(len(displacement))
        for some in (slice(a, a + BATCH) for a in range(0, len(displacement), BATCH)):
            stresses = [self.stress(u, number)
                        for u, number in zip(displacement[some], numbers[some])]
            squares[some], energies[some] = self.ours * self._errors(stresses, numbers[some]), [
                self.energies_of(sigma) for sigma in stresses]
        leapt = np.zeros(len(displacement))
        for cells, more in self.leaps(displacement) if self.leaps else ():
            np.add.at(squares, (slice(None), cells), more)
            leapt += more.sum(axis=1)
        for t, u in enumerate(displacement):
            # what each corner, moved alone, would have about: rounding of a motion is no strain
            square = np.einsum("nc,nc->n", u, u)[self.cells[:, :4]].sum(axis=1)
            alone[t] = energies[t].sum() + square @ (np.cbrt(np.abs(self.volumes))
                                                     * (self.lame[:, 0] + 2 * self.lame[:, 1]))
            # errors of stresses, relative to the size of displacements like all others
            if self.thermal is not None:
                energies[t] = self.energies(u)
        work = self.work(sides, numbers)
        errors, energy = squares.sum(axis=1), energies.sum(axis=1)
        size = size_of(exact_energy(energy, errors, work), alone)
        return ErrorEstimate("mesh", float(np.sqrt(errors.max(initial=0.0)) / size), np.nan,
                             np.sqrt(errors), size, cells=np.sqrt(squares) / size,
                             leaps=leapt / size**2)

    def work(self, sides: Sequence[np.ndarray], numbers: Sequence[int]) -> np.ndarray:
        """(T,) f·u, parameters as for the estimate."""
        return np.array(
            [sum(float((load[number] * side[t]).sum()) for load, side in zip(self.loads, sides))
                         for t, number in enumerate(numbers)])

    def energies(self, displacement: np.ndarray) -> np.ndarray:
        """(m,) ∫ ε : C ε of the cells, from displacements (n, 3)."""
        return self.energies_of(self.stress(displacement))

    def stress(self, displacement: np.ndarray, number: int | None = None) -> np.ndarray:
        """(6, p, m) stress, of ten-node tets at the p = 4 corners, of four-node ones the one that
        there is.

        number : load step of the scene, whose thermal strain is without stress; None: all strain
            has stress
        """
        places = np.eye(4) if self.cells.shape[1] == 10 else [CENTRE]
        return np.stack([stress(self.strain(displacement, at, number), self.lame).T
                         for at in places], axis=1)

    def strain(self, displacement: np.ndarray, at: np.ndarray, number: int | None) -> np.ndarray:
        """(m, 6) strain that has stress, at barycentric coordinates (4,); the rest as for
        ``stress``.
        """
        epsilon = strain(self.gradients, self.cells, displacement, at)
        if self.thermal is not None and number is not None:
            epsilon[:, :3] -= (self.thermal[number] @ at)[:, None]
        return epsilon

    def _errors(self, stresses: Sequence[np.ndarray], numbers: Sequence[int | None]) -> np.ndarray:
        """(T, m) η² of the cells, from their stresses (6, p, m) at some load steps.

        numbers : load steps of the scene, whose body forces count where an estimate knows them
        """
        raise NotImplementedError

    def energies_of(self, sigma: np.ndarray) -> np.ndarray:
        """(m,) ∫ σ : C⁻¹σ of the cells, from their stress (6, p, m):  C⁻¹σ = (σ − λ/(3λ + 2μ) tr σ
        I) / 2μ.
        """
        first, second = self.lame.T
        squares = sum(weight * mean_square(component) for component, weight in zip(sigma, _WEIGHT))
        return (squares - first / (3 * first + 2 * second)
                * mean_square(sigma[:3].sum(axis=0))) * self.volumes / (2 * second)


def mean_square(values: np.ndarray) -> np.ndarray:
    """(m,) mean over each cell of the square of the linear function with these values at its
    corners (4, m), or of a constant (1, m).
    """
    if len(values) == 1:
        return values[0] ** 2
    # (1 + 1)/20 of a corner by itself, 1/20 of two
    return (np.einsum("pm,pm->m", values, values) + values.sum(axis=0) ** 2) / 20


def exact_energy(energy: np.ndarray, errors: np.ndarray, work: np.ndarray) -> np.ndarray:
    """(T,) ‖u‖² of the exact solution, from ‖u_h‖², η² and f·u_h; no less than η²."""
    share = np.where(energy > 0, np.clip(ratio(work, energy), 0.0, 1.0), 1.0)
    return np.maximum(energy + (2 * share - 1) * errors, errors)


def size_of(squares: np.ndarray, alone: np.ndarray) -> float:
    """Return what estimated errors are relative to, from ‖u‖² (T,): what rounding leaves of zero
    has no
    error of its own.

    alone : (T,) energies of which ``squares`` would be rounding
    """
    own, most = (float(np.sqrt(x.max(initial=0.0))) for x in (squares, alone))
    return max(own, NOTHING * most) or 1.0


Traces = Callable[[Interface, int], np.ndarray]


def leaping(scene: Scene) -> list[Interface]:
    """The interfaces whose sides leave leaps."""
    return [i for i in scene.interfaces if i.mortar is not None and i.mortar.overlaps is not None
            and len(i.triangles)]


def leaps(scene: Scene, i: Interface, traces: Traces) -> tuple[np.ndarray, np.ndarray]:
    """(k,) int, cells of the scene behind the slave's facets, each maybe several times, and (T, k)
    η² of them.

    traces : interface and side → (T, n, 3) displacements of its nodes there
    """
    overlaps, (weights, places) = i.mortar.overlaps, DEGREE_4
    facets = i.triangles[overlaps.slave], i.mortar.triangles[:, TURNED][overlaps.master]
    size, *corners = overlaps.fans
    area = areas(scene.side_points(i, 0), i.triangles[:, :3])[overlaps.slave]
    one, two = (six_functions(np.einsum("qv,mtvk->mtqk", places, at)) for at in corners)
    shape = np.concatenate([one, -two], axis=3)  # (m, t, q, 12)
    gram = np.einsum("mt,q,mtqa,mtqb->mab", size * area[:, None], weights, shape, shape,
                     optimize=True)
    cells = i.cells[overlaps.slave, 0], i.mortar.cells[overlaps.master, 1]
    # 1/E' of both
    yields = sum((lam + 2 * mu) / (4 * mu * (lam + mu))
                 for lam, mu in (scene.lame[own].T for own in cells))
    gram *= (np.pi / (np.sqrt(4 / np.sqrt(3) * area) * yields))[:, None, None]
    # (T, m, 12, 3)
    u = np.concatenate([traces(i, side)[:, own] for side, own in enumerate(facets)], axis=2)
    return cells[0], np.maximum(np.einsum("tmac,mab,tmbc->tm", u, gram, u, optimize=True), 0.0)

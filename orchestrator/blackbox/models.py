"""Plain models of the scene's subdomains with their soles, as they are handed to the black box, and
their matter's own answers.

- the extended subdomains: mesh, loads' dofs and the soles of all interfaces, outer nodes clamped;
- the soles alone, each interface apart, for the search direction k⁻;
- the rims: the tets that touch an interface or a clamped node, whose stiffness gives the
  energies of boundary corrections and the reactions without exporting whole matrices.

With B the gradients of the shape functions at the integration points and w their shares of volume,
nodal forces of linear elastic matter are f = Bᵀ w σ(B u). Four-node tets have constant gradients,
one point; those of ten nodes linear ones, four points of the rule that is exact for quadratics.
Both are exact, so that codes are judged by them to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model, Origin
from orchestrator.scene.elasticity import lame
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.scene.mesh.quadratic import TET_POINTS, quadratic_slopes
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.soles import Sole
from orchestrator.scene.soles.ring import Ring

SolePair = tuple[Sole, Sole]


def sides_by_subdomain(scene: Scene) -> list[list[tuple[int, int]]]:
    """Per subdomain, its (interface, side) pairs in the order of the interfaces."""
    sides: list[list[tuple[int, int]]] = [[] for _ in scene.subdomains]
    for interface in scene.interfaces:
        for side, subdomain in enumerate(interface.subdomains):
            sides[subdomain].append((interface.index, side))
    return sides


def boundary_dofs(scene: Scene, subdomain: Subdomain,
                  sides: Sequence[tuple[int, int]]) -> np.ndarray:
    """(t,) ascending dofs of the subdomain that lie on an interface and are not prescribed."""
    on = np.zeros(len(subdomain.nodes), dtype=bool)
    for index, side in sides:
        on[scene.interfaces[index].nodes[side]] = True
    return np.flatnonzero(on[:, None] & ~subdomain.fixed)


def extended_model(scene: Scene, subdomain: Subdomain, sides: Sequence[tuple[int, int]],
                   soles: Sequence[SolePair], ring: Ring | None = None) -> Model:
    """The subdomain's mesh with the soles of all its interfaces, or its ring: K + NᵀkN of
    eq. 13.
    """
    count = len(subdomain.nodes)
    points, cells, matter = [scene.mesh.nodes[subdomain.nodes]], [subdomain.connectivity], [
        scene.moduli[subdomain.material]]
    glued = [(ring, ring.nodes)] if ring else [
        (soles[index][side], scene.interfaces[index].nodes[side]) for index, side in sides]
    for sole, inner in glued:
        numbering = np.concatenate([inner, count + np.arange(len(sole.points))])
        cells.append(numbering[sole.cells])
        points.append(sole.points)
        matter.append(_matter(sole))
        count += len(sole.points)
    fixed = np.ones((count, 3), dtype=bool)
    fixed[: len(subdomain.nodes)] = subdomain.fixed
    return _model(subdomain.name, np.vstack(points), np.vstack(cells), np.vstack(matter),
                  fixed=fixed,
                  trace=boundary_dofs(scene, subdomain, sides), code=subdomain.code,
                  origin=_origin(scene, subdomain.nodes, subdomain.cells))


def body_model(scene: Scene, subdomain: Subdomain) -> Model:
    """The subdomain's own mesh, without soles."""
    return _model(subdomain.name, scene.mesh.nodes[subdomain.nodes], subdomain.connectivity,
                  scene.moduli[subdomain.material],
                  fixed=subdomain.fixed, code=subdomain.code,
                  origin=_origin(scene, subdomain.nodes, subdomain.cells))


def sole_model(name: str, inner: np.ndarray, sole: Sole, code: int) -> Model:
    """A sole alone, whose inner nodes are at points (n, 3)."""
    return _model(name, np.vstack([inner, sole.points]), sole.cells, _matter(sole), code=code)


def _matter(sole: Sole) -> np.ndarray:
    return np.column_stack([sole.young, sole.poisson])


def sole_models(scene: Scene, soles: Sequence[SolePair]) -> list[tuple[Model, tuple[int, int]]]:
    """One model per different sole, with the (interface, side) it belongs to; interfaces without
    soles are left out.
    """
    models = []
    for interface, pair in zip(scene.interfaces, soles):
        for side in () if pair is None else (0,) if pair[0] is pair[1] else (
            0, 1):
            model = sole_model(f"sole of {interface.name}", scene.side_points(interface, side),
                               pair[side], scene.subdomains[interface.subdomains[side]].code)
            models.append((model, (interface.index, side)))
    return models


@dataclass
class Rim:
    """The part of a subdomain that touches its interfaces and clamped nodes.

    model : the tets with at least one such node, as a model
    nodes : (r,) int, local node index in the subdomain of each of the model's nodes
    """

    model: Model
    nodes: np.ndarray


def rim_model(scene: Scene, subdomain: Subdomain, sides: Sequence[tuple[int, int]]) -> Rim:
    """The rim of a subdomain; its stiffness has complete rows for interface and clamped dofs."""
    touched = subdomain.fixed.any(axis=1)
    for index, side in sides:
        touched[scene.interfaces[index].nodes[side]] = True
    chosen = touched[subdomain.connectivity].any(axis=1)
    if subdomain.foreign and chosen.any():  # its stiffness couples all of its joints
        chosen[:] = True
    nodes, cells = np.unique(subdomain.connectivity[chosen], return_inverse=True)
    model = _model(f"rim of {subdomain.name}", scene.mesh.nodes[subdomain.nodes[nodes]],
                   cells.reshape(-1, subdomain.connectivity.shape[1]),
                   scene.moduli[subdomain.material[chosen]], code=subdomain.code,
                   origin=_origin(scene, subdomain.nodes[nodes], subdomain.cells[chosen]))
    return Rim(model, nodes)


def whole_model(scene: Scene) -> Model:
    """The undecomposed problem as one model, for the reference solution."""
    mesh = scene.mesh
    return _model("the whole structure", mesh.nodes, mesh.cells,
                  scene.moduli[scene.cell_material], fixed=scene.fixed,
                  origin=_origin(scene, np.arange(len(mesh.nodes)), np.arange(len(mesh.cells))))


def _model(name: str, nodes: np.ndarray, cells: np.ndarray, matter: np.ndarray, **more) -> Model:
    """A model of tets whose (E, ν) are ``matter`` (m, 2); nothing clamped and no traces unless said
    otherwise.
    """
    if len(matter) and (matter == matter[0]).all():
        region, materials = np.zeros(len(matter), dtype=int), matter[:1].copy()
    else:  # as complex numbers: sorting rows is ten times slower
        materials, region = np.unique(np.ascontiguousarray(matter).view(complex).ravel(),
                                      return_inverse=True)
        materials = materials.view(float).reshape(-1, 2)
    return Model(name, nodes, cells, region, materials,
                 **{"fixed": np.zeros((len(nodes), 3), bool), "trace": np.empty(0, int), **more})


def _origin(scene: Scene, nodes: np.ndarray, cells: np.ndarray) -> Origin:
    return Origin(nodes, cells, scene.mesh.volume, scene.mesh.volumes)


class Matter:
    """A model's linear elastic tets, P integration points in all.

    nodes : (n, 3) float
    cells : (m, 4 or 10) int, edges straight
    young, poisson : (m,) of each tet
    slopes : (3, 4 or 10, P) ∂φ_a/∂x_j of the tets' own shape functions, at [j, a, point]
    weight : (P,) volume
    lam, mu : (P,) Lamé's constants
    """

    def __init__(self, nodes: np.ndarray, cells: np.ndarray, young: np.ndarray,
                 poisson: np.ndarray):
        gradients, volumes = shape_gradients(nodes, cells)
        slopes, points = gradients.transpose(2, 1, 0), TET_POINTS[cells.shape[1]]
        self.weight = np.tile(volumes / len(points), len(points))
        self.lam, self.mu = (np.tile(values, len(points)) for values in lame(young, poisson))
        if cells.shape[1] == 10:
            slopes = np.concatenate([np.einsum("xim,ai->xam", slopes, quadratic_slopes(p))
                                     for p in points], axis=2)
        self.slopes, self.size = slopes, len(nodes)
        self._nodes = np.tile(cells.T, len(points))  # (4 or 10, P)

    @classmethod
    def of(cls, model: Model) -> "Matter":
        """The matter of a model."""
        return cls(model.nodes, model.cells, *model.materials[model.region].T)

    def forces(self, u: np.ndarray) -> np.ndarray:
        """Nodal forces (rhs, 3n) that hold displacements (rhs, 3n) in place."""
        sigma = self.stress(self.gradient(u))
        sigma *= self.weight[:, None, None]
        nodal = self._operator.T @ sigma.reshape(-1, 3 * len(u))
        return nodal.reshape(-1, 3, len(u)).transpose(2, 0, 1).reshape(len(u), -1)

    def stiffness(self) -> sp.csr_array:
        """(3n, 3n) symmetric, nothing clamped, dof = 3 * node + component: λ ∂ᵢφ ∂ⱼφ + μ ∂ⱼφ ∂ᵢφ +
        μ δᵢⱼ ∇φ·∇φ.
        """
        count = len(self.weight)
        along = [self._operator[x * count : (x + 1) * count] for x in range(3)]
        lam, mu = (sp.diags_array(self.weight * values) for values in (self.lam, self.mu))
        same = sum(a.T @ mu @ a for a in along)
        blocks = [
            [along[i].T @ lam @ along[j] + along[j].T @ mu @ along[i]
             + (same if i == j else 0 * same) for j in range(3)]
                  for i in range(3)]
        # component by component → node by node
        order = np.arange(3 * self.size).reshape(3, -1).T.ravel()
        return sp.csr_array(sp.csr_array(sp.block_array(blocks))[order][:, order])

    def energies(self, u: np.ndarray) -> np.ndarray:
        """(rhs,) ∫ σ : ε, twice the strain energy, of displacements (rhs, 3n)."""
        gradient = self.gradient(u)
        density = self.stress(gradient)
        density *= gradient
        return np.einsum("jpcr,p->r", density, self.weight)

    def gradient(self, u: np.ndarray) -> np.ndarray:
        """(3, P, 3, rhs) derivatives ∂u_c/∂x_j, at [j, point, c], of displacements (rhs, 3n)."""
        columns = u.reshape(len(u), -1, 3).transpose(1, 2, 0).reshape(-1, 3 * len(u))
        return (self._operator @ columns).reshape(3, -1, 3, len(u))

    def stress(self, gradient: np.ndarray) -> np.ndarray:
        """(3, P, 3, rhs) σ = λ tr(ε) I + 2μ ε of derivatives of that shape."""
        sigma = self.mu[:, None, None] * (gradient + gradient.transpose(2, 1, 0, 3))
        pressure = self.lam[:, None] * (gradient[0, :, 0] + gradient[1, :, 1] + gradient[2, :, 2])
        for c in range(3):
            sigma[c, :, c] += pressure
        return sigma

    def forces_of_strain(self, strain: np.ndarray) -> np.ndarray:
        """(3n,) nodal forces that hold a uniform strain (3, 3): Σ w λ ∇φ tr(ε) + 2 Σ w μ ∇φ ε."""
        lam, mu = (
            np.stack([self._sum_on_nodes(slopes * (self.weight * values))
                      for slopes in self.slopes], axis=1)
                   for values in (self.lam, self.mu))
        return (np.trace(strain) * lam + 2 * mu @ strain).ravel()

    @cached_property
    def stiff(self) -> np.ndarray:
        """(n,) what a node opposes to a displacement of its own, the largest of its directions at
        most.
        """
        square = np.einsum("xap,xap->ap", self.slopes, self.slopes)
        square *= self.weight * (self.lam + 2 * self.mu)
        return self._sum_on_nodes(square)

    @cached_property
    def _operator(self) -> sp.csr_array:
        """(3P, n) derivatives along x, then y, then z of something given at the nodes."""
        rows, size = 3 * len(self.weight), len(self._nodes)
        return sp.csr_array((self.slopes.transpose(0, 2, 1).ravel(),
                             np.tile(self._nodes.T.ravel(), 3),
                             np.arange(0, size * rows + 1, size)), shape=(rows, self.size))

    def _sum_on_nodes(self, values: np.ndarray) -> np.ndarray:
        """(n,) sums of values (4 or 10, P) of the tets' own nodes."""
        return np.bincount(self._nodes.ravel(), values.ravel(), minlength=self.size)

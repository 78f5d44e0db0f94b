"""Guaranteed bound of the error of mesh and iterations together, by a stress in balance (Prager and Synge).

For displacements v that are continuous and meet the supports, and any stress σ in balance with body forces and tractions everywhere,

    ‖v − u‖² + ‖σ − σ(u)‖² ≤ E² = ‖σ − σ(v)‖² + 2 ∫ p g(v)      with C⁻¹ for stresses,

the last term where bodies touch, see ``pressed_faces``. So u is in the ball about the middle m of v and C⁻¹σ with the radius
ρ² = E²/2 − ‖v − C⁻¹σ‖²/4, and ‖v − u‖² / ‖u‖² at most the least q with

    ‖m − v‖² + ρ² + 2 ρ ‖m − v − q m‖ ≤ q (‖m‖² + ρ²).

u is the exact solution on the bodies as they are meshed: E knows nothing of curved faces that straight tets cut short. σ is that of
``equilibrated``, from the loads as they act on faces and in cells; supports carry what they have to.

W. Prager, J. L. Synge, Approximations in elasticity based on the concept of function space, Quart. Appl. Math. 5, 1947, 241–269.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.errors import wrong
from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.method.stopping.equilibrated import Balanced, Equilibration
from orchestrator.method.stopping.pressed_faces import CLOSED, INSIDE, PressedFaces, alike, flat
from orchestrator.method.stopping.stress_element import FACES
from orchestrator.scene.elasticity import strain, stress
from orchestrator.scene.loads.temperature import thermal_loads
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import tet_volumes
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES
from orchestrator.scene.model import BoundaryEntry, Scene

KEY = ("output", "mesh_bound")
EXPECTED = ("isotropic linear elastic parts, bonded, or four-node tets in contact without friction on plane faces, where meshes match, "
            "with loads that are linear on faces and constant in cells")
CURE = "remove mesh_bound: discretisation_error is estimated all the same"
KNOWN = 1e-9  # of the largest, up to which two ways to the same numbers agree
TRIES = 12  # stresses, with fewer faces free to be pressed each
_SHARES = {4: (0.25,) * 4, 10: (-0.05,) * 4 + (0.2,) * 6}  # of a constant force in a tet, at its nodes
_BESIDE = np.array([[k for k, edge in enumerate(TRIANGLE_EDGES) if corner in edge] for corner in range(3)])  # a triangle's edges at a corner
BALANCED = 1e-9  # of the largest force on a face, what rounding may leave of balance


@dataclass(frozen=True)
class MeshBound:
    """T load steps.

    errors : (T,) E, an energy norm
    relative : max_t ‖v − u‖ / max_t ‖u‖, at most; infinite where E is not small beside ‖u‖
    unbalanced : what rounding leaves of the balance of a tet, over the largest force on a face
    """

    errors: np.ndarray
    relative: float
    unbalanced: float


def check_bounded(scene: Scene) -> None:
    """Raises InputError: the scene has something that stresses in balance are not known for."""
    why = next(_unknown(scene), None)
    if why is not None:
        raise wrong(KEY, why, EXPECTED, CURE)


def _unknown(scene: Scene):
    """What stands in the way."""
    if scene.stand_ins.any() or scene.remembers:
        yield "a bound of the mesh's error beside grounds, rigid tools, nonlinear matter, or parts of other programs"
    for i in scene.interfaces:
        if not i.law.perfect and scene.mesh.cells.shape[1] != 4:
            yield f"a bound of the mesh's error on ten-node tets where bodies touch ({i.name})"
        if not i.law.perfect and not all(law.unilateral for law in i.laws(scene.steps)):
            yield f"a bound of the mesh's error where {i.name} has friction, or a law other than contact"
        if not i.matching:
            yield f"a bound of the mesh's error where the meshes of {i.name} do not match"
        elif not alike(scene, i) or not i.law.perfect and not flat(scene, i):
            yield f"a bound of the mesh's error where the sides of {i.name} are curved, or their faces differ"
    for entry in scene.boundary:
        if entry.forces and entry.forces.bent:
            yield f"a bound of the mesh's error where the pressure of {entry.name} is not linear on faces: a level runs through them"
        if entry.prescribed and (entry.cells[:, 1] >= 0).any():
            yield f"a bound of the mesh's error where {entry.name} holds faces inside of the mesh"
        if entry.prescribed and not _linear(scene, entry):
            yield f"a bound of the mesh's error where displacements of {entry.name} are not linear on faces"
    if not np.allclose(_loads(scene), scene.loads, rtol=0, atol=KNOWN * np.abs(scene.loads).max(initial=0.0)):
        yield "a bound of the mesh's error where body forces vary within cells (spin), or a code's own model has loads"


def _linear(scene: Scene, entry: BoundaryEntry) -> bool:
    """Whether displacements that are prescribed are linear on every face."""
    corners = scene.mesh.nodes[entry.triangles[:, :3]]
    ends = corners[:, TRIANGLE_EDGES]
    amid, at = (entry.prescribed.at(points.reshape(-1, 3)) for points in (ends.mean(axis=2), ends))
    mean = at.reshape(len(at), -1, 2, 3).mean(axis=2)
    return bool(np.abs(amid - mean).max(initial=0.0) <= KNOWN * np.abs(at).max(initial=0.0))


def _loads(scene: Scene) -> np.ndarray:
    """(T, n, 3) nodal forces, from those on faces and in cells."""
    mesh, loads = scene.mesh, np.zeros_like(scene.loads)
    for entry in scene.boundary:
        if entry.forces:
            entry.forces.add_to(loads, entry.triangles)
    if scene.body_force is not None:
        whole = np.abs(tet_volumes(mesh.nodes, mesh.cells[:, :4]))[:, None] * scene.body_force.mean(axis=2)
        for share, nodes in zip(_SHARES[mesh.cells.shape[1]], mesh.cells.T):
            np.add.at(loads, (slice(None), nodes), share * whole)
    if scene.thermal is not None:
        thermal_loads(mesh, scene.thermal, scene.materials, scene.cell_material, mesh.cells, loads)
    return loads


class MeshBounds:
    """Bounds on one mesh.

    Raises InputError: see ``check_bounded``
    """

    def __init__(self, scene: Scene):
        check_bounded(scene)
        self.scene, self.estimator = scene, Estimator.of(scene)
        e = self.estimator
        points = scene.mesh.nodes[np.concatenate([s.nodes for s in scene.subdomains])]
        self.corners = e.cells[:, :4]
        self.balance = Equilibration(points, self.corners, self._meeting(), e.lame, e.gradients, e.volumes)
        places = {i.index: self._faces(i.cells[:, 0], scene.side_nodes(i, 0)[i.triangles]) for i in scene.interfaces if not i.law.perfect}
        for entry in scene.boundary:
            if not self.balance.outer[self._faces(entry.cells[:, 0], entry.triangles)[0]].all():
                raise wrong(KEY, f"a bound of the mesh's error where {entry.name} acts on faces that another body meets", EXPECTED, CURE)
        self.pressed = PressedFaces(scene, self.balance, np.take_along_axis(e.joined[self.corners], self.balance.turn, 1), places)

    def _meeting(self) -> np.ndarray:
        """(n,) int, labels of nodes, equal where bonds or contact pair them."""
        offsets, interfaces = np.cumsum([0, *(len(s.nodes) for s in self.scene.subdomains)]), self.scene.interfaces
        one, two = (np.concatenate([np.empty(0, int), *(offsets[i.subdomains[side]] + i.nodes[side] for i in interfaces)])
                    for side in (0, 1))
        return components(one, two, len(self.estimator.joined))[1]

    def __call__(self, sides: Sequence[np.ndarray]) -> MeshBound:
        """The bound of displacements, per subdomain (T, n_E, 3); infinite where they are not continuous over bonds, or miss supports."""
        displacement, scene, e = np.concatenate(sides, axis=1), self.scene, self.estimator
        errors, sizes, works, gaps, unbalanced = *np.zeros((4, len(displacement))), 0.0
        count = np.maximum(np.bincount(e.joined), 1)
        for t, u in enumerate(displacement):
            sigma = self._turned(e.strain(u, at, t, e.cells) for at in np.eye(4))
            body = None if scene.body_force is None else scene.body_force[t].mean(axis=1)
            mean = np.stack([np.bincount(e.joined, one) / count for one in u.T], axis=1)[e.joined]  # continuous over bonds
            fixed, given = (np.concatenate(x) for x in zip(*((s.fixed, s.prescribed[t]) for s in scene.subdomains)))
            astray = max(np.abs(u - mean).max(initial=0.0), np.abs(u - given)[fixed].max(initial=0.0))
            if astray > KNOWN * np.abs(u).max(initial=0.0):
                return MeshBound(np.full(len(displacement), np.inf), np.inf, unbalanced)
            found, gaps[t] = self._nearest(sigma, body, u, t)
            errors[t], sizes[t] = np.sqrt(found.energies.sum() + 2 * gaps[t]), np.sqrt(e.energies(u).sum())
            works[t] = self._work(u, t, found.moments, sizes[t] ** 2)
            unbalanced = max(unbalanced, found.unbalanced)
        return MeshBound(errors, np.inf if unbalanced > BALANCED else relative(errors, sizes, works, gaps), unbalanced)

    def _nearest(self, sigma: np.ndarray, body: np.ndarray | None, u: np.ndarray, step: int) -> tuple[Balanced, float]:
        """The stress in balance, and ∫ p g(v); infinite where sides are inside each other, or every stress found would pull."""
        pressed, (known, given) = self.pressed, self._given(step)
        gaps, size = pressed.gaps(u, step), np.abs(u).max(initial=0.0)
        closed = (gaps <= CLOSED * size).all(axis=1)
        touch = np.where(closed[:, None], np.maximum(gaps, 0.0), 0.0)
        known[pressed.faces] = True
        known[pressed.faces[closed], 0] = False
        for _ in range(TRIES):
            found = self.balance(sigma, body, known, given)
            pulled, moments = pressed.pulling(found, closed)
            if not pulled.any():
                return found, np.inf if (gaps < -INSIDE * size).any() else float(np.vdot(moments, touch))
            closed &= ~pulled
            known[pressed.faces[pulled], 0], given[pressed.faces[pulled], :, 0] = True, -moments[pulled]
        return found, np.inf

    def _work(self, u: np.ndarray, step: int, moments: np.ndarray, energy: float) -> float:
        """a(u, C⁻¹σ + thermal strain), from ‖σ‖² + ‖u‖² − ‖σ − σ(u)‖², σ(u) of all strain."""
        e, elements = self.estimator, self.balance.elements
        every = self._turned(strain(e.gradients, e.cells, u, at) for at in np.eye(4))
        work = (elements.products(moments)[1].sum() + energy - elements.products(moments, every)[1].sum()) / 2
        if self.scene.thermal is not None:
            heat = self.scene.thermal[step]
            dilation = sum((strain(e.gradients, e.cells, u, at)[:, :3].sum(axis=1) * (heat.sum(axis=1) + heat @ at) for at in np.eye(4)))
            work += np.vdot(np.abs(e.volumes) * (3 * e.lame[:, 0] + 2 * e.lame[:, 1]), dilation / 20)
        return float(work)

    def _turned(self, strains: Iterable[np.ndarray]) -> np.ndarray:
        """(m, 4, 6) stresses at the corners, in the order of their labels, from strains (m, 6) at each of them."""
        return np.take_along_axis(np.stack([stress(one, self.estimator.lame) for one in strains], axis=1), self.balance.turn[:, :, None], 1)

    def _given(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """(f, 3) bool, components of tractions that are known, and (f, 3, 3) their moments at a load step."""
        known = np.repeat(self.balance.outer[:, None], 3, axis=1)
        given = np.zeros((len(known), 3, 3))
        for entry in self.scene.boundary:
            if not len(entry.triangles):
                continue
            face, corner = self._faces(entry.cells[:, 0], entry.triangles)
            if entry.prescribed:
                known[np.ix_(face, np.flatnonzero(entry.prescribed.fixed))] = False
            elif entry.forces:
                forces = entry.forces
                moments = np.einsum("mc,mkpc->kpc", forces.amounts[step] + np.zeros(3), forces.shapes + np.zeros(3))
                if moments.shape[1] == 6:  # a linear function is a corner's quadratic one and half of those of both edges there
                    moments = moments[:, :3] + moments[:, 3:][:, _BESIDE].sum(axis=2) / 2
                np.add.at(given, face, np.take_along_axis(moments, corner[:, :, None], 1))
        return known, given

    def _faces(self, cells: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(k,) faces of cells (k,) with corners (k, 3) on the mesh, and (k, 3) which of these corners theirs are."""
        corners = np.take_along_axis(self.scene.mesh.cells[cells, :4], self.balance.turn[cells], 1)
        same = corners[:, :, None] == triangles[:, None, :3]  # (k, 4, 3)
        local = np.argmin(same.any(axis=2), axis=1)
        return self.balance.face[cells, local], np.take_along_axis(same, FACES[local][:, :, None], 1).argmax(axis=2)


def relative(errors: np.ndarray, sizes: np.ndarray, works: np.ndarray, gaps: np.ndarray) -> float:
    """max_t ‖v − u‖ / max_t ‖u‖ at most, from E, ‖v‖, a(v, C⁻¹σ) and ∫ p g(v) of load steps (T,)."""
    if not errors.any() or not np.isfinite(errors).all():
        return float(errors.max(initial=0.0))
    apart = errors**2 - 2 * gaps  # ‖v − C⁻¹σ‖²
    middle, radius = works + apart / 4, errors**2 / 2 - apart / 4  # squares
    away = middle - (sizes**2 + works) / 2  # a(m, m − v)
    # the larger root of (|m|² − ρ²)² q² − 2 half q + rest = 0
    most, half = apart / 4 + radius, (apart / 4 + radius) * (middle + radius) - 4 * radius * away
    rest, square = most**2 - radius * apart, (middle - radius) ** 2
    outside = middle > radius
    share = np.divide(half + np.sqrt(np.maximum(half**2 - square * rest, 0.0)), square, out=np.full(len(errors), np.inf), where=outside)
    least = np.where(outside, np.sqrt(np.maximum(middle, 0.0)) - np.sqrt(radius), sizes - errors).max()
    return float(np.minimum(np.sqrt(np.maximum(share, 0.0)), errors / least if least > 0 else np.inf).max())

"""Contact problems for the tests, solved in process unless told otherwise, and how to look at a solution pair by pair."""

from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from in_process import IN_PROCESS
from benchmarks.monolithic import OPEN, Monolithic, free_normals

from orchestrator.blackbox.models import boundary_dofs, sides_by_subdomain
from orchestrator.config.model import Config
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.results.solution import Solution
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.mesh import Mesh

BOTTOM = {"on": {"plane": "z", "at": 0.0}, "displacement": [0.0, 0.0, 0.0]}
TOP = {"plane": "z", "at": 1.0}
# pressed, pressed and sheared, sheared across, let go
PATH = [[0.0, 0.0, -0.005], [0.01, 0.0, -0.005], [0.01, 0.005, -0.005], [0.005, 0.0, -0.001]]
CASES = {
    "two blocks": {"mesh": {"box": {"size": [1, 1, 1], "cells": [4, 4, 4]}}, "subdomains": {"grid": [1, 1, 2]}},
    "eight cubes": {"mesh": {"box": {"size": [1, 1, 1], "cells": [4, 4, 4]}}, "subdomains": {"grid": [2, 2, 2]}},
    "ten grains": {"mesh": {"polycrystal": {"grains": 10, "size": 1.0, "h": 0.2}}, "subdomains": "groups"},
}


def contact(friction=0.0, *, gap=None, poisson=0.3, error=1e-10, law=None, **changes) -> Config:
    """Two blocks of 1 × 1 × 0.5, one on the other, pressed and sheared, in frictional contact."""
    laws = [{"law": "contact", "friction": friction, "gap": gap}] if law is None else law
    data = {"name": "contact", **CASES["two blocks"], "materials": [{"young": 200e3, "poisson": poisson}],
            "boundary": [BOTTOM, {"on": TOP, "displacement": PATH}], "interfaces": laws,
            "blackbox": IN_PROCESS, "method": {"tolerance": {"law": error}, "max_iterations": 1000}}
    return Config.model_validate({**data, **changes})


def converged(made: Config) -> Solution:
    """The solution of a configuration; its laws hold at every node and step."""
    solved = solve(made, build_scene(made))
    assert solved.converged, solved.stop_reason
    assert_lawful(solved, 10 * (made.method.tolerance.law or made.method.tolerance.error))
    return solved


def monolithic(solved: Solution) -> Monolithic:
    """The same scene in one piece."""
    return Monolithic(solved.scene)


# --- pair by pair -----------------------------------------------------------------------------------------


@dataclass
class Contacts:
    """Node pairs of the contact interfaces of a solution; force and jump as delivered.

    Parameters
    ----------
    force : (T, P, 3) on side 1; imbalance : (T, P, 3) what the sides' forces do not cancel
    jump : (T, P, 3) u₂ − u₁; status : (T, P)
    normal : (P, 3) from side 1 to side 2; area, gap, friction : (P,); points : (P, 3); normal, gap and
        friction as they are felt within the components that are not prescribed
    """

    force: np.ndarray
    imbalance: np.ndarray
    jump: np.ndarray
    status: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    gap: np.ndarray
    friction: np.ndarray
    points: np.ndarray

    @property
    def pressure(self) -> np.ndarray:
        """(T, P) positive in compression."""
        return -np.einsum("tpi,pi->tp", self.force, self.normal) / self.area

    @property
    def opening(self) -> np.ndarray:
        """(T, P) gap left."""
        return self.gap + np.einsum("tpi,pi->tp", self.jump, self.normal)

    @property
    def shear(self) -> np.ndarray:
        """(T, P, 3) friction traction on side 1."""
        return self.across(self.force) / self.area[:, None]

    @property
    def slip(self) -> np.ndarray:
        """(T, P, 3) what each step adds to the tangential jump."""
        return np.diff(self.across(self.jump), axis=0, prepend=0.0)

    def across(self, x: np.ndarray) -> np.ndarray:
        """Tangential part of (T, P, 3)."""
        return x - np.einsum("tpi,pi->tp", x, self.normal)[..., None] * self.normal


def forces(solved: Solution) -> list[tuple[np.ndarray, np.ndarray]]:
    """Per interface the forces (T, n, 3) on either side at its nodes, zero where prescribed, or at its points."""
    scene = solved.scene
    sides = sides_by_subdomain(scene)
    space = TraceSpace.of(scene, sides, [boundary_dofs(scene, s, own) for s, own in zip(scene.subdomains, sides)],
                          np.zeros(len(sides), dtype=int))
    result = []
    for interface, traces in zip(scene.interfaces, space.sides):
        pair = np.zeros((2, scene.steps, *interface.free.shape))
        for side, own in enumerate(traces):
            pair[side][:, interface.traced(side)] = solved.iterated.fields.f[:, own]
        if interface.mortar is not None:
            m = interface.mortar
            own = sp.csc_array(m.own.T + sp.diags_array((~m.live).ravel().astype(float)))
            pair = [sla.spsolve(own, m.hats.T @ f.reshape(len(f), -1).T).reshape(len(m), 3, -1)
                    .transpose(2, 0, 1) for f in pair]
        result.append((pair[0], pair[1]))
    return result


def contacts(solved: Solution) -> Contacts:
    """The contact interfaces of a solution, in the order that the local stage keeps."""
    scene, found, start = solved.scene, [], 0
    both = forces(solved)
    for i in sorted((i for i in scene.interfaces if not i.law.perfect), key=lambda i: (i.law.name, i.index)):
        mobile = i.free.any(axis=1) if i.mortar is None else np.isin(np.arange(len(i.free)), i.mortar.points)
        end = start + int(mobile.sum())
        status = solved.iterated.local.status[:, start:end]
        start = end
        if i.law.name != "contact":
            continue
        x = scene.points(i)
        loaded = i.triangles[:, -3:]  # corners, or the middles of edges
        share = np.repeat(np.linalg.norm(area_vectors(x, i.triangles), axis=1) / 3, 3)
        one, two = (solved.parts[e][:, nodes] for e, nodes in zip(i.subdomains, i.nodes))
        force = 0.5 * (both[i.index][0] - both[i.index][1]), both[i.index][0] + both[i.index][1]
        normal, length = free_normals(scene, i)
        jump = np.where(i.free, two - one, 0.0)[:, mobile]
        if i.mortar is None:
            force = tuple(f[:, mobile] for f in force)
        else:
            normal[mobile], length = i.mortar.normal, np.ones(len(length))
            jump = np.stack([(i.mortar.second @ b.ravel() - i.mortar.first @ a.ravel()).reshape(-1, 3) for a, b in zip(one, two)])
        found.append(((*force, jump, status),
                      (normal[mobile], np.bincount(loaded.ravel(), share, len(x))[mobile],
                       (i.law.distance / length)[mobile], (i.law.friction / length)[mobile], x[mobile])))
    return Contacts(*(np.concatenate(parts, axis=1) for parts in zip(*(f[0] for f in found))),
                    *(np.concatenate(parts) for parts in zip(*(f[1] for f in found))))


def assert_lawful(solved: Solution, tolerance: float) -> None:
    """Signorini's and Coulomb's conditions at every node and step, relative to largest pressure and displacement."""
    if all(i.law.name != "contact" for i in solved.scene.interfaces):
        return
    c = contacts(solved)
    p, opening, shear, slip = c.pressure, c.opening, c.shear, c.slip
    most, far = np.abs(p).max() or 1.0, max(np.abs(u).max() for u in solved.parts)
    size, moved = np.linalg.norm(shear, axis=2), np.linalg.norm(slip, axis=2)
    power = np.einsum("tpi,tpi->tp", shear, slip)
    assert np.abs(c.imbalance / c.area[:, None]).max() <= tolerance * most
    assert -opening.min() <= tolerance * far and -p.min() <= tolerance * most
    assert np.abs(p * opening).max() <= tolerance * most * far
    assert (size - c.friction * p).max() <= tolerance * most
    assert power.min() >= -tolerance * most * far, "friction dissipates"
    assert (size * moved - power).max() <= tolerance * most * far, "friction acts along the slip"
    assert ((c.friction * p - size) * moved).max() <= tolerance * most * far, "what slips is on the cone"
    assert np.abs(p[c.status == OPEN]).max(initial=0.0) <= tolerance * most


def start_from(solved: Solution) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """Displacements and pair forces per step, for the monolithic solver."""
    force = np.concatenate([0.5 * (one - two) for one, two in forces(solved)], axis=1)
    return [([u[t] for u in solved.parts], force[t]) for t in range(solved.scene.steps)]


# --- mesh files -------------------------------------------------------------------------------------------


def written(path: Path, mesh: Mesh) -> dict:
    """Writes a mesh with named volumes and surfaces; returns the ``mesh`` section that reads it."""
    blocks, tags, names = [], [], {}
    for k, (name, triangles) in enumerate(mesh.surfaces.items(), start=1):
        blocks.append(("triangle", triangles))
        tags.append(np.full(len(triangles), k))
        names[name] = np.array([k, 2])
    order = np.argsort(mesh.volume, kind="stable")
    blocks.append(("tetra", mesh.cells[order]))
    tags.append(mesh.volume[order] + 1)
    names.update({name: np.array([k, 3]) for k, name in enumerate(mesh.volumes, start=1)})
    meshio.write(path, meshio.Mesh(mesh.nodes, blocks, field_data=names,
                                   cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags}),
                 file_format="gmsh22", binary=False)
    return {"file": str(path)}

"""How far two answers of one scene are from each other, and how far they may be.

Displacements are compared in the energy norm of the first scene's bodies: rigid motions of bodies that nothing holds have
no part in it, and where all is bonded each run's guaranteed bound is a bound in that norm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from benchmarks.metamorphic.answers import Answer, bodies
from benchmarks.kit.elasticity import stiffness
from orchestrator import Scene

ROUNDING = 1e-7  # beside what the runs claim: the moves of a scene round its places, and its matrices
FLOOR = 1e-3     # where nothing is deformed but by what iterations leave: of what the prescribed displacements could do
TINY = 1e-100    # of what is nothing at all
POINT = 100.0    # by how much a point may be off more than the whole
LAWFUL = 2e-5    # where laws open or slide there is no guarantee; runs end at residuals of 1e-8, and agree to about 1e-8


@dataclass(frozen=True)
class Distance:
    """Relative distances of two answers: displacements in the energy norm, energies, reactions, probes; and what is allowed."""

    displacement: float
    energy: float
    reaction: float
    moment: float
    probe: float
    allowed: float

    @property
    def largest(self) -> float:
        return max(self.displacement, self.energy, self.reaction, self.moment, self.probe)

    @property
    def within(self) -> bool:
        return self.largest <= self.allowed

    def __str__(self) -> str:
        return (f"displacements {self.displacement:.1e}, energies {self.energy:.1e}, reactions {self.reaction:.1e}, "
                f"moments {self.moment:.1e}, probes {self.probe:.1e}, allowed {self.allowed:.1e}")


def distance(a: Answer, b: Answer, joint: bool = False) -> Distance:
    """Of two answers in the same axes, units and names; the first one's scene gives the norm.

    Parameters
    ----------
    joint : of reactions and moments the sum counts
    """
    scene = a.solution.scene
    mesh, apart, stiff = scene.mesh, np.zeros(scene.steps), 0.0
    for name, K in _stiffnesses(a):
        if name not in b.parts:
            continue
        stiff, d = max(stiff, K.diagonal().max()), (b.parts[name] - a.parts[name]).reshape(scene.steps, -1)
        apart += _squares(K, d)
    size = size_of(a)
    extent = np.ptp(mesh.nodes, axis=0).max()
    arm = max(extent, np.abs(mesh.nodes).max())
    if b.reactions is None:
        b = replace(b, reactions=a.reactions, moments=a.moments)
    force = max(np.abs(a.reactions).max(initial=0.0), np.abs(b.reactions).max(initial=0.0), np.abs(a.moments).max(initial=0.0) / arm,
                0.01 * np.sqrt(stiff) * size) + TINY
    moved = max(np.abs(u).max() for u in a.parts.values()) + size / np.sqrt(stiff + TINY)
    sizes = {"u": POINT * moved, "f": POINT * force, "m": POINT * force * arm}
    claims = [x.bound for x in (a, b)]
    bonded = bool(np.isfinite(claims).all())
    total = (lambda x: x.sum(axis=0)) if joint else (lambda x: x)
    return Distance(
        float(np.sqrt(apart.max()) / size),
        0.0 if np.isnan(b.energy).any() else float(np.abs(a.energy - b.energy).max() / (2 * size**2 + np.abs(a.energy).max())),
        float(np.abs(total(a.reactions - b.reactions)).max(initial=0.0) / force),
        float(np.abs(total(a.moments - b.moments)).max(initial=0.0) / (force * arm)),
        max((float(np.abs(x - a.probes[k]).max()) / sizes[k[1]] for k, x in b.probes.items()), default=0.0),
        20 * sum(claims) + ROUNDING if bonded else LAWFUL)


def in_order_of(a: Answer, b: Answer) -> Answer:
    """The second answer with its nodes in the order of the first one's, found by their places."""
    there = {name: cKDTree(b.places[name]).query(places)[1] for name, places in a.places.items() if name in b.places}
    return replace(b, parts={name: b.parts[name][:, order] for name, order in there.items()})


def size_of(a: Answer) -> float:
    """The energy norm of an answer at the load step where it is largest, and what it is at least."""
    scene, own, noise = a.solution.scene, 0.0, 0.0
    for name, K in _stiffnesses(a):
        u = a.parts[name].reshape(scene.steps, -1)
        own = own + _squares(K, u)
        noise += K.diagonal().max() * np.square(np.abs(u).max(initial=0.0)) * u.shape[1] / 3
    return float(np.sqrt(np.max(own)) + 1e-13 * np.sqrt(noise) + FLOOR * _natural(scene) + TINY)


def _stiffnesses(a: Answer) -> Iterator[tuple[str, sp.csr_array]]:
    """Name and stiffness of every body."""
    scene = a.solution.scene
    mesh, moduli = scene.mesh, np.array([[m.young, m.poisson] for m in scene.materials])[scene.cell_material]
    for number, name in bodies(a.solution):
        cells = mesh.volume == number
        nodes, local = np.unique(mesh.cells[cells], return_inverse=True)
        yield name, stiffness(mesh.nodes[nodes], local.reshape(cells.sum(), -1), *moduli[cells].T)


def _natural(scene: Scene) -> float:
    """Energy norm of all bodies strained by what is prescribed, by supports or laws, over the extent of the scene."""
    given = max([np.abs(scene.prescribed).max(initial=0.0), *(i.law.imposed for i in scene.interfaces)])
    x = scene.mesh.nodes[scene.mesh.cells[:, :4]]
    volume = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6
    young = np.array([m.young for m in scene.materials])[scene.cell_material]
    return float(np.sqrt(young @ volume) * given / np.ptp(scene.mesh.nodes, axis=0).max())


def _squares(K, u: np.ndarray) -> np.ndarray:
    """(T,) of ‖u‖² in the energy norm, u being (T, 3n)."""
    return np.maximum(np.einsum("ti,ti->t", u, (K @ u.T).T), 0.0)

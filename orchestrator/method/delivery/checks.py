"""Checks of what is delivered, that know nothing of how it was found: forces of interfaces, and
true surfaces, alone.

A rigid motion m(x) = v + ω × x with n·m = 0 all over a surface moves it in itself: planes,
cylinders, spheres, cones, tori, and what is made of them about one axis. These motions are the null
space of Σ (n, x × n)(n, x × n)ᵀ (Gelfand & Guibas, Symposium on Geometry Processing, 2004). Where
both sides of an interface are moved so by one motion, pressures do no work in it, wherever they
act, and friction resists it by at most Σ μ p A |m|. So what the interface hands over, force F and
moment M about the same point, obeys

    |F·v + M·ω| ≤ Σ μ p A |m|

of all its common motions: a frictionless press fit carries no torque, a plane nothing across its
normal. The motion that is asked for is that which F and M are along. Normals are those of the
surfaces, from all their nodes; those that the forces were found with are not asked.

A bolt's cut is to clamp: what goes back, on the other side of it, into the very part that its
thread is bonded to never arrives under the head.

What the run says of its error, over what all interfaces carry, is what a check may be off by.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.conditions.rigid import motions_about, size_of
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.skins import smooth_faces, surface_of
from orchestrator.scene.mesh.geometry import facet_normals
from orchestrator.scene.model import PlacedBolt, Scene

# Of pressures, what a motion that is known with the digits of files may make of them.
ALIKE = 1e-4
# The mean of n·m over the nodes, below which a motion moves a surface in itself.
STILL = 0.1 * ALIKE
# Cosine of normals on a plane, but for rounding.
PLANE = 1 - 1e-12
# Forces that rounding leaves, relative to all that soles feel.
ROUNDING = 1e-12
# Facets whose normals have a smaller cosine with an axis look more away from it than along it.
AROUND = np.sqrt(0.5)


def checked(scene: Scene, fields: InterfaceFields, resultants: Resultants, off: float,
            felt: float) -> list[str]:
    """Return sentences on what cannot be, the worst first.

    fields : of all interfaces that are not perfect
    off : relative error of forces that the run tells; felt : all that soles feel
    """
    around = _around(scene)
    said = [*beyond_friction(scene, fields, resultants, off, felt),
            *(each for bolt in scene.bolts
              for each in back_into_thread(scene, bolt, around, resultants, off))]
    return [sentence for _, sentence in sorted(said, reverse=True)]


def _around(scene: Scene) -> set[int]:
    """Numbers of the perfect interfaces all of whose faces are around the axis of a bolt that they
    hold.
    """
    axes = {e: bolt.axis for bolt in scene.bolts for e in bolt.interface.subdomains}
    found = set()
    for i in scene.interfaces:
        for axis in (axes[e] for e in i.subdomains if e in axes and i.law.perfect
                     and len(i.nodes[0])):
            normals, each = facet_normals(scene.side_points(i, 0), i.triangles[:, :3])
            found |= {i.index} if (np.abs(normals[each > 0] @ axis) < AROUND).all() else set()
    return found


def motions_of(scene: Scene, i: Interface, about: np.ndarray, size: float) -> np.ndarray:
    """Return (k, 6) orthonormal motions that move both sides of an interface in themselves: v, and
    ω · ``size`` about a point (3,); none where a side is no surface that is known."""
    rows, points = [], [scene.side_points(i, side) for side in (0, 1)]
    for side in (0,) if i.matching and np.array_equal(*points) else (0, 1):
        if side and i.tool is not None:
            at, normals = points[1], i.tool.at(np.zeros(6), points[1])[1]
        else:
            triangles = i.triangles_on(side)[:, :3]
            at = points[side][triangles].reshape(-1, 3)
            normals = facet_normals(points[side], triangles)[0]
            if (normals @ normals[:1].T < PLANE).any():
                face = smooth_faces(scene.mesh, scene.side_nodes(i, side)[triangles])
                found = surface_of(points[side], triangles, face)
                flat = (found.bulge == 0).all(axis=1)[:, None, None]
                normals = np.where(flat, found.means, found.normals)
            else:
                normals = np.repeat(normals, 3, axis=0)
        rows.append(np.hstack([normals.reshape(-1, 3),
                               np.cross((at - about) / size, normals.reshape(-1, 3))]))
    normals = np.concatenate(rows)
    if np.isnan(normals).any():
        return np.zeros((0, 6))
    squares, ways = np.linalg.eigh(normals.T @ normals / len(normals))
    return ways[:, squares <= STILL**2].T


def handed_over(scene: Scene, i: Interface, fields: InterfaceFields, own: slice,
                resultants: Resultants) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return what an interface with Coulomb's friction hands over in the motion of its surfaces
    that its force and moment are along: (T,) |F·v + M·ω|, a force; (T,) Σ μ p A |m|, and what
    supports take of pressures; (T,) Σ p A |m|, |m| ≤ 1. None where no motion moves both its sides
    in themselves.

    fields : whose nodes ``own`` are this interface's
    """
    about, points = resultants.centre[i.index], scene.side_points(i, 0)
    size = size_of(points)
    motions = motions_of(scene, i, about, size)
    if not len(motions):
        return None
    wrench = np.hstack([resultants.force[:, i.index], resultants.moment[:, i.index] / size])
    along = (wrench @ motions.T) @ motions
    moved = np.einsum("nck,tk->tnc", motions_about(fields.points[0, own], about, size), along)
    way = np.linalg.norm(moved, axis=2)
    if i.mortar is not None:  # what a point carries acts on the facets around its node
        around = np.searchsorted(i.shown, i.shown_triangles)
        farthest = np.repeat(way[:, around].max(axis=2), around.shape[1], axis=1)
        np.maximum.at(way, (slice(None), around.ravel()), farthest)
    most = way.max(axis=1, initial=0.0)
    most = np.where(most > 0, most, 1.0)
    push = np.maximum(fields.pressure[:, own], 0.0) * fields.areas[:, own]
    worth = (push * way).sum(axis=1) / most
    # of a pressure, components that supports hold on both sides pass through these, not from side
    # to side
    beside = np.abs(np.einsum("tnc,nc->tn", moved, np.where(_held(i), fields.normal[own], 0.0)))
    allowed = float(i.law.friction) * worth + (push * beside).sum(axis=1) / most
    return (wrench * along).sum(axis=1) / most, allowed, worth


def _held(i: Interface) -> np.ndarray:
    """(n, 3) bool, components of the nodes shown in which the law does not act, as supports hold
    them.
    """
    if i.mortar is None:
        return ~i.free[i.shown]
    free = np.ones_like(i.free)
    free[i.mortar.points] = i.mortar.live
    return ~free[i.shown]


def beyond_friction(scene: Scene, fields: InterfaceFields, resultants: Resultants, off: float,
                    felt: float) -> Iterator[tuple[float, str]]:
    """Yield how far beyond what is possible interfaces are, and a sentence on each; parameters as
    for ``checked``.
    """
    push = np.maximum(fields.pressure, 0.0) * fields.areas
    # (T,) the largest Σ p A of an interface
    pushes = np.max([push[:, at].sum(axis=1) for _, at in fields.each()], axis=0)
    nothing, off = ROUNDING * pushes.max(initial=felt), max(off, ALIKE)
    for i, (_, at) in zip(scene.opening, fields.each()):
        # sides that slide on meet where they have moved to
        if not i.law.slips or i.follows or (
                handed := handed_over(scene, i, fields, at, resultants)) is None:
            continue
        power, capacity, size = handed
        left = power - capacity - off * (size + pushes) - nothing
        step = int(np.argmax(left))
        if left[step] > 0:
            what = "friction can hold there" if capacity[
                step] > 0 else "a surface without friction can"
            yield left[step], (
                f"{i.name} hands over {power[step]:.4g} along its surfaces (of a moment: "
                f"over its arm) at load step {step + 1}, where {capacity[step]:.4g} is all "
                f"that {what}")


def back_into_thread(scene: Scene, bolt: PlacedBolt, around: set[int], resultants: Resultants,
                     off: float) -> Iterator[tuple[float, str]]:
    """Yield, and say, what of a bolt's force goes back into the part that its thread is bonded to.

    around : numbers of perfect interfaces all of whose faces are around the bolt's axis
    """
    taken = {}
    for half, e in enumerate(bolt.interface.subdomains):
        for i in scene.interfaces:
            if e in i.subdomains and i.index in around:
                other = i.subdomains[1 - i.subdomains.index(e)]
                sign = 1.0 if i.subdomains[0] == e else -1.0
                part = scene.subdomains[other].body
                taken.setdefault(part,
                                 np.zeros((2, scene.steps)))[half] += sign * (
                                     resultants.force[:, i.index] @ bolt.axis)
    force = np.abs(resultants.force[:, bolt.interface.index] @ bolt.axis)
    for part, (one, two) in taken.items():
        back = np.where(one * two < 0, np.minimum(np.abs(one), np.abs(two)), 0.0)
        step = int(np.argmax(back - off * force))
        if back[step] > off * force[step]:
            yield back[step], (
                f"of {force[step]:.5g} at the cut of {bolt.name} {back[step]:.5g} goes back into "
                f"{part}, to which it is bonded on either side of the cut, at load step "
                f"{step + 1}, and does not clamp: move the cut between head and thread")

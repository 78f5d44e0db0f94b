"""Resultants of interfaces, bonded ones too, and the balance of every body: loads, supports and
interfaces add up to nothing.

With f the nodal forces of side 2 on side 1 of an interface, x the nodes of side 1, n their normals
and c its centre of area,

    F = Σ f,    M = Σ (x − c) × f,    x_p = Σ (n·f) x / Σ n·f

The last is where the normal forces act as a whole: nowhere where they add up to nothing beside
themselves. On a plane interface it is where F has the same moment about axes in the plane. Forces
of components that are prescribed are the supports', not the interface's.

A body is what perfect interfaces join. About the centre c of the scene, of size L,

    Σ p + Σ r ± Σ f = 0,    Σ (x − c)/L × (p + r ± f) = 0

over its nodes: p loads, r of the supports (stiffness times recovered displacements less the rest),
f as written for the interfaces that are not perfect. Forces of perfect interfaces within a body
cancel, and so do their moments but for the couples (x₁ − x₂) × f of bonded nodes that are a little
apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.laws.points import BONDED
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.flux import ForceProbes, Measured, ProbeRim
from orchestrator.method.delivery.interface_fields import (
    InterfaceFields, geometry_shown, own_interfaces)
from orchestrator.method.delivery.recovery import Parts, support_forces, wrench
from orchestrator.method.exchange_by_nodes import pair_forces
from orchestrator.method.iterated import Iterated
from orchestrator.method.linear.loading import bodies_of
from orchestrator.scene.conditions.rigid import size_of
from orchestrator.scene.mesh.geometry import areas, node_normals
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.mortar.operators import Mortar
from orchestrator.scene.model import Scene

# Normal forces whose sum is this small beside what the interface that carries most does have no
# centre: iterations leave as much.
NO_CENTRE = 1e-6


@dataclass(frozen=True)
class Resultants:
    """Resultants of all interfaces of the scene, T load steps, I interfaces."""

    force: np.ndarray  # (T, I, 3) of side 2 on side 1
    moment: np.ndarray  # (T, I, 3) about ``centre``
    pressure_centre: np.ndarray  # (T, I, 3), nan where there is none
    centre: np.ndarray  # (I, 3) of area
    area: np.ndarray  # (I,)


def interface_resultants(d: Decomposition, f: np.ndarray) -> Resultants:
    """Resultants of all ranks' interfaces, from interface forces f (T, D)."""
    scene, space = d.scene, d.space
    count, steps, here = len(scene.interfaces), len(f), set(space.subdomains)
    centre, area = np.zeros((count, 3)), np.zeros(count)
    total, weighted = np.zeros((steps, count, 6)), np.zeros((steps, count, 3))
    pressed, size = np.zeros((2, steps, count))
    own = [i for i in scene.interfaces if i.subdomains[0] in here and len(i.nodes[0])]
    on = _on_sides(d, f)
    if own:
        of, at = [i.index for i in own], _Surfaces(scene, own)
        area[of], centre[of] = at.area, at.centre
        forces = np.zeros((steps, len(at.points), 3))
        traced = np.concatenate([i.traced(0) for i in own])
        forces[:, traced] = np.concatenate([on(k, 0) for k in of], axis=1)
        arm = at.points - np.repeat(at.centre, at.counts, axis=0)
        push = np.einsum("tni,ni->tn", forces, at.normals)
        total[:, of, :3], total[:, of, 3:] = at.sums(forces), at.sums(np.cross(arm, forces))
        pressed[:, of], size[:, of], weighted[:,
                                              of] = at.sums(push), at.sums(
                                                  np.linalg.norm(forces, axis=2)), at.sums(
                                                      push[:, :, None] * arm)
    total, weighted, pressed, size, centre, area = space.team.sum(
        total, weighted, pressed, size, centre, area)
    known = (np.abs(pressed) > NO_CENTRE * size.max(initial=0.0)) & (area > 0)
    shift = weighted / np.where(known, pressed, np.nan)[:, :, None]
    return Resultants(total[..., :3], total[..., 3:], centre + shift, centre, area)


def _on_sides(d: Decomposition, f: np.ndarray) -> Callable[[int, int], np.ndarray]:
    """(interface, side) → (T, n) forces on its trace dofs, from f (T, D); all ranks ask."""
    space = d.space
    if not space.by_nodes:
        return lambda index, side: f[:, space.sides[index][side]]
    q, bounds = pair_forces(space, f), space.transfer.bounds
    return lambda index, side: (1 - 2 * side) * q[:, bounds[index] : bounds[index + 1]]


def at_rim(d: Decomposition, f: np.ndarray, rims: Sequence[ProbeRim]) -> np.ndarray:
    """(T, 6) force and moment of interface forces f (T, D) at some nodes, of all ranks."""
    total, on = np.zeros((len(f), 6)), _on_sides(d, f)
    for rim in rims:
        i = d.scene.interfaces[rim.interface]
        if i.subdomains[rim.side] in d.space.subdomains:
            traced = i.traced(rim.side)
            forces = np.zeros((len(f), *traced.shape))
            forces[:, traced] = on(rim.interface, rim.side)
            total += np.einsum("tni,cni->tc", forces[:, rim.nodes], rim.motions)
    return d.space.team.sum(total)[0]


def carried(d: Decomposition, parts: Parts, f: np.ndarray,
            wanted: ForceProbes) -> dict[str, np.ndarray]:
    """Name of each probe of forces → (T, c) what they are, of all ranks: of displacements in
    equilibrium with interface forces f (T, D).
    """
    own = [Measured(probe.weights, np.zeros_like(probe.given)).of(parts)
           for probe in wanted.carried.values()]
    found = {name: probe.given + here
             for (name, probe), here in zip(wanted.carried.items(),
                                            d.space.team.sum(*own) if own else ())}
    return found | {name: found[name] - at_rim(d, f, rims) for name, rims in wanted.rims.items()}


class _Surfaces:
    """The first sides of interfaces that have nodes, one after the other.

    points, normals : (N, 3); counts : (I,) int, nodes of each; area : (I,); centre : (I, 3) of
        area, or of nodes alone
    """

    def __init__(self, scene: Scene, own: Sequence[Interface]):
        self.counts = np.array([len(i.nodes[0]) for i in own])
        self._starts = np.cumsum(self.counts) - self.counts
        self.points = np.concatenate([scene.side_points(i, 0) for i in own])
        corners = np.concatenate([i.triangles[:, :3] + start
                                  for i, start in zip(own, self._starts)])
        facets = np.repeat(np.arange(len(own)), [len(i.triangles) for i in own])
        each = areas(self.points, corners)
        self.area = np.bincount(facets, each, len(own))
        moments = np.stack([np.bincount(facets, each * x, len(own))
                            for x in self.points[corners].mean(axis=1).T], axis=1)
        covered = self.area[:, None] > 0
        self.centre = np.where(covered, moments / np.where(covered, self.area[:, None], 1.0),
                               self.sums(self.points[None])[0] / self.counts[:, None])
        self.normals = np.zeros_like(self.points)
        for width in {i.triangles.shape[1] for i in own}:  # elsewhere they are zero
            self.normals += node_normals(self.points, np.concatenate(
                [i.triangles + start for i, start in zip(own, self._starts)
                 if i.triangles.shape[1] == width]))
        for i, start in zip(own, self._starts):
            if i.normals is not None:
                self.normals[start : start + len(i.normals)] = i.normals

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(T, I, …) of values (T, N, …) over the nodes of each."""
        return np.add.reduceat(values, self._starts, axis=1)


def bolt_forces(scene: Scene, interfaces: InterfaceFields,
                resultants: Resultants) -> list[dict[str, object]]:
    """Per bolt its name, the interface at its cut, its axis, which leads from side 1 to side 2, a
    point of its cut, and per load step the following:

    - force, positive where it is pulled: that of side 2 on side 1 along the axis
    - shear, across the axis; bending and torsion, moments about the middle of the section where its
    plane cuts it
    - shortening, a length: how much the cut's sides have gone into each other along the axis
    - state: what its law says it does
    """
    told, kinds = [], dict(zip(interfaces.kinds.tolist(), interfaces.kind_names.tolist()))
    there = {i.index: own for i, own in zip(scene.opening, interfaces.each())}
    for bolt in (one for one in scene.bolts if one.interface.index in there):
        at = bolt.interface.index
        k, own = there[at]
        area, force, middle = interfaces.area[own], resultants.force[:, at], resultants.centre[at]
        # the section zigzags along the mesh's faces
        lift = ((bolt.point - middle) @ bolt.axis) * bolt.axis
        moment = resultants.moment[:, at] - np.cross(lift, force)
        along, turning = force @ bolt.axis, moment @ bolt.axis
        told.append({
            "name": bolt.name, "interface": bolt.interface.name, "axis": bolt.axis.tolist(),
            "cut": bolt.point.tolist(),
            "force": (interfaces.resultant[:, k] @ bolt.axis).tolist(),
            "shear": np.linalg.norm(force - along[:, None] * bolt.axis, axis=1).tolist(),
            "bending": np.linalg.norm(moment - turning[:, None] * bolt.axis, axis=1).tolist(),
            "torsion": turning.tolist(),
            "shortening": (-(interfaces.gap[:, own] @ area) / area.sum()).tolist(),
            "state": [kinds[int(next(iter(row[row != BONDED]), BONDED))]
                      for row in interfaces.status[:, own]]})
    return told


@dataclass(frozen=True)
class Balance:
    """Forces and moments left unbalanced, T load steps, b bodies."""

    names: list[str]  # (b,) of a piece of each body
    # (T, b, 6) force, and moment over the scene's size; 0 where a part whose mesh is not ours has
    # supports inside
    left: np.ndarray
    size: np.ndarray  # (T, b) sum of the magnitudes of these forces


def balance(d: Decomposition, parts: Parts, f: np.ndarray, interfaces: InterfaceFields | None,
            iterated: Iterated | None = None, taken: list[np.ndarray | None]
            | None = None) -> Balance:
    """All bodies' balance.

    parts, f : as recovered, and (T, D) interface forces
    interfaces : fields of this rank's interfaces that are not perfect, if the scene has any
    iterated : with the pairs of every load step, where sides slide on
    taken : what supports take besides, see ``lawful``
    """
    scene = d.scene
    count, body = bodies_of(scene, lambda i: i.law.perfect)
    nodes = scene.mesh.nodes
    ends = np.reshape(d.space.team.max(*-nodes.min(axis=0), *nodes.max(axis=0)),
                      (2, 3)) * np.array([[-1], [1]])
    centre, extent = ends.mean(axis=0), size_of(ends)
    left, size = np.zeros((scene.steps, count, 6)), np.zeros((scene.steps, count))

    def add(e: int, points: np.ndarray, forces: np.ndarray) -> None:
        """Forces (T, n, 3) at points (n, 3) of a subdomain."""
        left[:, body[e]] += wrench((points - centre) / extent, forces)
        size[:, body[e]] += np.linalg.norm(forces, axis=2).sum(axis=1)

    for s, support in zip(d.own, support_forces(d, parts, f, taken)):
        if support is not None:
            add(s.index, nodes[s.nodes], support)
        if s.loads.any():
            add(s.index, nodes[s.nodes], s.loads)
        if s.foreign and s.fixed.any():  # what its supports carry stays inside it
            left[:, body[s.index]] = np.nan
    if interfaces is not None:
        at = geometry_shown(d.scene, own_interfaces(d))
        push = -interfaces.pressure * at.length * interfaces.area
        forces = push[:, :, None] * at.acting
        forces = forces + interfaces.friction_traction * interfaces.area[:, None]
        for i, (_, own) in zip(own_interfaces(d), interfaces.each()):
            if i.moving is None:
                places, here = (interfaces.nodes[own], interfaces.others[own]), forces[:, own]
                places, pair = [nodes[side] for side in places], (here, -here)
                if i.mortar is not None:
                    places = [scene.side_points(i, side) for side in (0, 1)]
                    pair = at_nodes(i.mortar, here[:, np.searchsorted(i.shown, i.mortar.points)])
                for e, x, acting in zip(i.subdomains, places, pair):
                    add(e, x, acting)
    for e, couple in _couples(d, f, centre, extent):
        left[:, body[e], 3:] += couple
    for t, i, carried in () if iterated is None else _slid_on(d, iterated):
        for side, (e, forces) in enumerate(zip(i.subdomains, carried)):
            everywhere = np.zeros((scene.steps, *forces.shape))
            everywhere[t] = forces
            add(e, scene.side_points(i, side), everywhere)
    left, size = d.space.team.sum(left, size)
    names = [scene.subdomains[e].body for e in np.unique(body, return_index=True)[1]]
    return Balance(names, np.where(np.isnan(left), 0.0, left), size)


def _couples(d: Decomposition, f: np.ndarray, centre: np.ndarray,
             extent: float) -> Iterator[tuple[int, np.ndarray]]:
    """Couples (T, 3) over an extent, and a subdomain of the body, that bonded sides which are a
    little apart hand on, from interface forces f (T, D).
    """
    if d.space.by_nodes:
        return
    handed = d.space.transfer.opposed(d.space.transfer.carried(*d.space.extended(f)))
    for i in d.scene.interfaces:
        if i.law.perfect and i.subdomains[0] in d.space.subdomains:
            for side, dofs in enumerate(d.space.sides[i.index]):
                arm = (d.scene.side_points(i, side) - centre) / extent
                forces = np.zeros((len(f), *arm.shape))
                forces[:, i.traced(side)] = handed[:, dofs]
                yield i.subdomains[0], np.cross(arm, forces).sum(axis=1)


def at_nodes(mortar: Mortar, q: np.ndarray) -> list[np.ndarray]:
    """Return (T, n, 3) at the nodes of either side what forces (T, p, 3) of points on the first
    do.
    """
    rows = q.reshape(len(q), -1)
    return [(operator.T @ (sign * rows).T).T.reshape(len(q), -1, 3)
            for operator, sign in ((mortar.first, 1), (mortar.second, -1))]


def _slid_on(d: Decomposition,
             iterated: Iterated) -> Iterator[tuple[slice, Interface, list[np.ndarray]]]:
    """Per load step and interface whose sides slide on, what its points do at the nodes of either
    side, (n, 3) each.
    """
    mine = {i.index for i in own_interfaces(d) if i.moving is not None}
    w, f = iterated.fields.extended
    for t, pairs, _ in iterated.by_pairing() if mine else ():
        force = pairs.traces(w[t], f[t]).force[0]
        for i, at in pairs.each():
            if i.index in mine:
                yield t, i, [side[0] for side in at_nodes(i.mortar, force[:, at].T[None])]

"""Whether what is prescribed agrees: at every node, across jumps, round closed circuits of them,
and on both sides of an interface.

What holds displacements whatever the forces are equations e·u = g at nodes: components that entries
prescribe, directions of frames that are held, surfaces that a point moves as a whole. Where an
interface prescribes the jump, both sides' equations speak of one unknown, but for the jump. They
agree if one displacement meets them all: by least squares, dependent directions counted once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.errors import LITTLE, Problems, some
from orchestrator.scene.conditions.boundary import Held
from orchestrator.scene.conditions.selection import TOLERANCE
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import facet_normals, format_point, node_normals
from orchestrator.scene.interface import Interface
from orchestrator.linalg import svd, WRITTEN


@dataclass
class Told:
    """Equations e·u = g, R of them.

    node : (R,) int, split nodes; direction : (R, 3) e; value : (T, R) g; entry : (R,) int, who says
        so, of ``boundary``
    """

    node: np.ndarray
    direction: np.ndarray
    value: np.ndarray
    entry: np.ndarray

    @classmethod
    def joined(cls, several: Sequence[Told]) -> Told:
        return cls(*(np.concatenate([getattr(one, name) for one in several], axis=axis)
                     for name, axis in (("node", 0), ("direction", 0), ("value", 1), ("entry", 0))))


@dataclass
class Circuits:
    """Labels that prescribed jumps make one.

    jumps : the interfaces
    group : (labels,) int; shift : (T, labels, 3), displacement less that of the group's first label
    """

    jumps: list[Interface]
    group: np.ndarray
    shift: np.ndarray


def check_agreement(held: Held, interfaces: Sequence[Interface],
                    grounds: Sequence[tuple[int, Interface]], problems: Problems) -> None:
    """Adds a problem for entries that contradict each other, and for jumps that do not add up.

    interfaces : all there are; grounds : an entry of ``boundary`` each, and the interface with its
        ground
    """
    jumps = [i for i in interfaces if i.matching and not i.law.perfect
             and i.law.given_jump is not None]
    if not jumps and not grounds:
        return
    circuits, label = _across(held, jumps, problems), held.label
    rows = Told.joined([_components(held, c) for c in range(3)]
                       + [_directions(held, entry, i) for entry, i in grounds])
    if not len(rows.node):
        return
    of = circuits.group[label[rows.node]]
    moved = rows.value - np.einsum("rc,trc->tr", rows.direction,
                                   circuits.shift[:, label[rows.node]])
    left = np.abs(residual(rows.direction, moved, of))
    size = np.zeros((len(moved), circuits.group.max() + 1))
    for values in (np.abs(rows.value), np.abs(moved), held.changes().T[:, rows.entry]):
        np.maximum.at(size, (slice(None), of), values)
    _contradictions(held, circuits, rows, of, left > TOLERANCE * size[:, of], left, problems)


def residual(direction: np.ndarray, value: np.ndarray, group: np.ndarray) -> np.ndarray:
    """(T, R) what the best displacement of each group leaves of its equations.

    direction : (R, d); value : (T, R); group : (R,) int
    """
    order = np.argsort(group, kind="stable")
    names, first, count = np.unique(group[order], return_index=True, return_counts=True)
    place = np.arange(len(group)) - np.repeat(first, count)
    at = np.repeat(np.arange(len(names)), count), place
    matrix, right = np.zeros((len(names), count.max(), direction.shape[1])), np.zeros(
        (len(names), count.max(), len(value)))
    matrix[at], right[at] = direction[order], value[:, order].T
    span, values, _ = svd(matrix, full_matrices=False)
    span = span * (values > WRITTEN * values[:, :1])[:, None, :]
    result = np.empty_like(value)
    result[:, order] = (right - span @ (span.transpose(0, 2, 1) @ right))[at].T
    return result


def _components(held: Held, component: int) -> Told:
    node = np.flatnonzero(held.by[:, component] >= 0)
    return Told(node, np.tile(np.eye(3)[component], (len(node), 1)),
                held.values[:, node, component], held.by[node, component])


def _directions(held: Held, entry: int, ground: Interface) -> Told:
    """Directions that a ground holds, whatever the forces."""
    laws = ground.laws(len(held.values))
    direction, holds, _ = laws[0].held
    which, at = np.nonzero(holds)
    value = np.stack([law.held[2] for law in laws])[:, which, at]
    return Told(held.numbering.sides(ground)[0][at], direction[which, :, at], value,
                np.full(len(at), entry))


def _across(held: Held, jumps: list[Interface], problems: Problems) -> Circuits:
    """Nodes that the jumps make one; adds a problem where they do not add up round a circuit."""
    label, steps = held.label, len(held.values)
    count = int(label.max()) + 1
    shift = np.zeros((steps, count, 3))
    if not jumps:
        return Circuits(jumps, np.arange(count), shift)
    one, two = (label[np.concatenate(side)] for side in zip(*map(held.numbering.sides, jumps)))
    whose = np.repeat(np.arange(len(jumps)), [len(i.global_nodes) for i in jumps])
    # (T, edges, 3)
    apart = np.stack([[law.given_jump for law in i.laws(steps)] for i in jumps])[whose].swapaxes(
        0, 1)
    group = components(one, two, count)[1]
    known = np.zeros(count, dtype=bool)
    known[np.unique(group, return_index=True)[1]] = True
    # from each known label to those beside it: as many rounds as bodies in a row
    while not known.all():
        for a, b, sign in ((one, two, 1), (two, one, -1)):
            new = known[a] & ~known[b]
            shift[:, b[new]] = shift[:, a[new]] + sign * apart[:, new]
            known[b[new]] = True
    left = np.abs(shift[:, two] - shift[:, one] - apart).max(axis=2)
    off = left > TOLERANCE * np.abs(apart).max(axis=(1, 2), initial=0.0)[:, None]
    if off.any():
        step, edge = np.unravel_index(int(left.argmax()), left.shape)
        first, bodies = jumps[whose[edge]], np.unique(whose[group[one] == group[one[edge]]])
        where = held.mesh.nodes[first.global_nodes[edge - np.searchsorted(whose, whose[edge])]]
        entries = sorted({jumps[k].entry for k in bodies})
        problems.add(("interfaces", first.entry),
                     "jumps that do not add up round a closed circuit of parts, at "
                     f"{format_point(where)} and {off.any(axis=0).sum()} pairs of nodes: "
                     f"{' and '.join(f'interfaces[{e}]' for e in entries)}, between "
                     f"{some(sorted({jumps[k].name for k in bodies}))}, are off by "
                     f"{left[step, edge]:.3g} at load step {step + 1}",
                     "jumps that sum up to zero round every edge at which parts meet; bonds count "
                     "as none",
                     "let the jump go on to the surface of the assembly: impose it beyond that "
                     "edge, too; or let parts open there, by law: contact or elastic")
    return Circuits(jumps, group, shift)


def _contradictions(held: Held, circuits: Circuits, rows: Told, of: np.ndarray, wrong: np.ndarray,
                    left: np.ndarray,
                    problems: Problems) -> None:
    """Adds a problem for each set of entries that contradict each other.

    of : (R,) int, groups; wrong : (T, R) bool; left : (T, R)
    """
    bad = np.unique(of[wrong.any(axis=0)])
    found: dict[tuple[int, ...], list[int]] = {}
    for one in bad[:1000]:  # only where something is wrong
        found.setdefault(tuple(np.unique(rows.entry[of == one]).tolist()), []).append(int(one))
    for entries, groups in found.items():
        own = np.flatnonzero(of == groups[0])
        where = held.mesh.nodes[held.numbering.nodes[rows.node[own[0]]]]
        step = int(left[:, own].max(axis=1).argmax())
        said = [
            f"boundary[{rows.entry[r]}] prescribes {rows.value[step, r]:.6g} along "
            f"{format_point(rows.direction[r])}" for r in own]
        between = sorted({f"interfaces[{i.entry}]" for i in circuits.jumps
                          if (circuits.group[held.label[held.numbering.sides(i)[0]]]
                              == groups[0]).any()})
        problems.add(("boundary", entries[-1]), f"{' and '.join(f'boundary[{e}]' for e in entries)}"
                     + (f", with the jump of {' and '.join(between)}," if between else "")
                     + f" contradict each other on {len(groups)} nodes, the first at "
                     f"{format_point(where)}: {', '.join(dict.fromkeys(said))}, at load step "
                     f"{step + 1}",
                     "directions and values that one displacement meets",
                     "free one of the directions there with null, select faces that do not meet"
                     + (", or prescribe what differs by the jump" if between else ""))


CURVED = 0.2  # of a jump, what may point into a curved side: normals at nodes are means of facets


def check_sides(held: Held, interfaces: Sequence[Interface], problems: Problems) -> None:
    """Adds a problem for each interface whose sides are prescribed to do what its law forbids
    whatever the force.

    Bonds and jumps of paired nodes are judged by ``check_agreement``.
    """
    mesh, held_by, prescribed = held.mesh, held.by, held.values
    slack = TOLERANCE * held.changes()
    for i in interfaces:
        if i.matching and i.law.given_jump is not None:
            continue
        own = held.numbering.sides(i)
        if not all((held_by[side] >= 0).any() for side in own):
            continue
        points, triangles = (mesh.nodes[i.global_nodes],
                             i.triangles) if i.matching else (
                                 i.surfaces.points[0], i.surfaces.triangles[0])
        at = np.arange(len(own[0]))
        place, others, weight, apart = (at, at[:, None], np.ones((len(at), 1)),
                                        np.zeros(len(at))) if i.matching else _opposite(i)
        one, two = own[0][place], own[1][others]
        known = (held_by[one] >= 0) & ((held_by[two] >= 0) | (weight == 0)[:, :, None]).all(axis=1)
        jump = np.einsum("pk,tpkc->tpc", weight, prescribed[:, two]) - prescribed[:, one]
        by = np.concatenate([held_by[one][:, None], held_by[two]], axis=1)  # (pairs, 1 + k, 3)
        same = i.law.perfect & (by == by[:, :1]).all(axis=1)
        size = np.maximum(np.abs(prescribed[:, one]).max(axis=2),
                          np.abs(prescribed[:, two]).max(axis=(2, 3)))
        allowed = TOLERANCE * size + (slack[by].max(axis=(1, 2))
                                      * (1 + apart
                                         / (TOLERANCE * (mesh.diagonal or 1.0)))[:, None]).T
        turned = np.array([bool(entry.prescribed) and entry.prescribed.field.turns
                           for entry in held.boundary])[by].any(axis=(1, 2))
        normals = node_normals(points, triangles)
        flat = facet_normals(points, triangles)[0]
        curved = (flat @ flat[0]).min() < 1 - TOLERANCE
        wrong = np.stack([law.forbids(d, known & ~same, normals[place], place)
                          for law, d in zip(i.laws(len(jump)), jump)])
        # what a frame prescribes differs between nodes and the facets between them
        share = np.where(turned, LITTLE, 0.0) * size
        if curved and i.law.given_jump is None:
            share = share + CURVED * np.linalg.norm(jump, axis=2)
        if not (bad := wrong > allowed + share).any():
            continue
        step, worst = np.unravel_index(int(np.where(bad, wrong, 0.0).argmax()), wrong.shape)
        entries = [held.boundary[e] for e in sorted({int(e) for e in by[worst].ravel() if e >= 0})]
        path = ("boundary", entries[-1].index) if i.tool is None else ("interfaces", i.entry)
        problems.add(path,
                     f"{' and '.join(entry.name for entry in entries)} on both sides of {i.name}, "
                     f"at {format_point(points[place[worst]])} and "
                     f"{len(np.unique(place[bad.any(axis=0)]))} nodes in all, move the second by "
                     f"{format_point(jump[step, worst])} against the first at load step "
                     f"{step + 1}, which law: {i.law.name} forbids, by {wrong[step, worst]:.3g}",
                     "displacements on both sides that the interface between them lets happen",
                     "prescribe the same on both, free a component of one with null, or select "
                     "faces that end before the other part")


def _opposite(interface: Interface) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places of the slave's corners on the master's facets.

    Returns place : (p,) int, nodes of the slave
    others : (p, 3) int, nodes of the master; weight : (p, 3) shares of these, that sum up to 1
    apart : (p,) how far the two places are from each other
    """
    s = interface.surfaces
    pairs = np.unique(np.c_[s.triangles[0][s.segments.slave, :3].ravel(),
                            np.repeat(s.segments.master, 3)], axis=0)
    place, facets, others = pairs[:, 0], s.facets[1], s.triangles[1][pairs[:, 1], :3]
    x, corners = s.points[0][place], s.points[1][others]
    weight = np.einsum("pvx,px->pv", facets.slopes[pairs[:, 1]], x - corners[:, 0])
    weight[:, 0] += 1.0
    inside = weight.min(axis=1) >= -TOLERANCE
    place, others, weight, x, corners = place[inside], others[inside], weight[inside], x[
        inside], corners[inside]
    weight = np.where(weight > TOLERANCE, weight, 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    return place, others, weight, np.linalg.norm(np.einsum("pk,pkx->px", weight, corners) - x,
                                                 axis=1)

"""Macro basis W: the few displacement fields per interface that the macro problem handles.

After Saint-Venant's principle, the force distributions orthogonal to the rigid motions and the
mean strains of an interface fade within its own size (paper, section 4.1.1, figure 4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.scene.interfaces.mortar.operators import Mortar

from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.interface.transfer import inverse
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.congruence import first_congruent
from orchestrator.scene.model import Scene
from orchestrator.linalg import svd
from orchestrator.method.interface.rows import peak

DROP = 1e-8  # singular values below this fraction of the largest are dependent fields


def interface_basis(points: np.ndarray, free: np.ndarray, kind: str) -> np.ndarray:
    """Orthonormal macro basis of one interface.

    points : (n, 3) float, nodes of the interface
    free : (n, 3) bool, components that are not prescribed; the others leave the basis
    kind : ``translations`` (3 fields), ``rigid`` (6), ``affine`` (12: rotations, extensions and
        shears included; 9 remain on a plane) or ``quadratic`` (30; 18 on a plane)

    (d, m) float, d free dofs, m ≤ number of fields: what is dependent has been dropped. But for
    rigid motions each column moves one component alone: products with the basis read a third of
    what they would otherwise
    """
    if kind == "rigid":
        return independent(macro_fields(points, kind)[free])
    fields = np.stack(monomials(points, kind), axis=-1)
    same = (free == free[:, :1]).all()
    parts = [independent(fields[of_one]) for of_one in free.T[: 1 if same else 3]] * (
        3 if same else 1)
    row, at = np.cumsum(free).reshape(free.shape) - 1, 0
    basis = np.zeros((free.sum(), sum(part.shape[1] for part in parts)))
    for component, part in enumerate(parts):
        basis[row[free[:, component], component], at : at + part.shape[1]] = part
        at += part.shape[1]
    return basis


def macro_fields(points: np.ndarray, kind: str) -> np.ndarray:
    """(n, 3, m) the fields at points (n, 3), parameters as of ``interface_basis``."""
    if kind == "rigid":
        return motions_about(points, *_box(points))
    return np.stack([m[:, None] * e for m in monomials(points, kind) for e in np.eye(3)], axis=-1)


def monomials(points: np.ndarray, kind: str) -> list[np.ndarray]:
    """Functions (n,) at points (n, 3) that every component may follow; all but ``rigid``."""
    centre, size = _box(points)
    x, y, z = ((points - centre) / size).T
    one = np.ones_like(x)
    return {
        "translations": [one],
        "affine": [one, x, y, z],
        "quadratic": [one, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x],
    }[kind]


def _box(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Mean (3,) of points (n, 3), and how far from it a coordinate goes."""
    centre = points.mean(axis=0)
    return centre, max(peak(points - centre), np.finfo(float).tiny)


def independent(basis: np.ndarray) -> np.ndarray:
    """(d, m') orthonormal columns that span those of (d, m)."""
    if not basis.size:
        return np.zeros((basis.shape[0], 0))
    left, singular, _ = svd(basis, full_matrices=False)
    return left[:, singular > DROP * singular[0]]


def jump_free_basis(mortar: Mortar, points: tuple[np.ndarray, np.ndarray], free: np.ndarray,
                    kind: str) -> np.ndarray:
    """Orthonormal macro basis of an interface whose nodes do not match: both sides together,
    without any jump.

    The fields are those of ``interface_basis`` on the master and on slave nodes that are no points;
    points follow, so that G₁ W₁ = G₂ W₂ also beside what is prescribed. Fields that are cut there
    on each side by themselves open the interface a little, and the iterations never get beyond
    that.

    points : (n₁, 3), (n₂, 3) nodes of either side; free : (n₁, 3) bool, of the slave
    kind : as there

    (3 n₁ + 3 n₂, m) float
    """
    if mortar.paired:
        basis = interface_basis(points[0], free & mortar.free, kind)
        both = np.zeros((*free.shape, basis.shape[1]))
        both[free & mortar.free] = basis
        return np.tile(both.reshape(free.size, -1), (2, 1)) / np.sqrt(2)
    fields, slave = macro_fields(np.vstack(points), kind), 3 * len(points[0])
    everything = np.concatenate([free.ravel(), mortar.free.ravel()])
    fields = np.where(everything[:, None], fields.reshape(len(everything), -1), 0.0)
    jump = mortar.second @ fields[slave:] - mortar.first @ fields[:slave]
    fields[:slave] += mortar.hats @ (inverse(mortar) @ jump)
    return independent(fields)


def interface_bases(scene: Scene, space: TraceSpace, kind: str, wanted: Sequence[bool],
                    share: bool) -> list[np.ndarray]:
    """Per interface (d, m) macro basis, without columns where none is wanted; of interfaces of
    other ranks alone (0, 0).

    share : interfaces equal up to a translation share theirs
    """
    points = [scene.points(i) for i in scene.interfaces]
    alike: list[object] = list(range(len(points)))
    if share:
        alike = [i.index if i.mortar is not None else (bool(taken), i.free.tobytes())
                 for i, taken in zip(scene.interfaces, wanted)]
    first = first_congruent(alike, points) if share else alike
    bases: list[np.ndarray] = []
    for index, (interface, taken) in enumerate(zip(scene.interfaces, wanted)):
        if first[index] < index:
            bases.append(bases[first[index]])
        elif not len(points[index]):
            bases.append(np.zeros((0, 0)))
        else:
            if interface.mortar is None:
                basis = interface_basis(points[index], interface.free, kind)
            else:
                free = ~scene.subdomains[interface.subdomains[0]].fixed[interface.nodes[0]]
                basis = jump_free_basis(interface.mortar,
                                        tuple(scene.side_points(interface, side)
                                              for side in (0, 1)), free, kind)
            bases.append(basis if taken else basis[:, :0])
    return as_given(space, bases)


def as_given(space: TraceSpace, bases: list[np.ndarray]) -> list[np.ndarray]:
    """The same; between ranks, the rank of the first side has made the basis and gives it to the
    other.

    Made on both, it would be the same up to rounding only, and some of its columns up to a
    rotation.
    """
    if space.team.size == 1:
        return bases
    given = {index: bases[index] for index, (_, two) in enumerate(space.sides) if len(two)
             and two[0] >= space.size}
    result = list(bases)
    for gift in space.team.all_gather(given):
        for index, basis in gift.items():
            if len(space.sides[index][0]):
                result[index] = basis
    return result

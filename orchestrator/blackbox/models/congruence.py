"""Which models answer for each other: the same but for a translation, and images, turned, mirrored, numbered otherwise.

Elasticity does not notice a translation: slices of a beam, the cells of a grid or the soles of equal cuts share stiffness,
factorisation and every answer to equal forces. Isotropic elasticity notices no quarter turns and mirrors either: with a signed
permutation Q of the axes, nodes y' = Q y + c and the same tets, moduli and clamped dofs, forces Q f are answered by Q u. Of the 27
kinds of subdomains of a cut cube 13 are left. Every node, tet, modulus and clamped dof is compared before one model answers for
another; what only looks alike is solved by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import permutations, product

import numpy as np

from orchestrator.blackbox.protocol import Model, Traits
from orchestrator.scene.congruence import NEAR, SAME, equal, first_congruent

_COMPARED = ("name", "nodes", "region", "materials", "origin")  # by value or not at all; all else must be identical
_AXES = np.array([axes for axes in permutations(range(3)) for _ in range(8)])  # (48, 3) and the signs that go with them
_SIGNS = np.array([signs for _ in range(6) for signs in product((1.0, -1.0), repeat=3)])
_TURNS = np.zeros((48, 3, 3))  # Q
_TURNS[np.arange(48)[:, None], np.arange(3), _AXES] = _SIGNS
_PROBE = np.sqrt([2.0, 3.0, 5.0])  # along it no two nodes of a lattice meet


def representatives(models: Sequence[Model], traits: Callable[[int], Traits]) -> np.ndarray:
    """(models,) int, the first model that each one is congruent to.

    Numberings must agree: a model whose nodes or tets come in another order counts as different. So do models whose
    code is not known to be indifferent to where they are and what they are called.

    Parameters
    ----------
    traits : of the code of a model, by ``Model.code``, as a black box tells them
    """
    invariant = {code: traits(code).translation_invariant for code in {m.code for m in models}}
    keys = (_key(model) if invariant[model.code] else number for number, model in enumerate(models))
    return first_congruent(keys, [model.nodes for model in models],
                           lambda i, j: _same_matter(models[i], models[j]))


def _key(model: Model) -> Hashable:
    """Numbering, clamped dofs, trace, and whatever else a model may come to hold."""
    rest = (getattr(model, f.name) for f in fields(model) if f.name not in _COMPARED)
    return (model.nodes.shape, *((v.shape, v.tobytes()) if isinstance(v, np.ndarray) else v for v in rest))


def _same_matter(one: Model, other: Model) -> bool:
    return equal(one.materials[one.region], other.materials[other.region])


@dataclass(frozen=True)
class Image:
    """How the dofs of a model are those of another one: u[d] = sign[d] · u_other[source[d]], forces alike.

    Parameters
    ----------
    source : (n,) int
    sign : (n,) float, 1 or −1
    """

    source: np.ndarray
    sign: np.ndarray

    def to_other(self, rows: np.ndarray) -> np.ndarray:
        """Forces (rows, n) on this model as forces on the other one."""
        result = np.empty_like(rows)
        result[:, self.source] = rows * self.sign
        return result

    def back(self, rows: np.ndarray) -> np.ndarray:
        """Answers (rows, n) of the other model as this one's."""
        return rows[:, self.source] * self.sign

    def on(self, dofs: np.ndarray, others: np.ndarray) -> Image:
        """The same on some dofs, which are the other model's dofs ``others`` in another order."""
        place = np.empty(len(self.source), dtype=int)
        place[others] = np.arange(len(others))
        return Image(place[self.source[dofs]], self.sign[dofs])


def images(models: Sequence[Model], numbers: Sequence[int]) -> dict[int, tuple[int, Image]]:
    """Of those models that are images of an earlier one: which, and how. That one is no image itself.

    Parameters
    ----------
    numbers : ascending, which of the models to look at: isotropic ones, whose codes do not notice where they are
    """
    alike: dict[tuple, list[int]] = {}
    for i in numbers:
        m = models[i]
        alike.setdefault((m.code, m.nodes.shape, m.cells.shape, int(m.fixed.sum()), len(m.trace), m.materials.shape), []).append(i)
    found: dict[int, tuple[int, Image]] = {}
    for members in (np.array(m) for m in alike.values() if len(m) > 1):
        sizes = np.array([_size(models[i]) for i in members])
        order = np.argsort(sizes, kind="stable")
        apart = np.diff(sizes[order]) > NEAR * sizes[order[1:]]
        for cluster in np.split(members[order], np.flatnonzero(apart) + 1):
            if len(cluster) > 1:
                _assign(np.sort(cluster).tolist(), models, found)
    return found


def _size(model: Model) -> float:
    """The same for all images: how far nodes are from their mean, weighted by the moduli's mean."""
    apart = model.nodes - model.nodes.mean(axis=0)
    moduli = np.bincount(model.region, minlength=len(model.materials)) @ model.materials
    return float(np.einsum("ij,ij->", apart, apart) * (moduli[0] + moduli[1] * moduli[0]))


def _assign(members: Sequence[int], models: Sequence[Model], found: dict[int, tuple[int, Image]]) -> None:
    """Note for members, ascending, the first one that each is an image of."""
    originals: list[tuple[int, _Shape]] = []
    for i in members:
        shape = _Shape(models[i])
        for first, other in originals:
            image = shape.image_of(other)
            if image is not None:
                found[i] = first, image
                break
        else:
            originals.append((i, shape))


class _Shape:
    """What is compared of a model, about the mean of its nodes and relative to its extent."""

    def __init__(self, model: Model):
        self.model, self.extent = model, float(np.ptp(model.nodes, axis=0).max()) or 1.0
        self.nodes = (model.nodes - model.nodes.mean(axis=0)) / self.extent
        x, young = self.nodes[model.cells[:, :4]], model.materials[model.region, 0]
        young, total = young / young.max(), x[:, 0] + x[:, 1] + x[:, 2] + x[:, 3]
        # where clamped dofs and stiff tets are, and which way the tets' edges run: few turns bring these upon each other
        self.vectors = np.stack([model.fixed.sum(axis=1) @ self.nodes, young @ total])
        weighted = (x * young[:, None, None]).reshape(-1, 3)
        self.tensor = 4 * weighted.T @ x.reshape(-1, 3) - (total * young[:, None]).T @ total
        # soles overlap with bodies: nodes in one place are told apart by where their tets are
        flat, count = model.cells.ravel(), model.cells.shape[1]
        around = np.stack([np.bincount(flat, np.repeat(t, count), len(self.nodes)) for t in total.T], axis=1)
        self.places = self.nodes + around / len(model.cells)
        self.order = np.argsort(self.places @ _PROBE, kind="stable")

    @cached_property
    def tets(self) -> tuple[np.ndarray, np.ndarray]:
        """See ``_tets``."""
        return _tets(self.model.cells)

    def image_of(self, other: _Shape) -> Image | None:
        """How this one is an image of another one, if it is."""
        rounding = NEAR * len(self.model.cells) * 16  # of sums of so many terms of at most 1
        near = (np.abs(np.einsum("qab,vb->qva", _TURNS, other.vectors) - self.vectors).max(axis=(1, 2)) <= rounding)
        near &= np.abs(_TURNS @ other.tensor @ _TURNS.transpose(0, 2, 1) - self.tensor).max(axis=(1, 2)) <= rounding
        for axes, signs in zip(_AXES[near], _SIGNS[near]):
            node = np.empty(len(self.order), dtype=int)
            node[self.order] = np.argsort((other.places[:, axes] * signs) @ _PROBE, kind="stable")
            if np.abs(other.nodes[node][:, axes] * signs - self.nodes).max() <= SAME:
                source = (3 * node[:, None] + axes).ravel()
                if self._same(other, node, source):
                    return Image(source, np.tile(signs, len(node)))
        return None

    def _same(self, other: _Shape, node: np.ndarray, source: np.ndarray) -> bool:
        """Whether tets, moduli, clamped dofs and traces are the other model's, its nodes being these in another order."""
        mine, model = self.model, other.model
        if (mine.fixed.ravel() != model.fixed.ravel()[source]).any():
            return False
        traced = np.zeros((2, len(source)), dtype=bool)
        traced[0, source[mine.trace]], traced[1, model.trace] = True, True
        if (traced[0] != traced[1]).any():
            return False
        (one, own), (two, others) = _tets(node[mine.cells]), other.tets
        if (one != two).any():
            return False
        own, others = (m.materials[m.region[rows]] for m, rows in ((mine, own), (model, others)))
        return bool((np.abs(own - others) <= SAME * np.abs(others)).all())


def _tets(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tets (m, 4 or 10) in an order that depends neither on theirs nor on that of their corners, and that order (m,)."""
    corners = np.sort(cells[:, :4], axis=1)
    rest = [corners]
    if cells.shape[1] == 10:  # which node is in the middle of which edge
        ends = np.array([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
        edges = np.sort(cells[:, ends], axis=2)
        along = np.lexsort((edges[..., 1], edges[..., 0]), axis=1)
        rest.append(np.take_along_axis(cells[:, 4:], along, axis=1))
    count = int(cells.max(initial=0)) + 1
    if count**4 < np.iinfo(np.int64).max:  # one number for each is sorted several times faster
        order = np.argsort(((corners[:, 0] * count + corners[:, 1]) * count + corners[:, 2]) * count + corners[:, 3])
    else:
        order = np.lexsort(corners.T)
    return np.hstack(rest)[order], order

"""Guard on the black box's answers: what a symmetric, positive solver cannot answer is reported at
once.

For boundary loads f and answers u = C f of one subdomain, C = N M⁻¹ Nᵀ = (S + k)⁻¹:

- reciprocity (Betti): fᵀu' = f'ᵀu for two loads f, f' and their answers;
- strain energy: fᵀu − uᵀk u = uᵀS u ≥ 0: what the soles do not store, the subdomain itself does.

Traces w = N u and what the soles answer to them, k w, are formed on the way; ``answered`` hands
them on.

Matter of a code's own: what all else relies on is shown for each subdomain at set-up, since nothing
is known of it beforehand.

- K ≥ 0 on the body alone. With its soles it may be positive even where it is not, and then
converge, to an answer whose
  error no bound holds.
- K is a sum over tets: its rows on supports and interfaces, which energies, bound and reactions
use, are those of the tets
  there alone.

Symmetry and rigid motions are tested where stiffness arrives, see ``blackbox.guard``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.blackbox.models import body_model
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import assembled
from orchestrator.errors import BlackBoxError
from orchestrator.kept import key_of
from orchestrator.method.sparse.symmetric import is_semidefinite
from orchestrator.method.interface.rows import peak, ratio, ColumnSegments, times
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.linear.loading import RimStiffness
from orchestrator.scene.conditions.rigid import motions
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.model import Scene, Subdomain

# Relative. Sound codes stay below 1e-10; answers rounded to six digits, as text gives them, below
# 1e-5.
CONSISTENT = 1e-3
DIGITLESS = np.finfo(float).tiny / np.finfo(float).eps  # below it numbers lose digits


class GuardedTraces(BlackBox):
    """A black box every answer of whose ``traces`` is judged, at the cost of products on boundary
    dofs.

    inner : where the answers come from
    direction : search direction
    names : of the subdomains, in the order of its ``space.subdomains``
    solved : back-substitutions per subdomain so far, of all subdomains at once
    """

    def __init__(self, inner: BlackBox, direction: SearchDirection, names: list[str]):
        super().__init__(inner)
        self.solved = 0
        self.names, self.direction, self.parts = names, direction, direction.space.boundary
        self.all = ColumnSegments(self.parts)  # the boundary dofs of the subdomains
        # a load of each subdomain and its answer
        self.earlier = np.zeros((2, len(self.all.member)))
        self.known = np.zeros(len(self.parts), dtype=bool)  # which of them have one
        self.own: dict[int, sp.csr_array] = {}

    @property
    def key(self) -> bytes:
        space = self.direction.space
        return key_of([self.inner, self.direction.k, space.gather, space.owner, space.global_dof])

    @cached_property
    def owned(self) -> ColumnSegments:
        """The trace dofs of the subdomains."""
        return ColumnSegments(self.direction.space.parts)

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says.

        Raises BlackBoxError: also for an answer that no elastic body gives, naming the subdomain
        """
        answers, judged = self.inner.traces(forces), {}
        first = {(id(forces[e]), id(u)): e for e, u in reversed(answers.items()) if u.size}
        unknown = [e for e in first.values() if e not in self.own]
        self.own |= zip(unknown, self.direction.robin_blocks(unknown))
        for e, u in answers.items():
            f, part = np.asarray(forces[e]), self.parts[e]
            which = id(f), id(u)
            if which in judged:  # one and the same array: nothing new to be seen
                self.earlier[:, part] = self.earlier[:, self.parts[judged[which]]]
                self.known[e] = self.known[judged[which]]
            elif f.size:
                judged[which] = e
                self._judge(f, u, times(self.own[e], u), ColumnSegments([slice(0, f.shape[1])]),
                            [e], part)
        return answers

    def all_traces(self, forces: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """As ``BlackBox`` says, and as ``traces`` does, all subdomains at once."""
        return self.answered(forces)[0]

    def answered(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Answers u (rows, B) of all subdomains to boundary forces (rows, B), with w = N u and k w,
        (rows, D) each.

        They are the caller's to change.
        """
        answers, space = self.inner.all_traces(forces, self.parts), self.direction.space
        self.solved += len(forces)
        w = space.trace(answers)
        kw = self.direction.times(w)
        if len(forces):
            self._judge(forces, answers, space.loads(kw), self.all, self.all.subdomains,
                        slice(None))
        return answers, w, kw

    def _judge(self, f: np.ndarray, u: np.ndarray, ku: np.ndarray, of: ColumnSegments,
               subdomains: Sequence[int], part: slice) -> None:
        """Loads, answers and what the soles answer to these, (rows, columns) each.

        of : whose the columns are, one after the other
        subdomains : which these are
        part : the boundary dofs that the columns are
        """
        # per unit of the load: products of small ones would underflow, and denormal numbers have no
        # digits to compare
        unit = of.largest(f)
        sound = (unit > DIGITLESS) & (of.largest(u) > DIGITLESS)
        if not sound.any():
            return
        inverse = of.spread(ratio(1, unit, sound))
        f, u, ku = f * inverse, u * inverse, ku * inverse
        (work, size), stored = of.products(f, u), of.sums(u * ku)
        least = np.minimum(work, work - stored)
        wrong = sound & (least < -CONSISTENT * size)
        if wrong.any():
            t, e = np.argwhere(wrong)[0]
            raise BlackBoxError(
                f"guard: a negative strain energy: {least[t, e]:.1e} where a load of at most 1 on "
                f"a node does work of up to {size[t, e]:.1e}", self.names[subdomains[e]])
        first, last = sound.argmax(axis=0), len(sound) - 1 - sound[::-1].argmax(axis=0)
        any_sound, known = sound.any(axis=0), of.spread(self.known[subdomains])
        new_f, new_u = of.rows(f, last), of.rows(u, last)
        old_f, old_u = self.earlier[:, part]
        if not known.all():
            old_f, old_u = np.where(known, old_f,
                                    of.rows(f, first)), np.where(known, old_u, of.rows(u, first))

        one, other = of.sums(old_f * new_u), of.sums(new_f * old_u)
        # loads of other symmetry do no work on each other: the sums are mere rounding then
        norms = [np.sqrt(of.sums(x * x)) for x in (old_f, new_u, new_f, old_u)]
        exchanged = norms[0] * norms[1] + norms[2] * norms[3]
        wrong = any_sound & (np.abs(one - other) > CONSISTENT * exchanged)
        if wrong.any():
            e = int(np.argmax(wrong))
            raise BlackBoxError(
                f"guard: answers to two loads that are not reciprocal: {one[e]:.4g} and "
                f"{other[e]:.4g} for loads of at most 1 on a node", self.names[subdomains[e]])
        for old, new in zip(self.earlier[:, part], (new_f, new_u)):
            np.copyto(old, new, where=of.spread(any_sound))
        self.known[subdomains] |= any_sound


# Relative: below any mode that a slender body has, above what assembling leaves. Missing digits
# show in rigid motions, and
# may make an eigenvalue negative by some of what they cost.
ROUNDING, DIGITS = 1e-12, 10.0
LOCAL = 1e-8  # of a row's diagonal entry: what two assemblies of the same tets may differ by


def own_stiffness(scene: Scene, own: Sequence[Subdomain], blackbox: BlackBox,
                  share: bool) -> dict[int, sp.csr_array]:
    """Index in ``own`` → stiffness of the body, for this rank's subdomains whose matter is their
    code's own; others as for
    ``assembled``. Parts whose mesh is not ours have been judged when they were read."""
    chosen = [e for e, s in enumerate(own) if not s.foreign and blackbox.traits(s.code).own_matter]
    return dict(
        zip(chosen,
            assembled([body_model(scene, own[e]) for e in chosen], blackbox, share)))


def check_own_matter(scene: Scene, own: Sequence[Subdomain], found: Mapping[int, sp.csr_array],
                     rims: Sequence[RimStiffness],
                     traces: Sequence[np.ndarray]) -> None:
    """Judge the stiffness of bodies whose matter is their code's own.

    own : this rank's subdomains, with their rims
    found : of ``own_stiffness``
    traces : per subdomain (t,) boundary dofs whose rows are complete in its rim; those of
        prescribed dofs always are
    Raises BlackBoxError: a stiffness that is not ≥ 0, or none that is a sum over tets
    """
    seen: set[int] = set()
    for e, one in found.items():
        rows = np.union1d(np.flatnonzero(own[e].fixed), traces[e])
        points = scene.mesh.nodes[own[e].nodes]
        if wrong := _not_local(one, rims[e], rows,
                               points) or (id(one) not in seen and _not_positive(one, points)):
            raise BlackBoxError(f"guard: {wrong}", own[e].name)
        seen.add(id(one))


def _not_positive(K: sp.csr_array, points: np.ndarray) -> str:
    """Return what a stiffness (3n, 3n) that is not ≥ 0 does, in words; empty where it is."""
    rigid, scale = motions(points - points.mean(axis=0)).reshape(-1, 6), np.abs(K.diagonal())
    rigid = rigid / np.abs(rigid).max(axis=0)
    cost = np.abs(K @ rigid).max(axis=1) / np.where(scale > 0, scale, scale.max(initial=0.0) or 1.0)
    if is_semidefinite(K, ROUNDING + DIGITS * peak(cost)):
        return ""
    value, node = _least(K)
    return (
        f"a stiffness that is not positive: displacements near {format_point(points[node])} give "
        f"energy away (least eigenvalue {value:.3g}, largest diagonal entry "
        f"{K.diagonal().max():.3g}); no error bound holds there. Look for a modulus or a shear "
        "modulus below zero, a Poisson's ratio out of range, a pre-stress")


def _least(K: sp.csr_array) -> tuple[float, int]:
    """About the least eigenvalue, and the node that moves most in its mode."""
    if K.shape[0] <= 600:
        values, vectors = np.linalg.eigh(K.toarray())
    else:
        try:
            values, vectors = sla.eigsh(K, k=1, which="SA", tol=1e-3)
        except sla.ArpackNoConvergence:
            least = int(np.argmin(K.diagonal()))
            return float("nan"), least // 3
    return float(values[0]), int(np.argmax(np.abs(vectors[:, 0]))) // 3


def _not_local(K: sp.csr_array, rim: RimStiffness, rows: np.ndarray, points: np.ndarray) -> str:
    """How rows of a body's stiffness differ from those of its rim, in words; empty where they do
    not.
    """
    if not len(rows):
        return ""
    place = np.zeros(K.shape[0], dtype=int)
    place[rim.dofs] = np.arange(len(rim.dofs))
    part = sp.coo_array(rim.stiffness[place[rows]])
    same = sp.csr_array((part.data, (part.row, rim.dofs[part.col])), shape=(len(rows), K.shape[0]))
    apart = np.abs(K[rows] - same).max(axis=1).toarray().ravel() / np.maximum(
        np.abs(K.diagonal()[rows]), np.finfo(float).tiny)
    worst = int(np.argmax(apart))
    if apart[worst] <= LOCAL:
        return ""
    return (
        f"a stiffness that is no sum over tets: near {format_point(points[rows[worst] // 3])} it "
        f"is another one, by {apart[worst]:.1e}, where the tets there are asked for alone; what it "
        "is made of has to be known of each tet by itself (not the mesh's size, its volume, its "
        "name, or averages over neighbours). Or it varies from place to place and says that it "
        "does not: leave uniform: true out, or translation_invariant = True in the solver's class")

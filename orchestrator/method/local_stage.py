"""Local stage: from admissible fields to ŵ and f̂ that satisfy the interface laws (paper, eq. 3, 7
and 10), and the next state.

On perfect interfaces ŵ is continuous and f̂ balanced. For a search direction k⁺ on each side,

    ŵ = (k⁺ + k⁺')⁻¹ (k⁺ w + k⁺' w' − f − f'),      f̂ = f − k⁺(w − ŵ),      s = f̂ + k⁻ŵ

- ``exchange``: k⁺ is the neighbour's sole. Then s = k⁻ w' − f' and nothing is factorised: the
two-sided
  optimised Schwarz method. With symmetric soles it is the same as ``full``.
- ``full``: one's own sole, k⁺ = k⁻; a factorisation per interface.
- ``diagonal``: its diagonal, which makes the stage pointwise, as the paper does.

Where nodes do not match there is no exchange, and k⁺ = k⁻ whatever is chosen: ŵ are the traces
without jump that are ``Nearest``, f̂ = −Bᵀ q. Where nodes match and both sides have the same sole
that is the exchange.

Where some interfaces are not perfect their laws answer pointwise, swept through the load steps. The
laws' history lives here alone: the linear stage stays parallel over the load steps. At points with
the jump d, from the predicted force F to the traces as ``point_traces`` has it:

    f̂ = law(F),   d = (F − f̂)/keq
    stabilised:   f̂ = (1 − ε) law(F) + ε (F − keq d₀), see ``stabilisation``
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import BONDED
from orchestrator.method.sparse.symmetric import factorise
from orchestrator.method.interface.node_groups import NodeGroups
from orchestrator.method.interface.node_stage import NodeStage
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.point_traces import PointTraces
from orchestrator.method.interface.rows import joined, times
from orchestrator.method.interface.search_direction import Nearest, SearchDirection, conditioning
from orchestrator.method.linear.stage import Admissible


@dataclass
class LocalState:
    """Result of a local stage: an element of the set ℒ, eq. 9."""

    s: np.ndarray  # (T, D) next state f̂ + k⁻ŵ
    # ŵ, f̂ and k⁻ŵ, (T, D) each, where they were formed
    hats: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    force: np.ndarray | None = None  # (T, 3, P) f̂ on side 1 of each pair that is not perfect
    # (T, 3, P) what its law alone asks for; f̂ itself but for the stabilisation
    lawful: np.ndarray | None = None
    jump: np.ndarray | None = None  # (T, 3, P) its jump d
    status: np.ndarray | None = None  # (T, P) int, what its law says it does
    # (T, P) bool, pairs that stand for a group no forces of which its laws were found to allow
    unsolved: np.ndarray | None = None
    # name → (T, P) the laws' own variables at the end of each load step
    own: dict[str, np.ndarray] = field(default_factory=dict)
    # the fields that it was made of at these pairs, for who measures it next
    at: PointTraces | None = field(default=None, repr=False)
    # these fields, the forces of bodies' nodes shared among their traces as the pairs have them;
    # None: as they were
    fields: Admissible | None = field(default=None, repr=False)

    def left(self, step: int = -1) -> History:
        """The past that the last of these load steps leaves to the next."""
        return History(self.jump[step], {name: x[step] for name, x in self.own.items()})

    def steps(self, chosen: slice) -> LocalState:
        """The state at some of the load steps, where interfaces are not perfect."""
        return LocalState(self.s[chosen], tuple(x[chosen] for x in self.hats),
                          *(x[chosen] for x in (self.force, self.lawful, self.jump, self.status,
                                                self.unsolved)),
                          own={name: x[chosen] for name, x in self.own.items()})

    @classmethod
    def joined(cls, batches: Sequence[LocalState]) -> LocalState:
        """The state of all load steps from those of batches of them, in order, where interfaces are
        not perfect.
        """
        return cls(np.vstack([b.s for b in batches]),
                   tuple(np.vstack(hats) for hats in zip(*(b.hats for b in batches))),
                   *(np.concatenate(parts)
                     for parts in zip(*((b.force, b.lawful, b.jump, b.status, b.unsolved)
                                        for b in batches))),
                   own={name: np.concatenate([b.own[name] for b in batches])
                        for name in batches[0].own})


class Exchange:
    """Local stage of perfect interfaces.

    direction : search direction k⁻
    kplus : "exchange", "full" or "diagonal"
    """

    def __init__(self, direction: SearchDirection, kplus: str = "exchange"):
        self.direction, self.kplus, transfer = direction, kplus, direction.space.transfer
        self._apart = [i for i in np.flatnonzero(transfer.perfect & ~transfer.matched)
                       if len(transfer.sides[i][0])]
        self._held = None if transfer.picks else direction.space.held_everywhere  # all ranks ask

    def __call__(self, fields: Admissible) -> LocalState:
        """Next state s = f̂ + k⁻ŵ from the traces of the linear stage."""
        if self.kplus == "exchange":
            return LocalState(self.exchanged(*fields.extended)[0])
        w_hat, f_hat = self.hats(*fields.extended)
        k_hat = self.direction.times(w_hat)
        return LocalState(f_hat + k_hat, (w_hat, f_hat, k_hat))

    def exchanged(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(T, D) s = k⁻ w' − f' of ``exchange``, w' and f', from traces with ghosts (T, D + G).

        Where nodes do not match w' = 2ŵ − w, f' = f − 2f̂, as they are elsewhere.
        """
        across = self.direction.space.transfer.across
        w_other, f_other = across(w), across(f)
        s = self.direction.times(w_other) - f_other
        if self._apart:
            at, s[:, at], w_hat, f_hat = self._nearest_to(w, f)
            w_other[:, at], f_other[:, at] = 2 * w_hat - w[:, at], f[:, at] - 2 * f_hat
        return s, w_other, f_other

    def hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂, each (T, D), eq. 10, from traces with ghosts (T, D + G)."""
        k, other, solve = self._factors
        own_w, own_f = (x[:, : k.shape[0]] for x in (w, f))
        across = self.direction.space.transfer.across
        w_hat = solve(times(k, own_w) - own_f + times(other, across(w)) - across(f))
        f_hat = own_f - times(k, own_w - w_hat)
        if self._apart:
            at, _, w_hat[:, at], f_hat[:, at] = self._nearest_to(w, f)
        return w_hat, f_hat

    @cached_property
    def lumped(self) -> Exchange:
        """The local stage with the diagonal of k⁻ in the place of k⁺: no factorisation."""
        return Exchange(self.direction, "diagonal")

    def _nearest_to(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, ...]:
        """This rank's trace dofs of interfaces whose nodes do not match, and s, ŵ and f̂ there."""
        dofs, nearest = self._nearest
        own = dofs < self.direction.space.size
        move, f_hat = nearest.moves(w[:, dofs], f[:, dofs])
        w_hat = w[:, dofs] + move
        return dofs[own], *(x[:, own] for x in (f_hat + times(nearest.k, w_hat), w_hat, f_hat))

    @cached_property
    def _nearest(self) -> tuple[np.ndarray, Nearest]:
        """Trace dofs of interfaces whose nodes do not match, ghosts included, and their problem."""
        transfer = self.direction.space.transfer
        dofs = joined([side for i in self._apart for side in transfer.sides[i]])
        points = joined([np.arange(transfer.bounds[i], transfer.bounds[i + 1])
                         for i in self._apart])
        return dofs, Nearest(sp.csr_array(self.direction.whole[dofs][:, dofs]),
                             sp.csr_array(transfer.B[points][:, dofs]), self._held[dofs])

    def counts(self, local: LocalState) -> dict[str, int]:
        """Nothing to count: perfect interfaces have one status."""
        return {}

    def conditioning(self) -> tuple[float, float]:
        """Extreme eigenvalues of (k⁻, k⁺); both 1 but for the diagonal."""
        if self.kplus != "diagonal":
            return 1.0, 1.0
        root = 1 / np.sqrt(self.direction.diagonal)
        return conditioning(self.direction.k, lambda x: root * x)

    @cached_property
    def _factors(self):
        """k⁺ of this side and of the other, seen from here, (D, D) each, and a solver of their
        sum.
        """
        if self.kplus == "diagonal":
            whole = sp.csr_array(sp.diags_array(self.direction.whole_diagonal))
            k, other = sp.csr_array(
                sp.diags_array(self.direction.diagonal)), self.direction.space.transfer.seen_across(
                    whole)
            both = k.diagonal() + other.diagonal()
            return k, other, lambda rows: rows / both
        k, other = self.direction.k, self.direction.other
        if self.kplus == "exchange":
            k, other = other, k
        if not (k - other).count_nonzero():  # symmetric soles: one factorisation serves both
            return k, other, lambda rows: 0.5 * self.direction.solve(rows)
        return k, other, factorise(sp.csr_array(k + other), patches=True)


class LawStage:
    """Local stage of a scene with interfaces that are not perfect.

    direction : search direction k⁻
    pairs : node pairs that a law answers for: those of all interfaces that are not perfect
    before : what the load step before the first one has left; None: nothing was before
    """

    def __init__(self, direction: SearchDirection, pairs: Pairs, before: History | None = None):
        self.direction, self.pairs, self.exchange = direction, pairs, Exchange(direction)
        self.before = History.none(len(pairs)) if before is None else before
        # once for all batches of load steps
        self._groups = cache(partial(NodeGroups.of, direction.space, self.joint))

    def conditioning(self) -> tuple[float, float]:
        """Extreme eigenvalues of (k⁻, k⁺) on the pairs; perfect interfaces exchange and are at
        1.
        """
        root = self.pairs.nodes.root
        at = np.flatnonzero(root.diagonal() > 0)
        root = root[at][:, at]
        return conditioning(self.direction.whole[at][:, at], lambda x: root @ x)

    @property
    def joint(self) -> Pairs:
        """The pairs, and behind them those of bonds that answer together with them."""
        return self.pairs.joint or self.pairs

    @cached_property
    def perfect(self) -> np.ndarray:
        """(q,) int, trace dofs of this rank that are exchanged: of perfect interfaces."""
        return np.flatnonzero(~self.joint.nodes.there[: self.direction.space.size])

    def __call__(self, fields: Admissible) -> LocalState:
        """Local stage for the fields of all steps."""
        pairs, joint, steps, count = self.pairs, self.joint, len(fields.s), len(self.pairs)
        w, f = fields.extended
        at, anchors = joint.traces(w, f), pairs.anchors(fields.anchor)
        F, before, own = at.predicted(), self.before, []
        nodes, met = self.meeting(w, f, anchors)
        chosen = np.zeros(0, int) if nodes is None else nodes.groups.chosen
        ours = chosen[chosen < count]
        bonds, F = F[:, :, count:], F[:, :, :count]
        force, jump, status = np.empty_like(F), np.empty_like(F), np.empty((steps, count), int)
        lawful = force if pairs.stabilisation is None else np.empty_like(F)
        for t in range(steps):
            anchor = before.jump if anchors is None else anchors[t]
            if nodes is not None:
                predicted, together = nodes.predicted(t)
                F[t][:, ours], bonds[t][:, chosen[len(ours):] - count] = np.split(
                    predicted, [len(ours)], axis=1)
            answer = pairs.force(F[t], before, pairs.numbers[t])
            force[t], jump[t] = pairs.settled(answer.force, F[t], anchor)
            if nodes is not None:
                jump[t][:, ours], nodes.before = together[:, : len(ours)], nodes.after
            lawful[t], status[t] = answer.force, answer.status
            before = History(jump[t], answer.own)
            own.append(answer.own)
        w_hat, f_hat = at.hats(force if joint is pairs else np.concatenate([force, bonds], axis=2))
        if met:
            fields = self._by_nodes(nodes, fields, w_hat, f_hat)
            w, f = fields.extended
        at = pairs.traces(w, f) if met or joint is not pairs else at
        alone = self.perfect
        if len(alone):
            exchanged, w_other, f_other = (x[:, alone] for x in self.exchange.exchanged(w, f))
            # what they tend to: the exchange itself forms none
            w_hat[:, alone] = 0.5 * (w[:, alone] + w_other)
            f_hat[:, alone] = 0.5 * (f[:, alone] - f_other)
        k_hat = self.direction.times(w_hat)
        s = f_hat + k_hat
        if len(alone):
            s[:, alone] = exchanged
        unsolved = np.zeros(status.shape, bool) if nodes is None else nodes.unsolved[:, :count]
        return LocalState(s, (w_hat, f_hat, k_hat), force, lawful, jump, status, unsolved,
                          {name: np.stack([each[name] for each in own]) for name in own[0]}, at,
                          fields if met else None)

    @property
    def groups(self) -> NodeGroups | None:
        """Pairs that share nodes of bodies; None where none do."""
        return self._groups()

    def meeting(self, w: np.ndarray, f: np.ndarray,
                anchors: np.ndarray | None) -> tuple[NodeStage | None, bool]:
        """This rank's groups at traces (T, D + G), None where there are none, and whether any rank
        has some; all ask together.
        """
        joint, nodes = self.joint, None
        if self.groups is not None:
            if anchors is not None:
                anchors = np.pad(anchors, ((0, 0), (0, 0), (0, len(joint) - len(self.pairs))))
            nodes = NodeStage(self.groups, joint, w, f, self.before.among(len(joint)), anchors)
        square, count = self.direction.space.team.sum(np.zeros((2, len(w))) if nodes is None
                                                      else nodes.left)[0]
        if nodes is not None:
            nodes.rms = np.sqrt(square / np.maximum(count, 1))
        return nodes, bool(count.any())

    def _by_nodes(self, nodes: NodeStage | None, fields: Admissible, w_hat: np.ndarray,
                  f_hat: np.ndarray) -> Admissible:
        """The same fields with forces shared as the pairs have them; writes ŵ at the groups'
        traces. Ghosts travel anew.
        """
        s, f, anchor = fields.s.copy(), fields.f.copy(), fields.anchor
        if nodes is not None:
            at, forces, moves = nodes.shared(self.direction.diagonal, f_hat)
            w_hat[:, at] = fields.w[:, at] + moves
            s[:, at] += forces - f[:, at]
            f[:, at] = forces
        fields = Admissible(s, fields.u, fields.alpha, fields.w, f, fields.space)
        fields.anchor = anchor
        return fields

    def counts(self, local: LocalState) -> dict[str, int]:
        """Per status that a law may give, this rank's pairs, summed over the steps; and of its
        groups, those that are unsolved.
        """
        mine = self.pairs.mine
        found = local.status if mine.all() else local.status[:, mine]
        return {**{status.name: int(np.count_nonzero(found == status))
                   for status in self.pairs.statuses if status != BONDED},
                "unsolved": int(local.unsolved.sum())}

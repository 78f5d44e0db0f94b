"""Self-stress where several interfaces meet at a node: forces that no body feels are what the laws make of them.

Forces δq = G λ in the loops of ``node_loops`` change no sum at any node: the linear stage answers with the same
displacements, whatever they are, and s and f change by them alone. The laws decide about them, and an iteration brings them
no nearer to what these say than a pair gains by itself: where a node slips by next to nothing, friction turns by
1 − μ p/|T| of its angle, a thousandth, and these modes are what is left of a run. Near its end, after every linear stage and
coarse contact problem, one step of Newton's method is taken in each group of pairs, at the jumps that are there, load step by load step:

    φ(λ) + δ λ = 0,    φ(λ) = Gᵀ keq⁻¹ (q + G λ − f̂(F + G λ)),    J = Gᵀ keq⁻¹ (1 − ∂f̂/∂F) G,    Gᵀ keq⁻¹ G = 1

It is taken by whole groups, and where it brings ‖φ + δ λ‖ down. Where pairs stick, whatever passes through them is a solution: there
φ = 0 up to what the jumps are apart, and δ keeps the forces where they are.

Where forces may pass through one pair as well as through another, φ does not change with them: a body that slides along two others that
stick to each other is carried by either, but its slip is along both faces only if these are exactly in line. If they are not, by ever so
little, the way out is that one of them lets go, and until then φ is constant. ‖φ‖ alone would refuse to go there, and without these steps
forces move by φ in an iteration; with them by φ/δ. Much friction makes J far from symmetric, with a symmetric part that is far from
positive where J's own eigenvalues are not negative. So J + δ is tried first, then a shorter step, and a shift that makes its symmetric part
positive where neither helps: without any, ten grains with μ = 1 did not converge.

Among ranks, groups that several of them have bodies at are summed and solved by all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.method.coarse.node_loops import Groups, node_loops
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local_stage import LawStage

# δ, over the pairs' own stiffness: small beside a force that slips far (1), large beside what jumps that have not met yet make
# of pairs that stick. Iterations to an energy error of 1e-4 of 27 grains, pressed, sheared and unloaded, two seeds with μ = 1 and one with
# .6: 95, 92, 54 with .003, 98, 93, 71 with .01; with .1 the first is not there after 250.
SHIFT = 3e-3
# Law residual, springs aside, once below which the next iterations take these steps: the same scenes end after 98, 93, 71 from 1e-3 on
# (δ = .01), two of them not within 250 from 1e-2 on, and with .6 after 99 from 1e-4 on.
RESTING = 1e-3
GAIN = 0.1  # share of ‖φ + δ λ‖ that a step has to gain
SHORTER = 0.3  # of a step that has not gained that


@dataclass
class _Family:
    """Groups of the same size on this rank.

    at : (n, m) int, their pairs among those chosen; 0 where this rank does not know one
    states : (n, 3m, r) G, zero there
    counted : (n, 3m, r) keq⁻¹ G at the pairs that this rank counts, zero elsewhere
    shared : (n,) bool, see ``Groups``
    """

    at: np.ndarray
    states: np.ndarray
    counted: np.ndarray
    shared: np.ndarray

    def sums(self, left: np.ndarray) -> np.ndarray:
        """(n, r, 1) Gᵀ keq⁻¹ of (Q, 3)."""
        if not len(left):  # of all these groups other ranks have the points
            return np.zeros((len(self.at), self.states.shape[2], 1))
        return self.counted.swapaxes(1, 2) @ left[self.at].reshape(*self.states.shape[:2], 1)

    def slopes(self, slope: np.ndarray) -> np.ndarray:
        """(n, r, r) Gᵀ keq⁻¹ A G of A (Q, 3, 3)."""
        n, m = self.at.shape
        if not len(slope):
            return np.zeros((n, *2 * self.states.shape[2:]))
        changed = slope[self.at] @ self.states.reshape(n, m, 3, -1)
        return self.counted.swapaxes(1, 2) @ changed.reshape(self.states.shape)


class SelfStress:
    """The self-stress of one decomposition.

    space : numbering
    pairs : of the interfaces that are not perfect, all load steps
    groups : of ``node_loops``
    """

    def __init__(self, space: TraceSpace, pairs: Pairs, groups: list[Groups]):
        self.team, self.size = space.team, space.size
        known = np.concatenate([np.empty(0, int), *(g.slots.reshape(-1) for g in groups)])
        self.chosen = np.unique(known[known >= 0])
        some = pairs.some(self.chosen)
        self.pairs = some
        points, mine = self.pairs.points, self.pairs.mine
        upright = points.normal.T[:, :, None] * points.normal.T[:, None, :]
        yields = upright / points.stiff_n[:, None, None] + (np.eye(3) - upright) / points.stiff_t[:, None, None]
        self.families = []
        for g in groups:
            there, at = g.slots >= 0, np.maximum(np.searchsorted(self.chosen, g.slots), 0)
            at = np.where(there, at, 0)
            states = g.states * there[:, :, None, None]
            counted = yields[at] @ states * mine[at][:, :, None, None] if len(yields) else states
            n, m, _, r = states.shape
            self.families.append(_Family(at, states.reshape(n, 3 * m, r), counted.reshape(n, 3 * m, r), g.shared))
        grams = self._of_all([f.counted.swapaxes(1, 2) @ f.states for f in self.families])
        for f, gram in zip(self.families, grams):
            turn = np.linalg.inv(np.linalg.cholesky(gram)).swapaxes(1, 2)
            f.states, f.counted = f.states @ turn, f.counted @ turn

    @classmethod
    def of(cls, space: TraceSpace, local: LawStage) -> SelfStress | None:
        """Where points are pairs of nodes everywhere; None where there is no self-stress."""
        pairs = local.pairs
        if not pairs.transfer.picks:
            return None
        groups = node_loops(space, pairs)
        anywhere, = space.team.max(bool(groups))
        return cls(space, pairs, groups) if anywhere else None

    def __call__(self, fields: Admissible, local: LawStage) -> Admissible:
        """Fields whose self-stress is nearer to what the laws say.

        local : the laws, at these load steps; the jumps before the first
        """
        w, f = fields.extended
        if self.pairs.stabilisation is not None:  # springs may have been weakened since
            self.pairs = replace(self.pairs, stabilisation=local.pairs.stabilisation[self.chosen])
        at, pairs, before = self.pairs.traces(w, f), self.pairs, local.before.take(self.chosen)
        F, q, f, anchors = at.predicted(), at.force, f.copy(), pairs.anchors(fields.anchor)
        one, two, free = pairs.transfer.one[pairs.free], pairs.transfer.two[pairs.free], pairs.free
        for t, number in enumerate(local.pairs.numbers):
            anchor = before.jump if anchors is None else anchors[t]
            change = self._step(F[t], q[t], before, number, anchor)
            answer = pairs.force(F[t] + change, before, number)
            before = History(pairs.settled(answer.force, F[t] + change, anchor)[1], answer.own)
            f[t, one] += change[free]
            f[t, two] -= change[free]
        s = fields.s + (f - fields.extended[1])[:, : self.size]
        return Admissible.of_extended(s, fields.u, fields.alpha, w, f, fields.space, fields.anchor)

    def _step(self, F: np.ndarray, q: np.ndarray, before: History, number: int, anchor: np.ndarray) -> np.ndarray:
        """(3, Q) δq in one load step, from the predicted forces F and the forces q (3, Q).

        anchor : (3, Q) jumps at which springs carry nothing
        """
        answer = self.pairs.force(F, before, number, derivative=True)
        share = np.ones(F.shape[1]) if self.pairs.stabilisation is None else 1 - self.pairs.stabilisation
        slope = np.repeat(np.eye(3)[None], F.shape[1], axis=0)
        slope[answer.active] -= answer.derivative.transpose(2, 0, 1)
        slope *= share[:, None, None]
        left = self._left(F, q, before, number, anchor, answer.force)
        everyones = self._of_all([x for f in self.families for x in (f.sums(left), f.slopes(slope))])
        sums, slopes = everyones[::2], everyones[1::2]
        steps = [np.zeros_like(phi) for phi in sums]
        for shift, length in ((_least, 1.0), (_least, SHORTER), (_positive, 1.0)):
            tried = [np.where(_moved(known), known, -length * np.linalg.solve(J + shift(J) * np.eye(J.shape[1]), phi))
                     for known, J, phi in zip(steps, slopes, sums)]
            change = self._change(tried, F.shape[1])
            left = self._left(F + change, q + change, before, number, anchor)
            after = self._of_all([f.sums(left) for f in self.families])
            good = [_size(new + SHIFT * step) <= (1 - GAIN) * _size(old) for new, step, old in zip(after, tried, sums)]
            steps = [step * taken[:, None, None] for step, taken in zip(tried, good)]
        return self._change(steps, F.shape[1])

    def _left(self, F: np.ndarray, q: np.ndarray, before: History, number: int, anchor: np.ndarray,
              lawful: np.ndarray | None = None) -> np.ndarray:
        """(Q, 3) q − f̂(F); ``lawful`` is law(F) where it is known."""
        if lawful is None:
            lawful = self.pairs.force(F, before, number).force
        return (q - self.pairs.settled(lawful, F, anchor)[0]).T

    def _change(self, steps: list[np.ndarray], count: int) -> np.ndarray:
        """(3, Q) G λ of λ (n, r, 1)."""
        result = np.zeros((count, 3))
        for f, step in zip(self.families if count else [], steps):
            moved = f.states @ step
            np.add.at(result, f.at, moved.reshape(*f.at.shape, 3))
        return np.ascontiguousarray(result.T)

    def _of_all(self, parts: list[np.ndarray]) -> list[np.ndarray]:
        """Values of groups, family after family as often as there are arrays of each, summed where ranks share them."""
        if self.team.size == 1:
            return parts
        each = len(parts) // max(len(self.families), 1)
        shared = [f.shared for f in self.families for _ in range(each)]
        flat = np.concatenate([np.empty(0), *(x[s].reshape(-1) for x, s in zip(parts, shared))])
        flat, = self.team.sum(flat)
        start = 0
        for x, s in zip(parts, shared):
            count = x[s].size
            x[s] = flat[start:start + count].reshape(x[s].shape)
            start += count
        return parts


def _least(J: np.ndarray) -> np.ndarray:
    """(n, 1, 1) δ."""
    return np.full((len(J), 1, 1), SHIFT)


def _positive(J: np.ndarray) -> np.ndarray:
    """(n, 1, 1) δ and what makes the symmetric part of slopes (n, r, r), which much friction makes indefinite, positive."""
    symmetric, least = 0.5 * (J + J.swapaxes(1, 2)), np.zeros(len(J))
    diagonal = np.einsum("nii->ni", symmetric)
    circles = diagonal + np.abs(diagonal) - np.abs(symmetric).sum(axis=2)  # Gershgorin's: most show that it is positive
    doubtful = circles.min(axis=1) < 0
    least[doubtful] = np.linalg.eigvalsh(symmetric[doubtful])[:, 0]
    return (SHIFT + np.maximum(-least, 0.0))[:, None, None]


def _moved(step: np.ndarray) -> np.ndarray:
    """(n, 1, 1) bool, groups whose steps (n, r, 1) are not zero."""
    return step.any(axis=(1, 2), keepdims=True)


def _size(phi: np.ndarray) -> np.ndarray:
    """(n,) ‖φ‖."""
    return np.linalg.norm(phi[:, :, 0], axis=1)

"""b² = hᵀS⁺h, the energy of forces h on the boundary of all subdomains, by conjugate gradients on
the black box.

S is the subdomains' Schur complement on their boundary, which nobody forms: N M⁻¹Nᵀ = (S + NᵀkN)⁻¹
is what the black box applies, and serves as the preconditioner, so that S p = (S + k) p − k p, of
which the first term follows by recurrence. Bodies do not feel each other: those of which what is
left counts no longer are not asked again, and few slender ones are all that remain.

The iterates approach from below; their geometric tail is added, and for its own error the accuracy
that they are stopped at. With stiff soles a² and b² are large and almost cancelled by the cross
term: the accuracy of the sum counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orchestrator.method.interface.rows import dots, ratio, ColumnSegments
from orchestrator.method.linear.stage import LinearStage
from orchestrator.method.stopping.known_answers import KnownAnswers

MAX_STEPS = 100  # of conjugate gradients; what is left then is told as the tail
LONGER = 3  # times the steps that would do, from which what is left need not be known from above
# of the smaller of E² and ‖S⁺h‖², what may be left of the latter where it is known from above: a
# twentieth of the error
LEFT = 0.1
# the same where the sum is small enough all the same: the error is told as at most 1.4 times what
# it is
MET = 0.5
IDLE = 0.1  # of what may be left in all, what bodies that are not asked again may keep together
CANCELLED = 1e-13  # of a sum of large terms, what rounding leaves
SLOWEST = 0.95  # rate of the conjugate gradients assumed at worst
SLOW = 1 / (1 - SLOWEST)  # what a body still gains at that rate, over what its next step does


@dataclass(frozen=True)
class Enough:
    """How well b² + rest has to be known.

    negligible : sum over the steps that is not worth being told from zero
    share : of the sum, what may be left where it is known from above
    met : every load step's sum below which ``MET`` of it may be left
    tail : of the sum, what a step of the conjugate gradients, or what is to come, may still add
    """

    negligible: float = 0.0
    share: float = LEFT
    met: float = 0.0
    tail: float = 0.02


class Dual(NamedTuple):
    """Bounds on hᵀS⁺h, T load steps.

    energy : (T,) of all subdomains; infinite where it is not reached
    sweeps : back-substitutions spent
    x, left, of : (T, B) S⁺h, nearly, without rigid motions, h − S x, and h
    towards, meant, size : (T, B) the last direction p and (S + k) p, and (T, S) rᵀM⁻¹r before it,
        None at first: the next step goes on from them
    above : whether the energy is known from above, with σ of the subdomains, or told by the steps'
        tail
    """

    energy: np.ndarray
    sweeps: int
    x: np.ndarray
    left: np.ndarray
    of: np.ndarray
    towards: np.ndarray | None = None
    meant: np.ndarray | None = None
    size: np.ndarray | None = None
    above: bool = False

    @classmethod
    def joined(cls, batches: Sequence[Dual]) -> Dual:
        """Of all load steps from batches of them, in order."""
        energy, x, left, of = (np.concatenate([getattr(b, name) for b in batches])
                               for name in ("energy", "x", "left", "of"))
        last = zip(*((b.towards, b.meant, b.size) for b in batches))
        return cls(energy, sum(b.sweeps for b in batches), x, left, of,
                   *(None if any(one is None for one in each) else np.concatenate(each)
                   for each in last), above=all(b.above for b in batches))


class Descent:
    """Conjugate gradients on S, of each subdomain by itself.

    begun : where they start
    aside : fields that take no part: all else is orthogonal to them in S
    """

    def __init__(self, stage: LinearStage, begun: Dual, aside: KnownAnswers | None = None):
        self.stage, self.aside, self.of = stage, aside, ColumnSegments(stage.space.boundary)
        self.x, self.r, self.size = begun.x, begun.left, begun.size
        self.p, self.q = begun.towards, begun.meant

    def asked(self, going: np.ndarray) -> np.ndarray:
        """(T, S) rᵀM⁻¹r, of subdomains that are asked, (T, S) bool."""
        self.z = self.stage.solve(np.where(self.of.spread(going), self.r, 0.0))
        self.now = np.maximum(self.of.sums(self.r * self.z), 0.0)
        return self.now

    def moved(self) -> np.ndarray:
        """(T, S) the steps α along the next direction."""
        of, robin, meant = self.of, self.stage.direction.robin, self.r
        if self.aside is not None:
            self.z, meant = self.aside.beside(self.z, robin(self.z), meant)
        if self.p is None:
            self.p, self.q = self.z, meant.copy()
        else:
            beta = of.spread(ratio(self.now, self.size))
            self.p, self.q = self.z + beta * self.p, meant + beta * self.q
        s_p = self.q - robin(self.p)
        alpha, self.size = ratio(self.now, of.sums(self.p * s_p)), self.now
        far = of.spread(alpha)
        self.x, self.r = self.x + far * self.p, self.r - far * s_p
        return alpha

    def told(self, energy: np.ndarray, sweeps: int, of: np.ndarray, above: bool = False) -> Dual:
        """Return what has been found of forces ``of`` (T, B); energies (T,) of them."""
        return Dual(energy, sweeps, self.x, self.r, of, self.p, self.q, self.size, above)


def dual_energy(stage: LinearStage, h: np.ndarray, rest: np.ndarray, enough: Enough,
                beyond: Callable[[np.ndarray], bool] = lambda total: False,
                softness: np.ndarray | Callable[[], np.ndarray] | None = None,
                begun: Dual | None = None, aside: KnownAnswers | None = None) -> Dual:
    """hᵀS⁺h of all subdomains; infinite if it is not reached.

    h : (T, B) forces on the boundary dofs, balanced on floating subdomains
    rest : (T,) what b² is added to, a² and the cross term; enough : when the sum is known so
    beyond : of sums (T,) reached so far, whether they are more than can be of use, and returned
    softness : (S,) σ of the own subdomains, see ``softest``: what is left is known from above then,
        and added, see ``_reach``. Of slender bodies that takes long: after ``LONGER`` times as many
        steps the tail has to do. A function is asked once steps end within ``met``
    begun : what an earlier call has found, to go on from if that was of the same h; aside : fields
        whose forces are known, in which h is answered beforehand
    """
    space, of = stage.space, ColumnSegments(stage.space.boundary)
    none = Dual(np.zeros(len(h)), 0, np.zeros_like(h), h, h, above=True)
    if not space.team.max(h.any())[0]:
        return none
    if begun is None or space.team.max(not np.array_equal(begun.of, h))[0]:
        begun = Dual(none.energy, 0, *(aside.answered(h) if aside else (none.x, h.copy())), h)
    descent, rz_old = Descent(stage, begun, aside), begun.size
    total, = space.team.sum(dots(begun.x, h + begun.left))
    kept, going = np.zeros(shape := (len(h), len(of.slices))), np.ones(shape, dtype=bool)
    steps, taken, ready, reach, alpha = [], [], 0, None, None
    closely = min(enough.tail, enough.share)
    softness, ask = (None, softness) if callable(softness) else (softness, None)
    for sweeps in range(1, MAX_STEPS + 1):
        rz = descent.asked(going)
        if softness is not None:
            reach = _reach(softness, reach, alpha, rz, rz_old)
            kept = np.where(going, rz * reach, kept)
            left, = space.team.sum(kept.sum(axis=1))
            most = total + left
            may = max(enough.share, MET) if (most + rest).max() <= enough.met else enough.share
            if left.sum() <= may * max(np.sum(most + rest), CANCELLED * np.sum(most),
                                       enough.negligible):
                return descent.told(most, sweeps, h, True)
        alpha, rz_old = descent.moved(), rz
        gained, = space.team.sum((alpha * rz).sum(axis=1))
        total = total + gained
        steps.append(float(gained.sum()))
        if beyond(total + rest):
            return descent.told(total, sweeps, h)
        tail, worth = _tail(steps), max(np.sum(total + rest), CANCELLED * np.sum(total),
                                        enough.negligible)
        taken.append((alpha, rz))
        kept = np.where(going, SLOW * alpha * rz if softness is None else kept - alpha * rz, kept)
        going &= kept > IDLE * closely * worth / (len(h) * space.link.subdomain_count)
        if ask and softness is None and max(steps[-1], tail) <= LEFT * worth \
                and (total + rest).max() + tail <= enough.met:
            softness, going[:] = ask(), True
            reach = _reach_of(softness, taken)
        ready = ready or (sweeps if max(steps[-1], tail) <= closely * worth else 0)
        if ready and (softness is None or sweeps >= LONGER * ready):
            idle, = space.team.sum(np.where(going, 0.0, kept).sum(axis=1))
            tail = tail * gained / max(steps[-1], np.finfo(float).tiny) + idle
            energy = total + tail + enough.tail * np.maximum(total + rest, 0.0)
            return descent.told(energy, sweeps, h, softness is not None)
    return descent.told(np.full(len(h), np.inf), sweeps, h)


def _reach(softness: np.ndarray, before: np.ndarray | None, alpha: np.ndarray, rz: np.ndarray,
           rz_old: np.ndarray) -> np.ndarray:
    """(T, S) what rᵀS⁺r is at most, over rᵀM⁻¹r, after another step of the conjugate gradients.

    By Gauss–Radau quadrature with the node μ = σ/(1 + σ) below all eigenvalues of M⁻¹S: γ_0 = 1/μ,
    γ ← (γ − α)/(μ (γ − α) + β) (Meurant & Tichý, Numer. Algorithms 62, 2013, eq. 4.6). Where
    rounding leaves nothing of γ − α it is 1/μ again.

    before, alpha : γ and steps α (T, S) of the step before, None at first; rz, rz_old : rᵀM⁻¹r (T,
        S) now and before
    """
    worst = np.broadcast_to(1 + 1 / softness, rz.shape)
    if before is None:
        return worst
    left, beta = before - alpha, ratio(rz, rz_old)
    return np.minimum(np.where(left > 0, left / np.where(left > 0, left / worst + beta, 1.0),
                               worst), worst)


def _reach_of(softness: np.ndarray, taken: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(T, S) the same after steps of α and rᵀM⁻¹r (T, S) each: of what has not taken part in the
    last, all that it is at most.
    """
    reach = _reach(softness, None, *taken[0], taken[0][1])
    for (alpha, old), (_, new) in zip(taken, taken[1:]):
        reach = _reach(softness, reach, alpha, new, old)
    return reach


def _tail(steps: list[float]) -> float:
    """Return what the steps to come would add: a geometric series, at the slower of the last two
    rates.
    """
    last = steps[-3:]
    rates = [b / a for a, b in zip(last, last[1:]) if a > 0]
    rate = min(max(rates, default=SLOWEST), SLOWEST)
    return steps[-1] * rate / (1 - rate)

"""Soft modes: displacements of a subdomain's boundary that its soles hold, but hardly the subdomain
itself.

With S the subdomain's Schur complement and k the soles' stiffness on all its interfaces, one stage
damps an error of the shape x, S x = σ k x, by (1 − σ)/(1 + σ): not at all where σ is small. The
macro problem has to carry these shapes. Affine fields hold them in compact subdomains of one
matter; otherwise they are computed, and each interface takes its part of the modes of both its
sides. The black box never shows S, but applies C = N M⁻¹ Nᵀ = (S + k)⁻¹:

    C k x = λ x,   λ = 1 / (1 + σ)  near 1

by the block Lanczos method in the inner product of k, all subdomains side by side. Those whose
soles and answers are the same share one space for as long as they are.

References: Spillane, Dolean, Hauret, Nataf, Pechstein & Scheichl, Numer. Math. 126 (2014) and
Haferssas, Jolivet & Nataf, SIAM J. Sci. Comput. 39 (2017), whose coarse spaces for Robin conditions
these are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.interface.rows import digest
from orchestrator.method.linear.macro_basis import as_given
from orchestrator.method.interface.search_direction import Nearest, SearchDirection
from orchestrator.method.interface.traces import TraceSpace

SOFT = 0.05  # σ below which a mode belongs to the macro problem
BLOCK = 16  # right-hand sides per subdomain and message
# share of a mode on one interface, in energy norm, that is worth a macro function
INDEPENDENT = 1e-2


@dataclass(frozen=True)
class Wanted:
    """Which modes of a subdomain: those softer than SOFT, and how well. By default what the macro
    problem wants: they only have to be
    caught, not known.

    least : as many at least
    accurate : residual of a mode that is good enough
    largest : columns spent at most
    """

    least: int = 0
    accurate: float = 0.02
    largest: int = 320


class _Krylov:
    """Block Krylov space of one subdomain.

    k : (t, t) sparse, soles' stiffness on its boundary dofs
    start : (t, b) first block
    wanted : which modes
    """

    def __init__(self, k: sp.csr_array, start: np.ndarray, wanted: Wanted):
        self.k, self.modes, self.wanted = k, None, wanted
        self.block = _orthonormal(k, start, np.zeros((len(start), 0)))
        self.basis, self.images = np.zeros((2, len(start), 0))
        self.projected = np.zeros((0, 0))

    @property
    def forces(self) -> np.ndarray:
        """(b, t) k Q of the block whose image is wanted."""
        return np.ascontiguousarray((self.k @ self.block).T)

    def advance(self, image: np.ndarray) -> None:
        """Take in C k Q of the block; finish, or make the next one of what is new in it."""
        self.basis, self.images = np.hstack([self.basis, self.block]), np.hstack(
            [self.images, image])
        columns = self.basis.T @ (self.k @ image)
        old = len(self.projected)
        self.projected = np.block([[self.projected, columns[:old]],
                                   [columns[:old].T, columns[old:]]])
        value, vector = np.linalg.eigh((self.projected + self.projected.T) / 2)
        soft = min(max(int(np.sum(value > 1 / (1 + SOFT))), self.wanted.least), len(value))
        # the first one that is not soft as well: none has been missed
        watched = slice(-1, -soft - 2, -1)
        left = self.images @ vector[:, watched] - self.basis @ (vector[:, watched] * value[watched])
        settled = np.all(_energy(self.k, left) <= self.wanted.accurate**2)
        self.block = _orthonormal(self.k, image, self.basis)
        if settled or not self.block.size or self.basis.shape[1] + self.block.shape[
            1] > self.wanted.largest:
            self.modes = self.basis @ vector[:, watched][:, :soft]


def soft_modes(direction: SearchDirection, blackbox: BlackBox, chosen: np.ndarray,
               wanted: Wanted = Wanted()) -> tuple[dict[int, np.ndarray], float]:
    """Soft modes of some subdomains.

    direction : search direction
    chosen : (subdomains of the scene,) bool
    wanted : which of their modes

    modes : place among its ``space.subdomains`` → (t, m), k-orthonormal
    sweeps : back-substitutions per subdomain, the mean
    Raises BlackBoxError: from the code
    """
    space, spent, done = direction.space, 0, {}
    own = [e for e, part in enumerate(space.boundary) if chosen[space.subdomains[e]]
           and part.stop > part.start]
    alike: dict[bytes, tuple[list[int], _Krylov]] = {}  # members, and the one space of all of them
    for e, k in zip(own, direction.robin_blocks(own)):
        key = digest(k.indptr, k.indices, k.data)
        if key not in alike:
            size = k.shape[0]
            alike[key] = [], _Krylov(k,
                                     np.random.default_rng(0).standard_normal(
                                         (size, min(BLOCK, size))), wanted)
        alike[key][0].append(e)
    under_way = list(alike.values())
    while under_way:
        requests = {e: forces for members, krylov in under_way for forces in (krylov.forces,)
                    for e in members}
        spent += sum(len(r) for r in requests.values())
        answers, left = blackbox.traces(requests), []
        for members, krylov in under_way:
            for same in _by_answer(members, answers):
                own = copy(krylov)
                own.advance(answers[same[0]].T)
                if own.modes is None:
                    left.append((same, own))
                else:
                    done |= dict.fromkeys(same, own.modes)
        under_way = left
    total, = space.team.sum(spent)
    return done, float(total) / space.link.subdomain_count


def _by_answer(members: list[int], answers: Mapping[int, np.ndarray]) -> list[list[int]]:
    """Subdomains that have been given one and the same array for an answer, together: the black box
    knows them to be alike.
    """
    same: dict[int, list[int]] = {}
    for e in members:
        same.setdefault(id(answers[e]), []).append(e)
    return list(same.values())


def enriched(space: TraceSpace, k: sp.csr_array, bases: list[np.ndarray],
             modes: dict[int, np.ndarray]) -> list[np.ndarray]:
    """Macro bases with the soft modes of both sides added, what is dependent left out.

    k : (D + G, D + G) search direction, ghosts included
    bases : per interface (d, m), as without modes

    Between ranks, the rank of the first side makes the basis and gives it to the other, see
    ``as_given``.
    """
    team, counts = space.team, np.zeros(space.link.subdomain_count)
    counts[space.subdomains] = [modes[e].shape[1] if e in modes else 0
                                for e in range(len(space.boundary))]
    counts = team.sum(counts)[0].astype(int)
    if not counts.any():
        return bases
    traces = space.everywhere(space.side_by_side(modes, counts.max()))
    transfer, result = space.transfer, []
    both, (own, _) = (transfer.first(traces), transfer.second(traces)), transfer.at_points(k)
    held = None if transfer.picks else space.held_everywhere
    for index, (a, b, basis) in enumerate(zip(transfer.bounds[:-1], transfer.bounds[1:], bases)):
        if a == b or not transfer.mine[a]:
            result.append(np.zeros((0, 0)))
            continue
        widths = [counts[space.owner[side[0]]] for side in space.sides[index]]
        if transfer.matched[index]:
            parts = [side[:n, a:b].T for side, n in zip(both, widths) if n]
            result.append(_with_modes(own[a:b, a:b], basis, parts))
        else:
            result.append(_with_modes(*_without_jump(space, k, index, traces, widths, held, basis)))
    return as_given(space, result)


def _without_jump(space: TraceSpace, k: sp.csr_array, index: int, traces: np.ndarray,
                  widths: Sequence[int],
                  held: np.ndarray,
                  basis: np.ndarray) -> tuple[sp.csr_array, np.ndarray, list[np.ndarray]]:
    """Search direction of both sides of an interface whose nodes do not match, and the modes of
    either side on it: what is
    nearest to them, and to nothing on the other side, without a jump.

    traces : (modes, D + G) of all subdomains; widths : how many either side's has; held : (D + G,)
        bool
    basis : handed on
    """
    transfer, sides = space.transfer, space.sides[index]
    dofs = np.concatenate(sides)
    points = slice(transfer.bounds[index], transfer.bounds[index + 1])
    own, across = k[dofs][:, dofs], transfer.B[points][:, dofs]
    # points that have slid off the other side keep nothing together
    across = across[abs(across) @ (~held[dofs]) > 0]
    nearest, parts = Nearest(own, across, held[dofs]), []
    for side, n in zip(sides, widths):
        if n:
            alone = np.where(np.isin(dofs, side), traces[:n, dofs], 0.0)
            parts.append((alone + nearest.moves(alone, np.zeros_like(alone))[0]).T)
    return own, basis, parts


def _with_modes(own: sp.csr_array, basis: np.ndarray, parts: list[np.ndarray]) -> np.ndarray:
    """The basis of one interface and what its sides' modes add to it.

    own : (d, d) search direction; basis : (d, m); parts : (d, n) of either side
    """
    if parts and basis.size:
        basis = _orthonormal(own, basis, np.zeros((len(basis), 0)))
        new = np.hstack(parts)
        for _ in range(2):
            new = new - basis @ (basis.T @ (own @ new))
        value, vector = np.linalg.eigh(new.T @ (own @ new))
        keep = value > INDEPENDENT**2
        both = np.hstack([basis, new @ (vector[:, keep] / np.sqrt(value[keep]))])
        return la.orth(both / np.linalg.norm(both, axis=0))
    return basis


def _energy(k: sp.csr_array, x: np.ndarray) -> np.ndarray:
    """(columns,) xᵀk x."""
    return np.sum(x * (k @ x), axis=0)


def _orthonormal(k: sp.csr_array, x: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Columns of x made k-orthonormal to a k-orthonormal basis and to each other; dependent ones
    are dropped.
    """
    scale = _energy(k, x)
    x = x[:, scale > 0] / np.sqrt(scale[scale > 0])
    for _ in range(2):
        x = x - basis @ (basis.T @ (k @ x))
        value, vector = np.linalg.eigh(x.T @ (k @ x))
        keep = value > 1e-16
        x = x @ (vector[:, keep] / np.sqrt(value[keep]))
    return x

"""Guard on the black box's answers: what a symmetric, positive solver cannot answer is reported at once.

For boundary loads f and answers u = C f of one subdomain, C = N M⁻¹ Nᵀ = (S + k)⁻¹:

- reciprocity (Betti): fᵀu' = f'ᵀu for two loads f, f' and their answers;
- strain energy: fᵀu − uᵀk u = uᵀS u ≥ 0: what the soles do not store, the subdomain itself does.

Traces w = N u and what the soles answer to them, k w, are formed on the way; ``answered`` hands them on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.errors import BlackBoxError
from orchestrator.method.interface.rows import Segments, times
from orchestrator.method.interface.search_direction import SearchDirection

# Relative. Sound codes stay below 1e-10; answers rounded to six digits, as text gives them, below 1e-5.
CONSISTENT = 1e-3
DIGITLESS = np.finfo(float).tiny / np.finfo(float).eps  # below it numbers lose digits
ORDINARY = 1e100  # loads and answers whose products, and products of these, are numbers: above one over it, and below it


class GuardedTraces(BlackBox):
    """A black box every answer of whose ``traces`` is judged, at the cost of products on boundary dofs.

    inner : where the answers come from
    direction : search direction
    names : of the subdomains, in the order of its ``space.subdomains``
    """

    def __init__(self, inner: BlackBox, direction: SearchDirection, names: list[str]):
        super().__init__(inner)
        self.names, self.direction, self.parts = names, direction, direction.space.boundary
        size = max((part.stop for part in self.parts), default=0)
        self.earlier = np.zeros((2, size))  # a load of each subdomain and its answer
        self.known = np.zeros(len(self.parts), dtype=bool)  # which of them have one
        self.own: dict[int, sp.csr_array] = {}

    @cached_property
    def all(self) -> Segments:
        """The boundary dofs of the subdomains."""
        return Segments(self.parts)

    @cached_property
    def owned(self) -> Segments:
        """The trace dofs of the subdomains, which lie together as their boundary dofs do."""
        space = self.direction.space
        ends = np.searchsorted(space.owner[: space.size], [*space.subdomains, np.inf])
        return Segments([slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])])

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says.

        Raises BlackBoxError: also for an answer that no elastic body gives, naming the subdomain
        """
        answers, judged = self.inner.traces(forces), {}
        first = {(id(forces[e]), id(u)): e for e, u in reversed(answers.items()) if u.size}
        self.soles(list(first.values()))
        for e, u in answers.items():
            f, part = np.asarray(forces[e]), self.parts[e]
            which = id(f), id(u)
            if which in judged:  # one and the same array: nothing new to be seen
                self.earlier[:, part] = self.earlier[:, self.parts[judged[which]]]
                self.known[e] = self.known[judged[which]]
            elif f.size:
                judged[which] = e
                alone = Segments([slice(0, f.shape[1])])
                self._judge(f, u, alone, [e], part, lambda x, e=e, of=alone: of.sums(x * times(self.own[e], x)))
        return answers

    def soles(self, subdomains: Sequence[int]) -> dict[int, sp.csr_array]:
        """(t, t) NᵀkN on the boundary dofs of these subdomains, and of all that were asked for before."""
        unknown = [e for e in subdomains if e not in self.own]
        self.own |= zip(unknown, self.direction.robin_blocks(unknown))
        return self.own

    def all_traces(self, forces: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """As ``BlackBox`` says, and as ``traces`` does, all subdomains at once."""
        return self.answered(forces)[0]

    def answered(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Answers u (rows, B) of all subdomains to boundary forces (rows, B), with w = N u and k w, (rows, D) each.

        They are the caller's to change.
        """
        answers, space = self.inner.all_traces(forces, self.parts), self.direction.space
        w = space.trace(answers)
        kw = self.direction.times(w)
        if len(forces):
            self._judge(forces, answers, self.all, self.all.subdomains, slice(None),
                        lambda u: self._in_soles(w, kw) if u is answers else self._in_soles(
                            x := space.trace(u), self.direction.times(x)))
        return answers, w, kw

    def _in_soles(self, w: np.ndarray, kw: np.ndarray) -> np.ndarray:
        """(rows, S) twice the energy of the soles of each subdomain, wᵀk w."""
        result = np.zeros((len(w), len(self.parts)))
        result[:, self.owned.subdomains] = self.owned.products(w, kw)[0]
        return result[:, self.all.subdomains]

    def _judge(self, f: np.ndarray, u: np.ndarray, of: Segments, subdomains: Sequence[int], part: slice,
               in_soles: Callable[[np.ndarray], np.ndarray]) -> None:
        """Loads and answers (rows, columns).

        of : whose the columns are, one after the other
        subdomains : which these are
        part : the boundary dofs that the columns are
        in_soles : u to (rows, S) uᵀk u of each subdomain
        """
        # per unit of the load: products of small ones would underflow, and denormal numbers have no digits to compare
        unit, size = of.largest(f), of.largest(u)
        sound = (unit > DIGITLESS) & (size > DIGITLESS)
        if not sound.any():
            return
        inverse = np.where(sound, 1 / np.where(sound, unit, 1.0), 0.0)
        largest, smallest = (x(np.concatenate([unit[sound], size[sound]])) for x in (np.max, np.min))
        if not 1 / ORDINARY < smallest <= largest < ORDINARY:
            f, u = (x * of.spread(inverse) for x in (f, u))
            inverse = sound.astype(float)
        work, size, stored = (x * inverse**2 for x in (*of.products(f, u), in_soles(u)))
        least = np.minimum(work, work - stored)
        wrong = sound & (least < -CONSISTENT * size)
        if wrong.any():
            t, e = np.argwhere(wrong)[0]
            raise BlackBoxError(f"guard: a negative strain energy: {least[t, e]:.1e} where a load of at most 1 on a node does "
                                f"work of up to {size[t, e]:.1e}", self.names[subdomains[e]])
        first, last = sound.argmax(axis=0), len(sound) - 1 - sound[::-1].argmax(axis=0)
        any_sound, known = sound.any(axis=0), of.spread(self.known[subdomains])

        def chosen(x: np.ndarray, which: np.ndarray) -> np.ndarray:
            return of.rows(x, which) * of.spread(inverse[which, np.arange(len(which))])

        new_f, new_u = chosen(f, last), chosen(u, last)
        old_f, old_u = self.earlier[:, part]
        if not known.all():
            old_f, old_u = np.where(known, old_f, chosen(f, first)), np.where(known, old_u, chosen(u, first))

        def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return of.products(a[None], b[None])[0][0]

        def norm(x: np.ndarray) -> np.ndarray:
            return np.sqrt(product(x, x))

        one, other = product(old_f, new_u), product(new_f, old_u)

        # loads of other symmetry do no work on each other: the sums are mere rounding then
        exchanged = norm(old_f) * norm(new_u) + norm(new_f) * norm(old_u)
        wrong = any_sound & (np.abs(one - other) > CONSISTENT * exchanged)
        if wrong.any():
            e = int(np.argmax(wrong))
            raise BlackBoxError(f"guard: answers to two loads that are not reciprocal: {one[e]:.4g} and {other[e]:.4g} for loads "
                                "of at most 1 on a node", self.names[subdomains[e]])
        for old, new in zip(self.earlier[:, part], (new_f, new_u)):
            np.copyto(old, new, where=of.spread(any_sound))
        self.known[subdomains] |= any_sound

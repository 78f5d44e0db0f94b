"""Guard on the black box's answers: what a symmetric, positive solver cannot answer is reported at once.

For boundary loads f and answers u = C f of one subdomain, C = N M⁻¹ Nᵀ = (S + k)⁻¹:

- reciprocity (Betti): fᵀu' = f'ᵀu for two loads f, f' and their answers;
- strain energy: fᵀu − uᵀk u = uᵀS u ≥ 0: what the soles do not store, the subdomain itself does.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.layers.layer import Layer
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.errors import BlackBoxError
from orchestrator.method.interface.search_direction import SearchDirection

# Relative. Sound codes stay below 1e-10; answers rounded to six digits, as text gives them, below 1e-5.
CONSISTENT = 1e-3
DIGITLESS = np.finfo(float).tiny / np.finfo(float).eps  # below it numbers lose digits


class GuardedTraces(Layer):
    """A black box every answer of whose ``traces`` is judged, at the cost of products on boundary dofs.

    Parameters
    ----------
    inner : where the answers come from
    direction : search direction
    names : of the subdomains, in the order of its ``space.subdomains``
    """

    def __init__(self, inner: BlackBox, direction: SearchDirection, names: list[str]):
        super().__init__(inner)
        self.names = names
        self.robin, self.parts = direction.robin, direction.space.boundary
        self.own: dict[int, sp.csr_array] = {}
        self.earlier: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says.

        Raises
        ------
        BlackBoxError : also for an answer that no elastic body gives, naming the subdomain
        """
        answers = self.inner.traces(forces)
        for e, u in answers.items():
            f = np.asarray(forces[e])
            if f.any():
                self._judge(e, f, u)
        return answers

    def _judge(self, e: int, f: np.ndarray, u: np.ndarray) -> None:
        """Loads and answers (columns, t) of one subdomain."""
        if e not in self.own:
            self.own[e] = sp.csr_array(self.robin[self.parts[e], self.parts[e]])
        # per unit of the load: products of small ones would underflow, and denormal numbers have no digits to compare
        unit, size = (np.abs(x).max(axis=1, initial=0.0) for x in (f, u))
        sound = (unit > DIGITLESS) & (size > DIGITLESS)
        if not sound.any():
            return
        f, u = f[sound] / unit[sound, None], u[sound] / unit[sound, None]
        work, size = np.einsum("ij,ij->i", f, u), np.einsum("ij,ij->i", np.abs(f), np.abs(u))
        stored = work - np.einsum("ij,ij->i", u, (self.own[e] @ u.T).T)
        least = np.minimum(work, stored)
        t = int(np.argmin(least + CONSISTENT * size))
        if least[t] < -CONSISTENT * size[t]:
            raise BlackBoxError(f"guard: a negative strain energy: {least[t]:.1e} where a load of at most 1 on a node does "
                                f"work of up to {size[t]:.1e}", self.names[e])
        old_f, old_u = self.earlier.get(e, (f[0], u[0]))
        one, other = old_f @ u[-1], f[-1] @ old_u
        norm = np.linalg.norm  # loads of other symmetry do no work on each other: the sums are mere rounding then
        exchanged = norm(old_f) * norm(u[-1]) + norm(f[-1]) * norm(old_u)
        if abs(one - other) > CONSISTENT * exchanged:
            raise BlackBoxError(f"guard: answers to two loads that are not reciprocal: {one:.4g} and {other:.4g} for loads "
                                "of at most 1 on a node", self.names[e])
        self.earlier[e] = f[-1].copy(), u[-1].copy()

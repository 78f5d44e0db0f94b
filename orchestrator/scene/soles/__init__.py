"""Soles: matter glued to interfaces, its outer face clamped (paper, section 3.2).

Added to a subdomain's mesh, a sole turns a standard elasticity solve into a Robin solve: its
stiffness, condensed on the interface, is the search direction k⁻. With one layer of linear
elements the outer nodes are all clamped, so that the condensation is a mere restriction.

Where all is one bonded mesh a sole surrounds a whole subdomain, see ``ring``. Elsewhere four kinds
are glued to interfaces:

- ``layer`` (the paper's): each side carries a layer along its own outward normal;
- ``symmetric``: each side carries a layer along +n and one along −n, half the modulus each.
  Both sides then see the very same stiffness, which makes the two search directions conjugate;
- ``overlap``: a copy of the first row of elements of both sides, most of its modulus the
neighbour's;
- ``springs``: a layer so thin that the nodes hardly feel each other, as contact laws, which are
  pointwise, like it. Modulus and thickness shrink together: E/thickness is what counts.

``facets`` says which moduli and thickness a sole should have, ``overlap`` where layers do not do
and makes copies of elements, ``make`` chooses the kind, makes layers and the soles of all
interfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass
class Sole:
    """The matter added to one side of one interface.

    points : (p, 3) float, the nodes that are not on the interface, all clamped
    cells : (q, 4 or 10) int, positively oriented; values below n are nodes of the interface, others
        n + index of ``points``
    young, poisson : (q,) float
    """

    points: np.ndarray
    cells: np.ndarray
    young: np.ndarray
    poisson: np.ndarray


def stiffened(soles: Sequence[tuple[Sole, Sole] | None],
              factors: np.ndarray) -> list[tuple[Sole, Sole] | None]:
    """Soles per interface with their moduli multiplied by factors (interfaces,)."""
    def of(pair: tuple[Sole, Sole], factor: float) -> tuple[Sole, Sole]:
        one = replace(pair[0], young=factor * pair[0].young)
        return one, one if pair[1] is pair[0] else replace(pair[1], young=factor * pair[1].young)

    return [pair if pair is None or factor == 1 else of(pair, factor)
            for pair, factor in zip(soles, factors)]

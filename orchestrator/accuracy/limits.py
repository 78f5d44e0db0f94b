"""How many elements seconds and memory leave room for, told before a mesh is made from what the meshes so far have taken.

Factors of sparse matrices in space have some N^(4/3) entries, N the unknowns: nested dissection leaves no more, A. George, SIAM J. Numer.
Anal. 10, 1973, 345–363. Between two meshes memory has grown by a share of the difference of these powers, and so it will. Of one mesh
nothing tells what is its own of a process: there it is ``UNKNOWN_BYTES`` an unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from orchestrator.accuracy.passes import Pass
from orchestrator.config.method import Accuracy
from orchestrator.timing import EXPONENT

FILL = 4 / 3
UNKNOWN_BYTES = 1e4  # the program's and all codes' together, 7,000 to 9,500 measured from 700 to 90,000 unknowns


@dataclass(frozen=True)
class Limit:
    """One of those that are set.

    elements : that the next mesh may have; inf: no limit
    short : what is too little, for a sentence; needed : of it for a number of elements, in words
    """

    elements: float
    short: str
    needed: str


def tightest(asked: Accuracy, done: Sequence[Pass], spent: float, enough: float) -> Limit:
    """The limit that leaves room for the fewest elements.

    done : meshes so far; spent : seconds; enough : elements that are needed
    """
    last = done[-1]
    found = [Limit(asked.elements or math.inf, f"{asked.elements or 0:,} elements", f"about {enough:,.0f} elements")]
    if asked.seconds:
        left, times = max(asked.seconds - spent, 0.0), (enough / last.elements) ** EXPONENT
        found.append(Limit(last.elements * (left / last.seconds) ** (1 / EXPONENT), f"{asked.seconds:g} seconds, of which {spent:.0f} are spent,",
                           f"about {enough:,.0f} elements, which take some {last.seconds * times:,.0f} s"))
    if asked.memory:
        each = _bytes_each(done)
        room = last.elements**FILL + (1e9 * asked.memory - last.memory) / each
        more = last.memory + each * (enough**FILL - last.elements**FILL)
        found.append(Limit(max(room, 0.0) ** (1 / FILL), f"{asked.memory:g} GB of memory, of which {last.memory / 1e9:.2g} were taken,",
                           f"about {enough:,.0f} elements, which take some {more / 1e9:.2g} GB"))
    return min(found, key=lambda limit: limit.elements)


def _bytes_each(done: Sequence[Pass]) -> float:
    """Bytes that memory grows by where elements^(4/3) grows by one."""
    *before, last = done
    if before and last.elements > before[-1].elements and last.memory > before[-1].memory:
        return (last.memory - before[-1].memory) / (last.elements**FILL - before[-1].elements**FILL)
    return UNKNOWN_BYTES * 3 * last.nodes / last.elements / (FILL * last.elements ** (FILL - 1))

"""How many elements seconds and memory leave room for, told before a mesh is made from what the meshes so far have taken.

Memory grows by ``UNKNOWN_BYTES`` an unknown, or by more where it has between the last two meshes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from orchestrator.accuracy.passes import Pass
from orchestrator.config.method import Accuracy
from orchestrator.timing import EXPONENT

UNKNOWN_BYTES = 1e4  # the program's and all codes' together: foresees .9 to 1.6 of what meshes of 3,000 to 90,000 take


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
        each = UNKNOWN_BYTES * 3 * last.nodes / last.elements  # bytes that an element more takes
        if len(done) > 1 and last.elements > done[-2].elements:
            each = max(each, (last.memory - done[-2].memory) / (last.elements - done[-2].elements))
        found.append(Limit(max(last.elements + (1e9 * asked.memory - last.memory) / each, 0.0),
                           f"{asked.memory:g} GB of memory, of which {last.memory / 1e9:.2g} were taken,", f"about {enough:,.0f} elements, "
                           f"which take some {(last.memory + each * (enough - last.elements)) / 1e9:.2g} GB"))
    return min(found, key=lambda limit: limit.elements)

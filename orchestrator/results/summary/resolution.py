"""Sentences on places of contact that elements are too large for, see ``delivery.resolution``, and on pairs that stay as they are, whose
sides have slid too far, see ``delivery.slid``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from orchestrator.errors import some
from orchestrator.method.delivery.met import Met

FIFTH = 0.2  # of an element, slips beyond which are told; beyond the whole of it pairs no longer face each other
WRONG = 0.1  # share of pressures, by which curved sides that slide may have them wrong, from which they are told


def unresolved(found: Mapping[str, tuple[int, int]]) -> Iterator[str]:
    """A sentence for pairs of bodies whose place of contact is not resolved at some load step."""
    if found:
        places = [f"{name} ({points} points carry it at load step {step})" for name, (points, step) in found.items()]
        yield (f"the place of contact is hardly wider than a face: {some(places)}; neither its pressures nor the estimated "
               "error of the mesh are to be believed there: make elements smaller")


def sliding(met: Met) -> Iterator[str]:
    """A sentence for those that slid by more than an element, by more than a fifth, and on curved faces by too much for these."""
    far, bent = met.slides, dict(zip(met.names, met.amiss.tolist()))
    if much := [name for name, share in far.items() if share > 1]:
        yield (f"{some(much)} slid by more than an element: node pairs do not follow, "
               "large sliding is outside small perturbations; between parts meshed each on its own contact has pairing: follow")
    if more := {name: share for name, share in far.items() if FIFTH < share <= 1}:
        yield (f"{some(sorted(more, key=more.get, reverse=True))} slid by up to {max(more.values()):.2g} of an element: node pairs do not "
               "follow, and forces act where they did before loading; between parts meshed each on its own contact has pairing: follow")
    if wrong := {name: share for name, far_ in far.items() if far_ <= 1 and (share := bent[name]) > WRONG}:
        yield (f"{some(sorted(wrong, key=wrong.get, reverse=True))} slid on curved faces that do not conform: pressures may be off by "
               f"{min(max(wrong.values()), 1.0):.0%} of the largest, as node pairs do not follow; between parts meshed each on its own "
               "contact has pairing: follow")

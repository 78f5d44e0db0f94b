"""Sentences on sides that have slid farther than pairs that stay as they are can tell, see ``delivery.slid``."""

from __future__ import annotations

from collections.abc import Iterator

from orchestrator.errors import some
from orchestrator.method.delivery.interface_fields import InterfaceFields

# Slips beyond this share of an element are told; beyond the whole of it pairs no longer face each other.
FIFTH = 0.2
# Shares of pressures, by which curved sides that slide may have them wrong, from which they are told.
WRONG = 0.1


def sliding(fields: InterfaceFields) -> Iterator[str]:
    """A sentence for those that slid by more than an element, by more than a fifth, and on curved faces by too much for these."""
    far, bent = slides(fields), dict(zip(fields.names.tolist(), fields.amiss.tolist()))
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


def slides(fields: InterfaceFields) -> dict[str, float]:
    """Interface → how far its sides have slid, in elements, where they hold; of those whose pairs stay as they are."""
    return {name: far for name, far in zip(fields.names.tolist(), fields.slid.tolist()) if far == far}

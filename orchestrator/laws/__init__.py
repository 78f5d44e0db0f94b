"""Interface laws, one module each, and the table they are looked up in.

A law answers one question, pointwise and vectorised over all node pairs that share it: given the
predicted force F on side 1, which force f̂ does the interface carry? The jump follows from the
search direction, d = (F − f̂)/keq. Adding a law is a module and a line in ``LAWS``.
"""

from __future__ import annotations

from orchestrator.laws import contact, jump, perfect

LAWS = {"perfect": perfect.force, "jump": jump.force, "contact": contact.force}

__all__ = ["LAWS"]

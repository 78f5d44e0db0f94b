"""Which black box solves which subdomain: the entries of ``blackbox:`` matched against names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.config.blackbox import CodeSettings, entry_path
from orchestrator.errors import Problems
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Subdomain
from orchestrator.scene.names import matching, suggestion
from orchestrator.wording import some


def assign_codes(mesh: Mesh, subdomains: list[Subdomain], entries: Sequence[CodeSettings]) -> None:
    """Give every subdomain the index of the last entry that matches its name or that of the volume it is in.

    Raises
    ------
    InputError : an entry that matches nothing, a subdomain that none matches
    """
    problems, chosen = Problems(), np.full(len(subdomains), -1)
    names = [_names(mesh, s) for s in subdomains]
    known = [name for own in names for name in own]
    for i, entry in enumerate(entries):
        for pattern in entry.on:
            meant = set(matching(pattern, known))
            hit = [not meant.isdisjoint(own) for own in names]
            if not any(hit):
                problems.add((*entry_path(i, entries), "on"), f"no subdomain and no volume is called {pattern!r}",
                             "names of subdomains, shell wildcards allowed", suggestion(pattern, known, "subdomain"))
            chosen[hit] = i
    left = [s.name for s, code in zip(subdomains, chosen) if code < 0]
    if left:
        problems.add(("blackbox",), f"no entry for {some(left, 8)}", "a black box for each subdomain",
                     "begin the list with an entry without on:, which holds for all")
    problems.raise_if_any()
    for subdomain, code in zip(subdomains, chosen.tolist()):
        subdomain.code, subdomain.remembers = code, entries[code].remembers


def _names(mesh: Mesh, subdomain: Subdomain) -> list[str]:
    """What a subdomain goes by: its own name and, if it lies in one volume, that volume's."""
    inside = np.unique(mesh.volume[subdomain.cells])
    return [subdomain.name] + ([mesh.volumes[inside[0]]] if len(inside) == 1 else [])

"""The last word to parts whose mesh is not ours: what their joints have come to, so that they write results of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from orchestrator.blackbox.codes.finding import find_codes
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError
from orchestrator.scene.model import Subdomain


def finish_parts(settings: Sequence[CodeSettings], subdomains: Sequence[Subdomain], displacements: Sequence[np.ndarray],
                 forces: Sequence[np.ndarray | None], place: Callable[[str], AbstractContextManager[Path]]) -> list[str]:
    """Tell every part that wants to know.

    Parameters
    ----------
    settings : the entries of ``blackbox``, and those of parts
    displacements, forces : per subdomain (T, n_E, 3), its own, and what the interfaces exert; the joints' nodes come first
    place : an empty folder for the results of the part of a name

    Returns
    -------
    a sentence for each part that could not: what has been computed is not lost by it
    """
    asked = {s.code: s for s in subdomains if s.foreign and getattr(settings[s.code], "writes_results", False)}
    sentences = []
    for number, code in (find_codes(settings, asked) if asked else {}).items():
        s = asked[number]
        u, f = (x[:, : len(code.condensed().joints.points)].reshape(len(x), -1) for x in (displacements[s.index], forces[s.index]))
        try:
            with place(settings[number].name) as folder:
                code.finish(folder, u, f)
        except InputError as error:
            sentences.append(f"no results of {s.name}: {error.problems[0].found}")
    return sentences

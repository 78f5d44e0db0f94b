"""What parts whose mesh is not ours end with: fields on their own mesh where that is known, and the last word to programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.blackbox.start import find_codes
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError
from orchestrator.scene.model import Scene, Subdomain


@dataclass(frozen=True)
class OwnFields:
    """Displacements of a part at every load step.

    name : of the part
    points : (n, 3) its own nodes
    blocks : (meshio's name of the element, (m, nodes) int) of its elements, or of its joints' faces
    displacement : (steps, n, 3)
    force : (steps, n, 3) what acts on it through its joints
    """

    name: str
    points: np.ndarray
    blocks: list[tuple[str, np.ndarray]]
    displacement: np.ndarray
    force: np.ndarray


def fields_of_parts(settings: Sequence[CodeSettings], scene: Scene, displacements: Sequence[np.ndarray],
                    forces: Sequence[np.ndarray | None]) -> list[OwnFields]:
    """Those of all parts of a scene; arguments as of ``finish_parts``."""
    found = []
    for stand in scene.mesh.foreign:
        own = next(s for s in scene.subdomains if s.foreign and scene.mesh.volume[s.cells[0]] == stand.volume)
        code, = find_codes(settings, [own.code]).values()
        found.append(code.own_fields(*(x[own.index][:, : stand.joints] for x in (displacements, forces))))
    return found


def finish_parts(settings: Sequence[CodeSettings], subdomains: Sequence[Subdomain], displacements: Sequence[np.ndarray],
                 forces: Sequence[np.ndarray | None], place: Callable[[str], AbstractContextManager[Path]]) -> list[str]:
    """Tell every part that wants to know.

    settings : the entries of ``blackbox``, and those of parts
    displacements, forces : per subdomain (T, n_E, 3), its own, and what the interfaces exert; the joints' nodes come first
    place : an empty folder for the results of the part of a name

    Returns a sentence for each part that could not: what has been computed is not lost by it
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

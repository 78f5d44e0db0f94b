"""Runs of CalculiX on a user's deck, in a folder of their own: the deck is included, never
written.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.calculix import files
from orchestrator.blackbox.codes.calculix.code import CalculiX
from orchestrator.config.mesh import DeckPart
from orchestrator.errors import InputError, KeyPath, Problem, wrong
from orchestrator.scene.foreign.deck import Deck, files_of, headings
from orchestrator.scene.foreign.joints import Joints
from orchestrator.processes import waited_for

JOB = "orchestrator-job"
NAMED = "orchestrator-file-{}.inp"  # the deck and its files of loads, in their order
# CalculiX stores no stiffness unless some matter has a mass; of this one nothing is made.
DENSITY = "*MATERIAL,NAME=ORCHESTRATOR\n*ELASTIC\n1.,0.\n*DENSITY\n1.\n"
PATIENCE = 3600.0  # seconds for a run


class Refused(Exception):
    """CalculiX does not take the deck; in its own words."""


class DeckRuns:
    """Runs of one deck.

    part : the entry of ``parts``; path : where it stands in the YAML
    folder : an empty one
    cases : files of the deck's own loads: one for all load steps, or one for each
    """

    def __init__(self, part: DeckPart, path: KeyPath, joints: Joints, folder: Path):
        self.part, self.path, self.joints, self.folder = part, path, joints, folder
        self.deck = Deck(Path(part.calculix), path)
        try:
            self.code = CalculiX()
        except InputError as error:
            raise InputError([Problem((*path, "calculix"), p.found, p.expected, p.cure)
                              for p in error.problems]) from error
        self.materials = [options["NAME"].upper()
                          for card, options, _ in headings(Path(part.calculix), path)
                          if card == "MATERIAL" and "NAME" in options]
        elements = [int(row.words[0]) for card, _, rows in self.deck.cards if card == "ELEMENT"
                    for row in rows if row.words[0].isdigit()]
        self._named = [Path(file) for file in [part.calculix, *(part.loads or [])]]
        self.cases = self._named[1:]
        # CalculiX takes no two amplitudes on one dof: forces on the joints then act on nodes that
        # follow theirs
        amplitudes = any(card == "CLOAD" and "AMPLITUDE" in options
                         for file in part.loads or []
                         for card, options, _ in headings(Path(file), path))
        self._carriers = joints.ids if not amplitudes else 1 + int(self.deck.ids.max()) + np.arange(
            len(joints.ids))
        self._next = 1 + max(elements, default=0)
        # by names of our own, as files of two folders may have one name; what they include by names
        # beside them
        for i, file in enumerate(self._named):
            (self.folder / NAMED.format(i)).symlink_to(file.resolve())
        for file in self._named:
            for included in files_of(file)[1:]:
                name = os.path.relpath(included, file.parent)
                link = self.folder / name
                if name.startswith((os.pardir, "orchestrator-")):
                    continue
                if link.exists() and link.resolve() != included.resolve():
                    raise wrong(self.path,
                                f"{included} and {link.resolve()}: two files of one name, one of "
                                "which is "
                                "included", "files included from one folder, or of different names",
                                "rename one of them")
                if not link.exists():
                    link.parent.mkdir(parents=True, exist_ok=True)
                    link.symlink_to(included.resolve())

    def stored(self) -> tuple[sp.csr_array, np.ndarray]:
        """(active, active) stiffness of the deck alone, and the dof 3 (number − 1) + component of
        each of its rows.
        """
        self._run(self._included() + DENSITY + files.STORE_MATRIX)
        try:
            return files.matrix(self.folder / JOB, 3 * 10**9)
        except files.Unreadable as error:
            raise Refused(f"its stiffness was not stored: {error}") from error

    def static(self, k: np.ndarray, loads: Path | None,
               forces: np.ndarray | None = None) -> np.ndarray:
        """(3n,) displacements of the joints under loads and forces (3n,) on the joints, springs k
        (3n,) on them.
        """
        u = self.everywhere(k, loads, forces)
        if len(u) < self.joints.ids.max():
            raise Refused("a restart file without all nodes")
        found = np.where(k > 0, u[self.joints.ids - 1].ravel(), 0.0)
        if not np.isfinite(found).all():
            raise Refused("displacements that are not finite: something inside can move by itself")
        return found

    def everywhere(self, k: np.ndarray, loads: Path | None,
                   forces: np.ndarray | None = None) -> np.ndarray:
        """(nodes, 3) the same of all nodes, by number from 1."""
        text = self._included() + self.springs(k)
        text += "*STEP\n*RESTART,WRITE\n*STATIC\n"
        if loads is not None:
            text += self._including(loads)
        text += "*CLOAD\n" + self._forces(np.zeros(len(k)) if forces is None else forces)
        return self._moved(text + "*END STEP\n")

    def springs(self, k: np.ndarray) -> str:
        """Grounded springs, an element for each dof with k > 0."""
        return "".join(
            f"*ELEMENT,TYPE=SPRING1,ELSET=ORCH{number}\n{number},{self.joints.ids[dof // 3]}\n"
            f"*SPRING,ELSET=ORCH{number}\n{dof % 3 + 1}\n{k[dof]:.13e}\n"
            for number, dof in enumerate(np.flatnonzero(k), self._next))

    def _forces(self, forces: np.ndarray) -> str:
        """Lines of *CLOAD; one of zero where there are none, since a step must load something."""
        chosen, at = np.flatnonzero(np.abs(forces) > files.SMALLEST), self._carriers
        return "".join(f"{at[d // 3]},{d % 3 + 1},{forces[d]:.13e}\n"
                       for d in chosen) or f"{at[0]},1,0.\n"

    def _included(self) -> str:
        text = self._including(Path(self.part.calculix))
        if self._carriers is self.joints.ids:
            return text
        text += "*NODE\n" + "".join(f"{i},0.,0.,0.\n" for i in self._carriers)
        free = np.argwhere(~self.joints.held)
        return text + "*EQUATION\n" + "".join(
            f"2\n{self._carriers[n]},{c + 1},1.,{self.joints.ids[n]},{c + 1},-1.\n"
            for n, c in free)

    def _including(self, file: Path) -> str:
        return f"*INCLUDE,INPUT={NAMED.format(self._named.index(file))}\n"

    def _moved(self, text: str) -> np.ndarray:
        """(nodes, 3) displacements of all nodes, by number, at the end of the one step of a deck
        whose results are kept.
        """
        self._run(text)
        try:
            return files.displacements(self.folder / JOB, 1, self.materials[0])[0]
        except (files.Unreadable, IndexError) as error:
            raise Refused(
                f"its displacements cannot be read: {error} ({len(self.materials)} "
                "materials)") from error

    def _run(self, text: str) -> None:
        for old in self.folder.glob(JOB + ".*"):
            old.unlink()
        (self.folder / f"{JOB}.inp").write_text(text, encoding="utf-8")
        environment = {**self.code.environment(), "OMP_NUM_THREADS": "1"}
        with tempfile.TemporaryFile() as log:
            try:
                ended = waited_for(self.code.command(JOB), PATIENCE, cwd=self.folder,
                                   env=environment, stdout=log,
                                   stderr=subprocess.DEVNULL)
            except subprocess.TimeoutExpired as error:
                raise Refused(f"no answer in {PATIENCE:g} s") from error
            log.seek(0)
            # without the line of the deck that it quotes: an include may name any file
            said = re.split("card image", files.complaint(log.read().decode(errors="replace")),
                            flags=re.IGNORECASE)[0].strip()
        if said or ended:
            raise Refused(f"CalculiX says: {said or self.code.meaning(ended)}")

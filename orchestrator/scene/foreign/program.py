"""A user's program as a part: it starts in an empty folder with two text files, and leaves two.

    springs.txt        n                  then per joint node    id kx ky kz, which add to the
                                                                 diagonal of the stiffness
    forces.txt         n cases            then per case          own, and n rows  id fx fy fz
    displacements.txt  per case n rows    id ux uy uz
    joint.txt          per joint node     id x y z [joint]       also with n = 0, the first call

``own`` is 0 where the case has none of the program's own loads, t where it has those of load step
t.
Numbers are separated by blanks and have 17 digits; ids are the program's own. What it prints is
quoted where it fails.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from orchestrator.config.mesh import ProgramPart
from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.folders import temporary
from orchestrator.processes import last_words, waited_for
from orchestrator.scene.foreign.joints import Joints
from orchestrator.scene.foreign.matrix import between, checked_nodes

SPRINGS, FORCES = "springs.txt", "forces.txt"
DISPLACEMENTS, JOINT = "displacements.txt", "joint.txt"
LINES = 400_000  # of forces in one call: more cases are more calls


class ProgramRuns:
    """Runs of one program. part : the entry of ``parts``; path : where it stands in the YAML; name
    : of the part.
    """

    def __init__(self, part: ProgramPart, path: KeyPath, name: str):
        self.part, self.path, self.name = part, path, name
        with open(part.run, "rb") as script:
            first = script.readline(256)
        interpreter = os.fsdecode((first[2:].split() or [b""])[0]) if first.startswith(
            b"#!") else ""
        if interpreter and not os.path.exists(interpreter):
            raise self.wrong(f"{part.run} cannot be started: there is no {interpreter}",
                             "a program, or a script whose first line is #! and an "
                             "interpreter that is there", "look at its first line")
        if not os.access(part.run, os.X_OK):
            raise self.wrong(f"{part.run} may not be executed",
                             "a program, or a script that begins with #!", f"chmod +x {part.run}")

    def joints(self) -> list[list[str]]:
        """Words of the rows of joint.txt, four or five each, of a call without joint nodes."""
        with self._called(np.empty(0, int), np.empty((0, 3)), [], []) as folder:
            rows = self._rows(folder / JOINT)
        for line, words in enumerate(rows, 1):
            if len(words) not in (4,
                                  5) or not _numbers(words[:4]) or not float(words[0]).is_integer():
                raise self.wrong(f"{JOINT}, line {line}: {' '.join(words)[:80]}",
                                 "id x y z, and the joint's name if there are several",
                                 "a line for each node of the joint, ids whole numbers")
        if not rows:
            raise self.wrong(f"{JOINT} is empty", "a line id x y z for each node of the joint",
                             "write it in every call, the first too")
        return rows

    def displacements(self, ids: np.ndarray, springs: np.ndarray, own: Sequence[int],
                      forces: np.ndarray,
                      folder: Path | None = None) -> np.ndarray:
        """(cases, 3n) displacements of the joint nodes.

        ids : (n,) int, the program's own; springs : (3n,) stiffness to add
        own : per case, 0 or the load step whose own loads act
        forces : (cases, 3n)
        folder : where the program is started, and what it leaves stays; none: one that goes again
        """
        together = len(own) if folder else max(1, LINES // max(1, len(ids)))
        found = []
        for first in range(0, len(own), together):
            chosen = slice(first, first + together)
            with self._called(ids, springs.reshape(-1, 3), own[chosen],
                              forces[chosen].reshape(-1, len(ids), 3), folder) as where:
                found.append(self._read(where / DISPLACEMENTS, ids, len(own[chosen])))
        return np.concatenate(found) if found else np.zeros((0, 3 * len(ids)))

    def _read(self, file: Path, ids: np.ndarray, cases: int) -> np.ndarray:
        words, wanted = self._text(file).split(), np.tile(ids, cases)
        if len(words) != 4 * len(wanted):
            raise self.wrong(f"{file.name} has {len(words)} numbers",
                             f"{4 * len(wanted)}: for each of {cases} cases and {len(ids)} joint "
                             "nodes a row id ux uy uz",
                             "write a row for each node, case after case, in the order asked")
        try:
            table = np.array(words, dtype=float).reshape(-1, 4)
        except ValueError:
            table = np.array([[float(w) if _numbers([w]) else np.nan for w in words]]).reshape(
                -1, 4)
        if len(bad := np.flatnonzero(~np.isfinite(table).all(axis=1))):
            raise self.wrong(
                f"{file.name}, row {bad[0] + 1}: "
                f"{' '.join(words[4 * bad[0] : 4 * bad[0] + 4])[:80]}", "id ux uy uz, numbers that "
                                                                        "are finite",
                "look for a matrix that is singular, and for formats that are too narrow (*** in "
                "Fortran)")
        if len(bad := np.flatnonzero(table[:, 0] != wanted)):
            raise self.wrong(
                f"{file.name}, row {bad[0] + 1}: node {words[4 * bad[0]]} where {wanted[bad[0]]} "
                "was asked",
                             f"the nodes in the order of {FORCES}",
                "write them in the order in which they are read")
        return table[:, 1:].reshape(cases, 3 * len(ids))

    def _rows(self, file: Path) -> list[list[str]]:
        return [words for line in self._text(file).splitlines() if (words := line.split())]

    def _text(self, file: Path) -> str:
        try:
            return file.read_text(encoding="utf-8", errors="replace")
        except OSError:
            raise self.wrong(f"it left no {file.name}",
                             "a file of that name in the folder that it was started in",
                             "write it to the current folder, under that very name") from None

    @contextmanager
    def _called(self, ids: np.ndarray, springs: np.ndarray, own: Sequence[int],
                forces: np.ndarray | Sequence,
                folder: Path | None = None) -> Iterator[Path]:
        """A call; the folder with what it has left, which goes afterwards unless it was given."""
        with temporary() if folder is None else nullcontext(folder) as where:
            rows = [f"{i} {k[0]:.17g} {k[1]:.17g} {k[2]:.17g}"
                    for i, k in zip(ids.tolist(), springs.tolist())]
            (where / SPRINGS).write_text("\n".join([str(len(ids)), *rows]) + "\n")
            rows = [f"{len(ids)} {len(own)}"]
            for t, case in zip(own, forces):
                rows.append(str(t))
                rows += [f"{i} {f[0]:.17g} {f[1]:.17g} {f[2]:.17g}"
                         for i, f in zip(ids.tolist(), case.tolist())]
            (where / FORCES).write_text("\n".join(rows) + "\n")
            self._run(where)
            yield where

    def _run(self, folder: Path) -> None:
        """Start it and wait for its end; whatever happens, nothing of it is left running."""
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        with tempfile.TemporaryFile() as log:
            try:
                code = waited_for([os.path.abspath(self.part.run), *self.part.arguments],
                                  self.part.timeout, cwd=folder,
                                  env=environment, stdout=log, stderr=log)
            except OSError as error:
                raise self.wrong(f"{self.part.run} cannot be started: {error.strerror}",
                                 "a program, or a script whose first line is #! and an interpreter "
                                 "that is there",
                                 "look at its first line") from error
            except subprocess.TimeoutExpired:
                raise self.wrong(f"no answer within {self.part.timeout:g} s",
                                 "an answer within timeout", "raise timeout in its entry, or look "
                                 "for what it waits for: it has no "
                                 "input but its files") from None
            if code:
                said = last_words(log).splitlines()[-5:]
                how = (
                    f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}")
                raise self.wrong(f"{Path(self.part.run).name} {how}"
                                 + (": " + " | ".join(said) if said else ", saying nothing"),
                                 "exit code 0",
                                 "run it by hand in a folder with the two files, see "
                                 "docs/programs.md")

    def wrong(self, found: str, expected: str, cure: str = "") -> InputError:
        """The error to raise."""
        return wrong((*self.path, "run"), f"'{self.name}': {found}", expected, cure)


def _numbers(words: Sequence[str]) -> bool:
    try:
        return bool(np.isfinite([float(word) for word in words]).all())
    except ValueError:
        return False


def joints(part: ProgramPart, path: KeyPath, name: str) -> Joints:
    """The joint nodes in the program's order; of a flat joint that has no faces, triangles between
    all nodes.
    """
    runs = ProgramRuns(part, path, name)
    rows = runs.joints()
    table = [[float(word) for word in words[:4]] for words in rows]
    ids, points = checked_nodes(table, JOINT, (*path, "run"))
    labels = [words[4] if len(words) == 5 else "joint" for words in rows]
    return between(part, ids, points, labels, path, name)

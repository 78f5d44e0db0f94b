"""A part whose mesh is not ours, as a code: it is brought to its joints once, then answered for by
algebra.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, SerializeAsAny

from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.start import find_codes
from orchestrator.blackbox.transport.runs import AlgebraWorker
from orchestrator.blackbox.transport.worker import Worker
from orchestrator.config.base import as_list
from orchestrator.config.blackbox import CodeSettings
from orchestrator.config.mesh import ForeignPart
from orchestrator.errors import InputError, wrong
from orchestrator.processes import end_all
from orchestrator.scene.foreign.answers import UnitAnswers
from orchestrator.scene.foreign.condensed import Condensed, judged
from orchestrator.scene.foreign.joints import read_joints
from orchestrator.scene.foreign.program import ProgramRuns
from orchestrator.scene.model import Scene, Subdomain


class ForeignCode(Code):
    """Answers for one part. A kind of part derives from it and says in ``made`` how a part is
    brought to its joints.
    """

    own_matter: ClassVar[bool] = True
    guarded: ClassVar[bool] = False

    class ForeignSettings(CodeSettings):
        """One part's entry in ``parts``."""

        element: Literal["P1"] = "P1"
        transport: Literal["file"] = "file"
        workers: Literal[1] = 1
        part: SerializeAsAny[ForeignPart] = Field(description="the part's own entry")
        name: str = Field(description="of the part")
        place: tuple[str | int, ...] = Field(description="of its entry in the YAML")
        young: float | None = Field(None, description="a representative modulus; none: not known")
        factors: tuple[float, ...] = Field((), description="of its own loads, one per load step")

        @property
        def brings_loads(self) -> bool:
            """Whether it has any; what flows answers to loads and forces together."""
            return bool(self.part.loads)

    Settings = ForeignSettings

    @property
    def name(self) -> str:
        """The name in messages and in the summary: its kind."""
        return self.settings.part.kind

    def made(self) -> Condensed:
        """The part on its joints; raises InputError where it can be none."""
        raise NotImplementedError

    def condensed(self) -> Condensed:
        """The condensed part, made once per process."""
        return self._kept()[0]

    @property
    def seconds(self) -> float:
        """CPU seconds that bringing it there has taken, of this process and of the programs that it
        has started.
        """
        return self._kept()[1]

    def loads(self) -> np.ndarray:
        """(steps, 3n) its own loads on its joints at every load step."""
        return np.asarray(self.settings.factors)[:, None] * self.condensed().loads

    def wrong(self, key: str, found: str, expected: str, cure: str) -> InputError:
        """The error to raise for a key of its entry."""
        return wrong((*self.settings.place, key), found, expected, cure)

    def check(self) -> None:
        """Check the part by condensing it to its joints."""
        self.condensed()

    def own_fields(self, u: Any, force: Any) -> OwnFields:
        """Fields at the end, given the displacements (steps, n, 3) of its joints and the forces on
        them.
        """
        joints = self.condensed().joints
        return OwnFields(self.settings.name, joints.points, [("triangle", joints.triangles)], u,
                         force)

    def floor(self) -> float:
        return self.condensed().floor

    def kill(self) -> None:
        """End what it has started and waits for, from any thread: whoever interrupts a run does
        not.
        """
        end_all()

    def worker(self) -> type[Worker]:
        return AlgebraWorker

    def command(self, requests: str, replies: str) -> Sequence[str]:
        """None: it is answered for in this process."""
        raise NotImplementedError

    def _kept(self) -> tuple[Condensed, float]:
        """The part condensed to its joints, and the CPU seconds that took; once per process for an
        entry and its files as they are.
        """
        part, settings = self.settings.part, self.settings
        key: tuple = (type(self), part.model_dump_json(), settings.name, len(settings.factors))
        for file in (name for kind in part.files for name in as_list(getattr(part, kind) or [])):
            with suppress(OSError):
                key += file, os.stat(file).st_mtime_ns, os.stat(file).st_size
        if key not in _KEPT:
            begin = os.times()
            made, end = self.made(), os.times()
            _KEPT[key] = made, sum(end[:4]) - sum(begin[:4])
        return _KEPT[key]


_KEPT: dict[tuple, tuple[Condensed, float]] = {}


class MatrixCode(ForeignCode):
    """A part that is a matrix."""

    def made(self) -> Condensed:
        from orchestrator.scene.foreign import matrix  # with it comes scipy.io

        settings = self.settings
        return matrix.condensed(settings.part, settings.place, settings.name, len(settings.factors),
                                settings.young)


class ProgramCode(ForeignCode):
    """A part that is a program."""

    class ProgramSettings(ForeignCode.Settings):
        """One part's entry in ``parts``."""

        writes_results: ClassVar[bool] = True

        @property
        def unasked(self) -> tuple[str, ...]:
            """Its joints."""
            return (f"'{self.name}': {Path(self.part.run).name} is not started, which alone knows "
                    "its joints: its interfaces, its stiffness and whether all is held",)

    Settings = ProgramSettings

    def runs(self) -> ProgramRuns:
        """Calls of the part's program."""
        return ProgramRuns(self.settings.part, self.settings.place, self.settings.name)

    def made(self) -> Condensed:
        """Condense the program's part; every answer is judged on the way."""
        part, path, name = self.settings.part, self.settings.place, self.settings.name
        joints, runs = read_joints(part, path, name), self.runs()
        corners = joints.points[joints.triangles]
        side = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
        answers = UnitAnswers.of(runs, joints, (self.settings.young or 1.0) * side)
        loads, steps = np.zeros((1, joints.points.size)), len(self.settings.factors)
        if self.settings.brings_loads:
            alone = runs.displacements(joints.ids, answers.springs, range(1, steps + 1),
                                       np.zeros((steps, joints.points.size)))
            loads = alone @ answers.inverse
        return judged(joints, answers.stiffness, loads, (*path, "run"), name, answers.error)

    def finish(self, folder: Path, displacements: np.ndarray, forces: np.ndarray) -> None:
        """The last call, whose files stay: all load steps with the final forces, so that the
        program writes its own results.

        folder : empty; displacements, forces : (steps, 3n) of the joints, and what acts there
        """
        part, condensed, steps = self.settings.part, self.condensed(), len(displacements)
        k = np.full(forces.shape[1], float(np.abs(np.diag(condensed.stiffness)).mean()))
        asked = forces + k * displacements
        if self.settings.brings_loads:  # it knows of no history
            asked = asked + self.loads() - condensed.loads
        self.runs().displacements(condensed.joints.ids, k,
                                  range(1, steps + 1) if part.loads else [0] * steps, asked, folder)


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


def fields_of_parts(settings: Sequence[CodeSettings], scene: Scene,
                    displacements: Sequence[np.ndarray],
                    forces: Sequence[np.ndarray | None]) -> list[OwnFields]:
    """Fields of all parts of a scene; arguments as of ``finish_parts``."""
    found = []
    for stand in scene.mesh.foreign:
        own = next(s for s in scene.subdomains if s.foreign
                   and scene.mesh.volume[s.cells[0]] == stand.volume)
        code, = find_codes(settings, [own.code]).values()
        found.append(
            code.own_fields(*(x[own.index][:, : stand.joints] for x in (displacements, forces))))
    return found


def finish_parts(settings: Sequence[CodeSettings], subdomains: Sequence[Subdomain],
                 displacements: Sequence[np.ndarray],
                 forces: Sequence[np.ndarray | None],
                 place: Callable[[str], AbstractContextManager[Path]]) -> list[str]:
    """Tell every part that wants to know.

    settings : the entries of ``blackbox``, and those of parts
    displacements, forces : per subdomain (T, n_E, 3), its own, and what the interfaces exert; the
        joints' nodes come first
    place : an empty folder for the results of the part of a name

    Returns a sentence for each part that could not: what has been computed is not lost by it
    """
    asked = {s.code: s for s in subdomains if s.foreign
             and settings[s.code].writes_results}
    sentences = []
    for number, code in (find_codes(settings, asked) if asked else {}).items():
        s = asked[number]
        u, f = (x[:, : len(code.condensed().joints.points)].reshape(len(x), -1)
                for x in (displacements[s.index], forces[s.index]))
        try:
            with place(settings[number].name) as folder:
                code.finish(folder, u, f)
        except InputError as error:
            sentences.append(f"no results of {s.name}: {error.problems[0].found}")
    return sentences

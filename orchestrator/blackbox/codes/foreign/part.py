"""A part whose mesh is not ours, as a code: it is brought to its joints once, then answered for by algebra."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field, SerializeAsAny

from orchestrator.blackbox.codes.code import Code
from orchestrator.config.blackbox import CodeSettings
from orchestrator.config.parts import ForeignPart
from orchestrator.errors import InputError, Problem
from orchestrator.processes import end_all

if TYPE_CHECKING:
    from orchestrator.blackbox.codes.foreign.condensed import Condensed
    from orchestrator.blackbox.codes.foreign.results import OwnFields
    from orchestrator.blackbox.transport.worker import Worker


class ForeignCode(Code):
    """Answers for one part. A kind of part derives from it and says in ``made`` how a part is brought to its joints.

    What is nonlinear says in ``respond(springs, forces)`` how its joints move, (3n,), at the end of load steps under forces (3n,)
    each, from the beginning.
    """

    own_matter: ClassVar[bool] = True
    guarded: ClassVar[bool] = False

    class Settings(CodeSettings):
        """What ``parts`` says of one part."""

        element: Literal["P1"] = "P1"
        transport: Literal["file"] = "file"
        workers: Literal[1] = 1
        part: SerializeAsAny[ForeignPart] = Field(description="the part's own entry")
        name: str = Field(description="of the part")
        place: tuple[str | int, ...] = Field(description="of its entry in the YAML")
        young: float | None = Field(None, description="a representative modulus; none: not known")
        factors: tuple[float, ...] = Field((), description="of its own loads, one per load step")

        @property
        def remembers(self) -> bool:
            return getattr(self.part, "nonlinear", False)

        @property
        def brings_loads(self) -> bool:
            """Whether it has any; what flows answers to loads and forces together."""
            return bool(getattr(self.part, "loads", None)) and not self.remembers

    @property
    def name(self) -> str:
        """In messages and in the summary: its kind."""
        return self.settings.part.kind

    def made(self) -> Condensed:
        """The part on its joints; raises InputError where it can be none."""
        raise NotImplementedError

    def condensed(self) -> Condensed:
        """The same, made once per process for each part."""
        return self._kept()[0]

    @property
    def seconds(self) -> float:
        """CPU seconds that bringing it there has taken, of this process and of the programs that it has started."""
        return self._kept()[1]

    def loads(self, steps: int) -> Any:
        """(steps, 3n) its own loads on its joints."""
        from orchestrator.blackbox.codes.foreign.condensed import of_steps

        return of_steps(self.condensed().loads, self.settings.factors)

    def wrong(self, key: str, found: str, expected: str, cure: str) -> InputError:
        """The error to raise for a key of its entry."""
        return InputError(Problem((*self.settings.place, key), found, expected, cure))

    def check(self) -> None:
        """As ``Code`` says: the part is brought to its joints."""
        self.condensed()

    def own_fields(self, u: Any, force: Any) -> OwnFields:
        """What it ends with, given the displacements (steps, n, 3) of its joints and the forces on them."""
        from orchestrator.blackbox.codes.foreign.results import OwnFields

        joints = self.condensed().joints
        return OwnFields(self.settings.name, joints.points, [("triangle", joints.triangles)], u, force)

    def floor(self) -> float:
        return self.condensed().floor

    def kill(self) -> None:
        """End what it has started and waits for, from any thread: whoever interrupts a run does not."""
        end_all()

    def worker(self) -> type[Worker]:
        from orchestrator.blackbox.codes.foreign.algebra import AlgebraWorker, ReplayWorker

        return ReplayWorker if self.settings.remembers else AlgebraWorker

    def command(self, requests: str, replies: str) -> Sequence[str]:
        """None: it is answered for in this process."""
        raise NotImplementedError

    def _kept(self) -> tuple[Condensed, float]:
        """What it is on its joints, and the CPU seconds that took: once per process for each entry, and for its files as they are."""
        part, settings = self.settings.part, self.settings
        files = [name for key in part.files if (given := getattr(part, key)) is not None for name in ([given] if isinstance(given, str) else given)]
        key = (type(self), part.model_dump_json(), settings.name, len(settings.factors), *map(_stamp, files))
        if key not in _KEPT:
            begin = os.times()
            made, end = self.made(), os.times()
            _KEPT[key] = made, sum(end[:4]) - sum(begin[:4])
        return _KEPT[key]


_KEPT: dict[tuple, tuple[Condensed, float]] = {}


def _stamp(file: str) -> str:
    with suppress(OSError):
        about = os.stat(file)
        return f"{file} {about.st_mtime_ns} {about.st_size}"
    return file

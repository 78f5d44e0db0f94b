"""A finite element code as the orchestrator sees it: the base of all of them.

Modules of codes are imported to validate a configuration: they load numpy and the transports only
when they run.
"""

from __future__ import annotations

import os
import signal
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from orchestrator.blackbox.protocol import Model
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError

if TYPE_CHECKING:
    from orchestrator.blackbox.transport.worker import Worker

_HINTS = {"SIGKILL": ", by hand or by the kernel for want of memory",
          "SIGSEGV": ", segmentation fault", "SIGABRT": ", abnormal end"}

# seconds for what is asked once: a form to be compiled, an interpreter to say what it has
PATIENCE = 60


class Code(ABC):
    """A finite element code, found once and then started as often as there are workers.

    settings : its entry in the YAML; none: the defaults
    Settings : the model of its entries: what it can do of ``element`` and ``transport``, and
        options of its own

    translation_invariant, own_matter : what may be relied on, see ``protocol.Traits``; None: its
        process tells
    check_runs : whether ``check`` runs what the user has written, so that it needs the user's word
    guarded : whether its matrices and fields are judged as they arrive; else it judges them itself
    meanings : of its exit codes

    The constructor of a code raises InputError when the code is not installed: nothing has been
    started yet.

    Examples
    --------
    >>> import orchestrator
    >>> code = orchestrator.CODES["freefem"]()
    >>> code.name, code.settings.element, code.meaning(8)
    ('freefem', 'P1', '8: runtime error in the script')
    """

    Settings: ClassVar[type[CodeSettings]] = CodeSettings
    translation_invariant: ClassVar[bool | None] = False
    own_matter: ClassVar[bool | None] = False
    check_runs: ClassVar[bool] = False
    guarded: ClassVar[bool] = True
    meanings: ClassVar[Mapping[int, str]] = {}

    def __init__(self, settings: CodeSettings | None = None):
        self.settings = settings or self.Settings()

    @property
    def name(self) -> str:
        """The name in messages and in the summary."""
        return self.settings.code

    @abstractmethod
    def worker(self) -> type[Worker]:
        """The class that drives its processes, by ``settings.transport``."""

    @abstractmethod
    def command(self, requests: str, replies: str) -> list[str]:
        """Command line of a process that reads and writes these paths."""

    def files(self) -> dict[str, str]:
        """Texts that its processes find in their folder, by name."""
        return {}

    def environment(self) -> dict[str, str]:
        """Environment of its processes: one thread each, since parallelism is over subdomains."""
        return {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

    def meaning(self, exit_code: int) -> str:
        """The meaning of an exit code; negative: killed by that signal."""
        if exit_code >= 0:
            otherwise = "ended with an error" if exit_code else "normal end"
            return f"{exit_code}: {self.meanings.get(exit_code, otherwise)}"
        known = [s.name for s in signal.Signals if s == -exit_code]
        name = known[0] if known else f"signal {-exit_code}"
        return f"{exit_code}: killed by {name}{_HINTS.get(name, '')}"

    def check(self) -> None:
        """Raises InputError for what is wrong with files of its own, as far as it shows before
        anything is solved.
        """

    def ask(self) -> None:
        """Raises InputError where a program that the entry names, once started, turns out to lack
        what is needed.
        """

    def floor(self) -> float:
        """Relative error, in energy, that no iteration takes away, see ``protocol.Traits``."""
        return 0.0

    def version(self) -> str:
        """The version that the code itself tells, e.g. "4.9"; empty where it does not tell."""
        return ""

    @classmethod
    def doctor(cls, name: str) -> list[str]:
        """List what is installed of the code called ``name``, a line each; a line of what every run
        needs begins with
        ``missing`` where it is."""
        try:
            return [f"{name}: {cls(cls.Settings(code=name)).version()}"]
        except InputError as error:
            return [f"no {name} (optional): {error.problems[0].cure}"]


class MessageCode(Code):
    """A code whose processes speak the bytes of ``messages``, through pipes or through files.
    mesh_suffix : of the files that ``mesh`` fills
    """

    mesh_suffix: ClassVar[str]

    def worker(self) -> type[Worker]:
        from orchestrator.blackbox.transport.session import MessageWorker

        return MessageWorker

    def heard(self, numbers: Sequence[float]) -> None:
        """Told the numbers of its processes' first words; what they mean is between the code and
        its processes.
        """

    def told(self, model: Model) -> Model:
        """The model as its processes are told of it: regions may mean something else to it."""
        return model

    @abstractmethod
    def mesh(self, model: Model) -> bytes:
        """Bytes of a model's mesh file, which the code reads before it answers."""

    def missing_part(self, exit_code: int, said: str) -> InputError | None:
        """The error to raise when a process ends with this code before its first word, if it is the
        installation's.

        said : the last lines that it printed
        """
        return None

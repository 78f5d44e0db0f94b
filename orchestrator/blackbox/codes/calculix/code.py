"""CalculiX as a code: where it is, how it is started, what its end means.

The environment variable ``ORCHESTRATOR_CALCULIX`` names another executable than the ``ccx`` of the path.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from orchestrator.blackbox.codes.code import Code
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError, Problem

if TYPE_CHECKING:
    from orchestrator.blackbox.codes.calculix.worker import CalculixWorker



class CalculiX(Code):
    """The CalculiX executable. Raises InputError when it is not there."""

    translation_invariant = True
    install = "apt-get install calculix-ccx   (or ORCHESTRATOR_CALCULIX=/path/to/ccx)"
    meanings = {201: "CalculiX stopped with an error"}

    class Settings(CodeSettings):
        """CalculiX, one run per question."""

        element: Literal["P1"] = Field("P1", description="linear tetrahedra: CalculiX is used for no other here")
        transport: Literal["file"] = Field("file", description=("CalculiX ends after every run: write transport: file, or leave it out"))

    def __init__(self, settings: CodeSettings | None = None):
        super().__init__(settings)
        wanted = os.environ.get("ORCHESTRATOR_CALCULIX", "")
        self.executable = shutil.which(wanted or "ccx")
        if self.executable is None:
            found = f"ORCHESTRATOR_CALCULIX={wanted} is no executable" if wanted else "no ccx in the path"
            raise InputError(Problem(("blackbox", "code"), found, "the CalculiX executable", self.install))

    def worker(self) -> type[CalculixWorker]:
        """The one that knows its decks and files."""
        from orchestrator.blackbox.codes.calculix.worker import CalculixWorker

        return CalculixWorker

    def command(self, requests: str, replies: str = "") -> list[str]:
        """Command line that runs the deck ``requests``.inp; replies are files of the same name."""
        return [self.executable, "-i", requests]

    def environment(self) -> dict[str, str]:
        """Without CalculiX's own variables for threads."""
        return {key: value for key, value in super().environment().items() if key != "NUMBER_OF_CPUS" and not key.startswith("CCX_NPROC")}

    def version(self) -> str:
        """What CalculiX says it is, e.g. "2.20"; empty when it does not answer."""
        return self._version

    @cached_property
    def _version(self) -> str:
        answer = subprocess.run([self.executable, "-v"], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
        found = re.search(r"Version\s+(\S+)", answer.stdout)
        return found[1] if found else ""

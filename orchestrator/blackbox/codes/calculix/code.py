"""Where CalculiX is, how it is started, what its end means.

The environment variable ``ORCHESTRATOR_CALCULIX`` names another executable than the ``ccx`` of the path.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess

from orchestrator.blackbox.pool.exits import exit_meaning
from orchestrator.blackbox.codes.calculix.worker import CalculixWorker
from orchestrator.errors import InputError, Problem

_MEANINGS = {201: "CalculiX stopped with an error"}


class CalculiX:
    """The CalculiX executable, found once.

    Raises InputError when it is not there: nothing has been started yet.
    """

    name = "calculix"
    elements = ("P1",)
    transports = {"file": CalculixWorker}
    install = "apt-get install calculix-ccx   (or ORCHESTRATOR_CALCULIX=/path/to/ccx)"

    def __init__(self) -> None:
        wanted = os.environ.get("ORCHESTRATOR_CALCULIX", "")
        executable = shutil.which(wanted or "ccx")
        if executable is None:
            found = f"ORCHESTRATOR_CALCULIX={wanted} is no executable" if wanted else "no ccx in the path"
            raise InputError(Problem(("blackbox", "code"), found, "the CalculiX executable", self.install))
        self.executable = executable

    def command(self, job: str, _: str = "") -> list[str]:
        """Command line that runs the deck ``job.inp``."""
        return [self.executable, "-i", job]

    @staticmethod
    def environment() -> dict[str, str]:
        """Environment of the child process: one thread, since parallelism is over subdomains."""
        environment = {key: value for key, value in os.environ.items()
                       if key != "NUMBER_OF_CPUS" and not key.startswith("CCX_NPROC")}
        return {**environment, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

    def version(self) -> str:
        """What CalculiX says it is, e.g. "2.20"; empty when it does not answer."""
        answer = subprocess.run([self.executable, "-v"], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                                timeout=60)
        found = re.search(r"Version\s+(\S+)", answer.stdout)
        return found[1] if found else ""

    @staticmethod
    def meaning(exit_code: int) -> str:
        """What an exit code (negative: killed by that signal) says."""
        return exit_meaning(exit_code, _MEANINGS)

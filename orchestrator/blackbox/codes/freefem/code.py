"""FreeFEM as a code: how it is started, what its exit codes mean."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

from orchestrator.blackbox.codes.code import MessageCode
from orchestrator.blackbox.codes.freefem import installation
from orchestrator.blackbox.codes.freefem.scripts import SERVER, script
from orchestrator.blackbox.pool.exits import exit_meaning
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError

if TYPE_CHECKING:
    from orchestrator.blackbox.protocol import Model

_NO_PLUGIN = 2
_MEANINGS = {
    1: "compile error in the script",
    _NO_PLUGIN: "a plugin is missing",
    6: "internal assertion of FreeFEM (an inverted tet or an orphan vertex?)",
    8: "runtime error in the script",
    64: "the server script was started without its two paths",
    65: "the server script received an unknown operation",
    66: "the node numbers sent do not fit the mesh",
    250: "the script was not found",
    139: "segmentation fault",
    127: "the executable or one of its libraries was not found",
    126: "the executable could not be run",
}


class FreeFem(MessageCode):
    """The FreeFEM executable.

    Raises InputError when FreeFEM, its script or its plugin is not there.
    """

    translation_invariant = True
    mesh_suffix = "meshb"

    class Settings(CodeSettings):
        """FreeFEM, which can do all that can be asked for."""

    def __init__(self, settings: CodeSettings | None = None):
        super().__init__(settings)
        if problems := installation.missing():
            raise InputError(problems)
        self.executable = installation.executable()
        self._environment = installation.environment()
        self._said = ""

    def command(self, requests: str, replies: str) -> list[str]:
        """Command line of a subdomain server that reads and writes these paths."""
        return [self.executable, "-ne", "-nw", "-v", "0", str(script(SERVER)), requests, replies]

    def environment(self) -> dict[str, str]:
        """With its folders of plugins and includes, and OpenBLAS."""
        return dict(self._environment)

    def heard(self, numbers: Sequence[float]) -> None:
        """Its version: to ask for it takes a process."""
        self._said = f"{numbers[0]:g}" if len(numbers) else ""

    def version(self) -> str:
        """What FreeFEM says it is, and where it comes from a package that one's version: Debian's 4.11 says 4.9.

        E.g. "4.9 (package freefem++ 4.11+dfsg1-3)"; empty when it does not answer.
        """
        package = installation.package(self.executable)
        return (self._said or _version(self.executable)) + (f" (package {package})" if package else "")

    def mesh(self, model: Model) -> bytes:
        """Medit's binary format."""
        from orchestrator.blackbox.codes.freefem import meshb

        return meshb.encode(model)

    def meaning(self, exit_code: int) -> str:
        """As ``Code`` says."""
        return exit_meaning(exit_code, _MEANINGS, "ended by the script")

    def missing_part(self, exit_code: int, said: str) -> InputError | None:
        """The plugin: FreeFEM finds out about it only when it reads the script."""
        if exit_code != _NO_PLUGIN:
            return None
        return InputError(installation.no_plugin(self._environment.get("FF_LOADPATH", "")))

    @classmethod
    def doctor(cls, name: str) -> list[str]:
        """Executable, scripts, plugin, OpenBLAS and setpriv, a line each."""
        return installation.report()


@cache
def _version(executable: str) -> str:
    with tempfile.NamedTemporaryFile("w", suffix=".edp", prefix="orchestrator-version-") as question:
        question.write("cout << version << endl;\n")
        question.flush()
        answer = subprocess.run([executable, "-ne", "-nw", "-v", "0", question.name], env=installation.environment(),
                                stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    return next((row.strip() for row in answer.stdout.splitlines() if row.strip()), "")

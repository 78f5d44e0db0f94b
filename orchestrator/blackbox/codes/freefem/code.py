"""FreeFEM as a code: how it is started, what its exit codes mean."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from orchestrator.blackbox.codes.code import MessageCode
from orchestrator.blackbox.codes.freefem import installation
from orchestrator.blackbox.codes.freefem.form import FORM_SERVER, check_form, form_server, not_compiled, refused_term, with_volumes
from orchestrator.config.base import Name
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError

if TYPE_CHECKING:
    from orchestrator.blackbox.protocol import Model

_COMPILING, _NO_PLUGIN = 1, 2
_PATIENCE = 60  # seconds for a form to be compiled


class FreeFem(MessageCode):
    """The FreeFEM executable. Raises InputError when FreeFEM, its script or its plugin is not there."""

    translation_invariant = True
    mesh_suffix = "meshb"
    meanings = {
        _COMPILING: "compile error in the script",
        _NO_PLUGIN: "a plugin is missing",
        6: "internal assertion of FreeFEM (an inverted tet or an orphan vertex?)",
        8: "runtime error in the script",
        64: "the server script was started without its two paths",
        65: "the server script received an unknown operation",
        66: "the node numbers sent do not fit the mesh",
        67: "the form's Stiffness(u, v) is not symmetric: Stiffness(v, u) is another matrix",
        68: "the form's Stiffness(u, v) acts outside its own regions: write int3d(Th, mine, ...)",
        69: "the form makes rigid motions cost force, as a bedding or a pre-stress does: the error bound would not hold",
        250: "the script was not found",
        139: "segmentation fault",
        127: "the executable or one of its libraries was not found",
        126: "the executable could not be run",
    }

    class Settings(CodeSettings):
        """FreeFEM, which can do all that can be asked for."""

        form: Name | None = Field(None, description=(
            "a .idp file with macros for stiffness and loads, in place of isotropic elasticity; relative to the YAML file"))
        uniform: bool = Field(False, description=(
            "of a form: the same at every place, so that subdomains that differ by a translation share one matrix"))

        @property
        def brings_loads(self) -> bool:
            """A form may."""
            return bool(self.form)

        @classmethod
        def beside(cls, entry: dict[str, Any], folder: Path) -> dict[str, Any]:
            """The form."""
            form = entry.get("form")
            return {**entry, "form": os.path.abspath(folder / form)} if isinstance(form, str) and form else entry

    def __init__(self, settings: CodeSettings | None = None):
        super().__init__(settings)
        if problem := installation.missing():
            raise InputError(problem)
        if self.settings.form:
            check_form(Path(self.settings.form))
            self.translation_invariant, self.own_matter = self.settings.uniform, True
            self.check_runs = True  # it may load libraries and call exec
        self.executable = installation.executable()
        self._environment = installation.environment()
        self._said = ""

    def command(self, requests: str, replies: str) -> list[str]:
        """Command line of a subdomain server that reads and writes these paths."""
        server = FORM_SERVER if self.settings.form else str(installation.script(installation.SERVER))
        return [self.executable, "-ne", "-nw", "-v", "0", server, requests, replies]

    def files(self) -> dict[str, str]:
        """The server's script around a form."""
        return {FORM_SERVER: form_server(Path(self.settings.form))} if self.settings.form else {}

    def check(self) -> None:
        """Of a form: FreeFEM compiles it, and is asked for nothing."""
        if not self.settings.form:
            return
        with tempfile.TemporaryDirectory(prefix="orchestrator-form-") as folder:
            for name, content in self.files().items():
                (Path(folder) / name).write_text(content, encoding="utf-8")
            done = subprocess.run(self.command(os.devnull, os.devnull), env=self.environment(), cwd=folder, stdin=subprocess.DEVNULL,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", timeout=_PATIENCE)
        if missing := self.missing_part(done.returncode, done.stdout):
            raise missing
        if done.returncode:
            raise not_compiled(Path(self.settings.form), done.stdout, self.meaning(done.returncode))

    def told(self, model: Model) -> Model:
        """Of a form: regions are the volumes of the mesh, then the matter of soles."""
        return with_volumes(model) if self.settings.form else model

    def environment(self) -> dict[str, str]:
        """With its folders of plugins and includes, and OpenBLAS."""
        result = {**super().environment(), **self._environment}
        if self.settings.form:  # what it includes is beside it
            folders = [str(Path(self.settings.form).parent), *filter(None, [result.get("FF_INCLUDEPATH")])]
            result["FF_INCLUDEPATH"] = ";".join(folders)
        return result

    def heard(self, numbers: Sequence[float]) -> None:
        """Its version: to ask for it takes a process."""
        self._said = f"{numbers[0]:g}" if len(numbers) else ""

    def version(self) -> str:
        """What FreeFEM says it is, and where it comes from a package that one's version: Debian's 4.11 says 4.9. E.g. "4.9 (package
        freefem++ 4.11+dfsg1-3)"; empty when it does not answer."""
        package = installation.package(self.executable)
        return (self._said or _version(self.executable)) + (f" (package {package})" if package else "")

    def mesh(self, model: Model) -> bytes:
        """Medit's binary format."""
        from orchestrator.blackbox.codes.freefem import meshb

        return meshb.encode(model)

    def missing_part(self, exit_code: int, said: str) -> InputError | None:
        """The plugin, or a term that a form may not have: FreeFEM finds out about them only when it reads the script."""
        if exit_code == _COMPILING and self.settings.form:
            return refused_term(Path(self.settings.form), said)
        if exit_code != _NO_PLUGIN:
            return None
        return InputError(installation.no_plugin(self._environment.get("FF_LOADPATH", "")))

    @classmethod
    def doctor(cls, name: str) -> list[str]:
        """Executable, scripts, plugin, OpenBLAS and setpriv, a line each."""
        return installation.report()


@cache
def _version(executable: str) -> str:
    with tempfile.TemporaryDirectory(prefix="orchestrator-version-") as folder:  # not where freefem++.pref may lie
        (Path(folder) / "version.edp").write_text("cout << version << endl;\n", encoding="utf-8")
        answer = subprocess.run([executable, "-ne", "-nw", "-v", "0", "version.edp"], cwd=folder, stdin=subprocess.DEVNULL,
                                env={**os.environ, **installation.environment()}, capture_output=True, text=True, timeout=60)
    return next((row.strip() for row in answer.stdout.splitlines() if row.strip()), "")

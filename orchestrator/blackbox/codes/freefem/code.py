"""FreeFEM as a code: where it is, its scripts, plugins and BLAS, how it is started, what its exit
codes mean.

Environment variables: ``ORCHESTRATOR_FREEFEM`` names another executable than the ``FreeFem++`` of
the path, ``FF_LOADPATH`` another folder of plugins than Debian's.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import Field

from orchestrator.blackbox.codes.code import MessageCode, PATIENCE
from orchestrator.blackbox.codes.freefem.files import (FORM_SERVER, check_form, encode, form_server,
                                                       not_compiled, refused_term,
                                                       script, with_volumes)
from orchestrator.blackbox.protocol import Model
from orchestrator.config.base import Name
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError, Problem

SERVER, UNDECOMPOSED = "subdomain_server.edp", "undecomposed.edp"
PLUGIN = "bfstream"
INSTALL = "apt-get install freefem++ libfreefem++ libfreefem++-dev libopenblas0-serial"
REINSTALL = "install the orchestrator again, from the whole clone or from a wheel"
# Debian's preference file names a folder that does not exist.
_PLUGIN_FOLDER = "/usr/lib/freefem++"
_INCLUDE_FOLDER = "/usr/include/freefem++/idp"
_COMPILING, _NO_PLUGIN = 1, 2  # exit codes
_BLAS_FOLDERS = ("openblas-serial", "openblas-pthread")


def missing() -> Problem | None:
    """The first thing found that keeps FreeFEM from being started."""
    wanted, server, folder = os.environ.get("ORCHESTRATOR_FREEFEM",
                                            ""), script(SERVER), environment().get(
                                                "FF_LOADPATH", "")
    if executable() is None:
        return Problem(("blackbox", "code"), f"ORCHESTRATOR_FREEFEM={wanted} is no executable"
                       if wanted else "no FreeFem++ in the path",
                       "the FreeFEM executable",
                       f"{INSTALL}   (or ORCHESTRATOR_FREEFEM=/path/to/FreeFem++)")
    if not server.is_file():
        return Problem(("blackbox", "code"), f"no file {server}",
                       "the FreeFEM script of the subdomains", REINSTALL)
    return no_plugin(folder) if _plugin(folder) is None else None


def no_plugin(folder: str) -> Problem:
    """The plugin is not in this folder of plugins, or cannot be loaded."""
    return Problem(("blackbox", "code"),
                   f"FreeFEM without its plugin {PLUGIN} (folder of plugins: {folder or 'none'})",
                   f"{PLUGIN}.so in the folder of plugins",
                   f"{INSTALL}   (or FF_LOADPATH=/folder/of/plugins)")


def executable() -> str | None:
    """Path of FreeFEM, if it is there."""
    return shutil.which(os.environ.get("ORCHESTRATOR_FREEFEM") or "FreeFem++")


def _plugin(folder: str) -> Path | None:
    paths = [Path(part) / f"{PLUGIN}.so" for part in folder.split(";") if part]
    return next((path for path in paths if path.is_file()), None)


@cache
def _openblas() -> Path | None:
    found = [folder for name in _BLAS_FOLDERS
             for folder in sorted(Path("/usr/lib").glob(f"*/{name}"))]
    return next((folder for folder in found if (folder / "libblas.so.3").exists()), None)


def environment() -> dict[str, str]:
    """Variables that FreeFEM's processes need: folders of plugins and includes, OpenBLAS."""
    result = {name: os.environ.get(name, "")
              for name in ("FF_LOADPATH", "FF_INCLUDEPATH", "LD_LIBRARY_PATH")}
    for name, folder in (("FF_LOADPATH", _PLUGIN_FOLDER), ("FF_INCLUDEPATH", _INCLUDE_FOLDER)):
        if not result[name] and Path(folder).is_dir():
            result[name] = folder
    if blas := _openblas():
        result["LD_LIBRARY_PATH"] = ":".join([str(blas),
                                              *filter(None, result["LD_LIBRARY_PATH"].split(":"))])
    return {name: value for name, value in result.items() if value}


def report() -> list[str]:
    """List what is installed and what is missing, one line each; lines of missing things begin with
    ``missing``.
    """
    folder = environment().get("FF_LOADPATH", "")
    things = [("FreeFEM", executable(), f"FreeFEM: {INSTALL}"),
              *(("script", path if path.is_file() else None, f"script {path}: {REINSTALL}")
                for path in map(script, (SERVER, UNDECOMPOSED))),
              ("plugin", _plugin(folder),
               f"plugin {PLUGIN}.so in {folder or 'any folder'}: {INSTALL}"),
              ("OpenBLAS", _openblas(), f"OpenBLAS (factorisations six times slower): {INSTALL}"),
              ("setpriv", shutil.which("setpriv"),
               "setpriv (package util-linux): processes end with their pipes only")]
    return [f"{name}: {path}" if path else f"missing {otherwise}"
            for name, path, otherwise in things]


class FreeFem(MessageCode):
    """The FreeFEM executable. Raises InputError when FreeFEM, its script or its plugin is not
    there.
    """

    translation_invariant = True
    mesh_suffix = "meshb"
    meanings = {_COMPILING: "compile error in the script", _NO_PLUGIN: "a plugin is missing",
                6: "internal assertion of FreeFEM (an inverted tet or an orphan vertex?)",
                8: "runtime error in the script",
                64: "the server script was started without its two paths",
                65: "the server script received an unknown operation",
                66: "the node numbers sent do not fit the mesh",
        67: "the form's Stiffness(u, v) is not symmetric: Stiffness(v, u) is another matrix",
        68: "the form's Stiffness(u, v) acts outside its own regions: write int3d(Th, mine, ...)",
        69: "the form makes rigid motions cost force, as a bedding or a pre-stress does: the error "
                "bound would not hold",
                250: "the script was not found", 139: "segmentation fault",
                127: "the executable or one of its libraries was not found",
                126: "the executable could not be run"}

    class FreeFemSettings(CodeSettings):
        """FreeFEM, which can do all that can be asked for."""

        form: Name | None = Field(None, description=(
            "a .idp file with macros for stiffness and loads, in place of isotropic elasticity; "
            "relative to the YAML file"))
        uniform: bool = Field(False, description=(
            "of a form: the same at every place, so that subdomains that differ by a translation "
            "share one matrix"))

        @property
        def brings_loads(self) -> bool:
            """A form may."""
            return bool(self.form)

        @property
        def unasked(self) -> tuple[str, ...]:
            """Return what its compiler would say of a form."""
            return (f"whether FreeFEM takes {Path(self.form).name}: a form may run programs",
                    ) if self.form else ()

        @classmethod
        def beside(cls, entry: dict[str, Any], folder: Path) -> dict[str, Any]:
            """The entry, its form beside the YAML file."""
            form = entry.get("form")
            return {**entry,
                    "form": os.path.abspath(folder / form)} if isinstance(
                        form, str) and form else entry

    Settings = FreeFemSettings

    def __init__(self, settings: CodeSettings | None = None):
        super().__init__(settings)
        if problem := missing():
            raise InputError(problem)
        if self.settings.form:
            check_form(Path(self.settings.form))
            self.translation_invariant, self.own_matter = self.settings.uniform, True
            self.check_runs = True  # it may load libraries and call exec
        self.executable = executable()
        self._environment = environment()
        self._said = ""

    def command(self, requests: str, replies: str) -> list[str]:
        """Command line of a subdomain server that reads and writes these paths."""
        server = FORM_SERVER if self.settings.form else str(script(SERVER))
        return [self.executable, "-ne", "-nw", "-v", "0", server, requests, replies]

    def files(self) -> dict[str, str]:
        """The server's script around a form."""
        return {FORM_SERVER: form_server(Path(self.settings.form))} if self.settings.form else {}

    def check(self) -> None:
        """Compile a form with FreeFEM, which is asked for nothing else."""
        if not self.settings.form:
            return
        with tempfile.TemporaryDirectory(prefix="orchestrator-form-") as folder:
            for name, content in self.files().items():
                (Path(folder) / name).write_text(content, encoding="utf-8")
            done = subprocess.run(self.command(os.devnull, os.devnull), env=self.environment(),
                                  cwd=folder, stdin=subprocess.DEVNULL,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                  errors="replace", timeout=PATIENCE)
        if absent := self.missing_part(done.returncode, done.stdout):
            raise absent
        if done.returncode:
            raise not_compiled(Path(self.settings.form), done.stdout, self.meaning(done.returncode))

    def told(self, model: Model) -> Model:
        """Regions of a form: the volumes of the mesh, then the matter of soles."""
        return with_volumes(model) if self.settings.form else model

    def environment(self) -> dict[str, str]:
        """The environment with its folders of plugins and includes, and OpenBLAS."""
        result = {**super().environment(), **self._environment}
        if self.settings.form:  # what it includes is beside it
            folders = [str(Path(self.settings.form).parent),
                       *filter(None, [result.get("FF_INCLUDEPATH")])]
            result["FF_INCLUDEPATH"] = ";".join(folders)
        return result

    def heard(self, numbers: Sequence[float]) -> None:
        """Note FreeFEM's version: to ask for it takes a process."""
        self._said = f"{numbers[0]:g}" if len(numbers) else ""

    def version(self) -> str:
        """Return FreeFEM's own version, as "4.9"; empty when it does not answer."""
        return self._said or _version(self.executable)

    def mesh(self, model: Model) -> bytes:
        """Medit's binary format."""
        return encode(model)

    def missing_part(self, exit_code: int, said: str) -> InputError | None:
        """The plugin, or a term that a form may not have: FreeFEM finds out about them only when it
        reads the script.
        """
        if exit_code == _COMPILING and self.settings.form:
            return refused_term(Path(self.settings.form), said)
        if exit_code != _NO_PLUGIN:
            return None
        return InputError(no_plugin(self._environment.get("FF_LOADPATH", "")))

    @classmethod
    def doctor(cls, name: str) -> list[str]:
        """Executable, scripts, plugin, OpenBLAS and setpriv, a line each."""
        return report()


@cache
def _version(executable: str) -> str:
    # not where freefem++.pref may lie
    with tempfile.TemporaryDirectory(prefix="orchestrator-version-") as folder:
        (Path(folder) / "version.edp").write_text("cout << version << endl;\n", encoding="utf-8")
        answer = subprocess.run([executable, "-ne", "-nw", "-v", "0", "version.edp"], cwd=folder,
                                stdin=subprocess.DEVNULL,
                                env={**os.environ, **environment()}, capture_output=True, text=True,
                                timeout=60)
    return answer.stdout.strip().partition("\n")[0].strip()

"""FreeFEM as the code behind the black box: where it is, how it is started, what its exit codes mean.

Environment variables: ``ORCHESTRATOR_FREEFEM`` names another executable than the ``FreeFem++`` of the
path, ``FF_LOADPATH`` another folder of plugins than Debian's.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from functools import cached_property
from pathlib import Path

from orchestrator.blackbox.transport import meshb
from orchestrator.blackbox.codes.freefem_scripts import SERVER, UNDECOMPOSED, script
from orchestrator.blackbox.pool.exits import exit_meaning
from orchestrator.blackbox.transport.file import FileWorker
from orchestrator.blackbox.transport.pipe import PipeWorker
from orchestrator.blackbox.protocol import Model
from orchestrator.errors import InputError, Problem

PLUGIN = "bfstream"
INSTALL = "apt-get install freefem++ libfreefem++ libfreefem++-dev libopenblas0-serial"
REINSTALL = "install the orchestrator again, from the whole clone or from a wheel"
# Debian's preference file names a folder that does not exist.
_PLUGIN_FOLDERS = ("/usr/lib/freefem++",)
_INCLUDE_FOLDER = "/usr/include/freefem++/idp"
_BLAS_FOLDERS = ("openblas-serial", "openblas-pthread")
_MEANINGS = {
    1: "compile error in the script",
    2: "a plugin is missing",
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


class FreeFem:
    """The FreeFEM executable, found once.

    Raises InputError when FreeFEM or its plugin is not there: nothing has been started yet.
    """

    name = "freefem"
    elements = ("P1", "P2")
    transports = {"pipe": PipeWorker, "file": FileWorker}
    mesh_suffix = "meshb"

    def __init__(self) -> None:
        problems = _missing()
        if problems:
            raise InputError(problems)
        self.executable = _executable()
        assert self.executable is not None
        self._environment = _environment()

    def command(self, requests: str, replies: str) -> list[str]:
        """Command line of a subdomain server that reads and writes these paths."""
        return [self.executable, "-ne", "-nw", "-v", "0", str(script(SERVER)), requests, replies]

    def version(self) -> str:
        """What FreeFEM says it is, e.g. "4.9"; empty when it does not answer."""
        return self._version

    @cached_property
    def _version(self) -> str:
        with tempfile.NamedTemporaryFile("w", suffix=".edp", prefix="orchestrator-version-") as script:
            script.write("cout << version << endl;\n")
            script.flush()
            answer = subprocess.run([self.executable, "-ne", "-nw", "-v", "0", script.name], env=self.environment(),
                                    stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
        return next((row.strip() for row in answer.stdout.splitlines() if row.strip()), "")

    @staticmethod
    def mesh(model: Model) -> bytes:
        """Bytes of the mesh file."""
        return meshb.encode(model)

    def environment(self) -> dict[str, str]:
        """Environment of the child process."""
        return dict(self._environment)

    @staticmethod
    def meaning(exit_code: int) -> str:
        """What an exit code (negative: killed by that signal) says."""
        return exit_meaning(exit_code, _MEANINGS, "ended by the script")

    def missing_plugin(self, exit_code: int) -> InputError | None:
        """The error to raise when the server ends with this code before its first word, if it is the installation's."""
        if exit_code != 2:
            return None
        return InputError(_no_plugin(self._environment.get("FF_LOADPATH", "")))


def blas_of(pid: int) -> str:
    """Path of the BLAS library a running process has mapped; '' when none is.

    OpenBLAS makes CHOLMOD's factorisation about six times faster than the reference BLAS.
    """
    libraries = []
    with open(f"/proc/{pid}/maps") as maps:
        for row in maps:
            path = row.split(maxsplit=5)[-1].strip()
            if "blas" in Path(path).name and "gslcblas" not in path and path not in libraries:
                libraries.append(path)
    return next((path for path in libraries if "openblas" in path), libraries[0] if libraries else "")


def doctor() -> list[str]:
    """What is installed and what is missing, one line each; lines of missing things begin with ``missing``."""
    lines = []
    executable = _executable()
    lines.append(f"FreeFEM: {executable}" if executable else f"missing FreeFEM: {INSTALL}")
    folder = _environment().get("FF_LOADPATH", "")
    plugin = _plugin(folder)
    for path in map(script, (SERVER, UNDECOMPOSED)):
        lines.append(f"script: {path}" if path.is_file() else f"missing script {path}: {REINSTALL}")
    lines.append(f"plugin: {plugin}" if plugin else f"missing plugin {PLUGIN}.so in {folder or 'any folder'}: {INSTALL}")
    blas = _openblas()
    lines.append(f"OpenBLAS: {blas}" if blas else f"missing OpenBLAS (factorisations six times slower): {INSTALL}")
    setpriv = shutil.which("setpriv")
    lines.append(f"setpriv: {setpriv}" if setpriv else "missing setpriv (package util-linux): processes end with their pipes only")
    return lines


def _missing() -> list[Problem]:
    wanted = os.environ.get("ORCHESTRATOR_FREEFEM", "")
    if _executable() is None:
        found = f"ORCHESTRATOR_FREEFEM={wanted} is no executable" if wanted else "no FreeFem++ in the path"
        cure = f"{INSTALL}   (or ORCHESTRATOR_FREEFEM=/path/to/FreeFem++)"
        return [Problem(("blackbox", "code"), found, "the FreeFEM executable", cure)]
    server = script(SERVER)
    if not server.is_file():
        return [Problem(("blackbox", "code"), f"no file {server}", "the FreeFEM script of the subdomains", REINSTALL)]
    folder = _environment().get("FF_LOADPATH", "")
    if _plugin(folder) is None:
        return [_no_plugin(folder)]
    return []


def _no_plugin(folder: str) -> Problem:
    return Problem(
        ("blackbox", "code"),
        f"FreeFEM without its plugin {PLUGIN} (folder of plugins: {folder or 'none'})",
        f"{PLUGIN}.so in the folder of plugins",
        f"{INSTALL}   (or FF_LOADPATH=/folder/of/plugins)",
    )


def _executable() -> str | None:
    return shutil.which(os.environ.get("ORCHESTRATOR_FREEFEM") or "FreeFem++")


def _plugin(folder: str) -> str | None:
    for part in folder.split(";"):
        path = Path(part) / f"{PLUGIN}.so"
        if part and path.is_file():
            return str(path)
    return None


def _openblas() -> str | None:
    for name in _BLAS_FOLDERS:
        for folder in sorted(Path("/usr/lib").glob(f"*/{name}")):
            if (folder / "libblas.so.3").exists():
                return str(folder)
    return None


def _environment() -> dict[str, str]:
    environment = dict(os.environ)
    if not environment.get("FF_LOADPATH"):
        folder = next((f for f in _PLUGIN_FOLDERS if Path(f).is_dir()), "")
        if folder:
            environment["FF_LOADPATH"] = folder
    if not environment.get("FF_INCLUDEPATH") and Path(_INCLUDE_FOLDER).is_dir():
        environment["FF_INCLUDEPATH"] = _INCLUDE_FOLDER
    blas = _openblas()
    if blas:
        paths = [blas] + [p for p in environment.get("LD_LIBRARY_PATH", "").split(":") if p]
        environment["LD_LIBRARY_PATH"] = ":".join(paths)
    # Parallelism is over subdomains; threads inside a BLAS call would fight for the same cores.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        environment[variable] = "1"
    return environment

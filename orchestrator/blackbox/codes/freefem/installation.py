"""Where FreeFEM is, its scripts, plugins and BLAS, and what is missing of them.

Environment variables: ``ORCHESTRATOR_FREEFEM`` names another executable than the ``FreeFem++`` of the
path, ``FF_LOADPATH`` another folder of plugins than Debian's.
"""

from __future__ import annotations

import os
import re
import shutil
from functools import cache
from importlib.resources import files
from pathlib import Path

from orchestrator.errors import Problem

SERVER, UNDECOMPOSED = "subdomain_server.edp", "undecomposed.edp"
PLUGIN = "bfstream"
PACKAGE = "freefem++"
INSTALL = "apt-get install freefem++ libfreefem++ libfreefem++-dev libopenblas0-serial"
REINSTALL = "install the orchestrator again, from the whole clone or from a wheel"
# Debian's preference file names a folder that does not exist.
_PLUGIN_FOLDER = "/usr/lib/freefem++"
_INCLUDE_FOLDER = "/usr/include/freefem++/idp"
_BLAS_FOLDERS = ("openblas-serial", "openblas-pthread")


def script(name: str) -> Path:
    """Path of a FreeFEM script: in ``freefem_scripts/`` beside the package in a clone, inside it in a wheel; it may not be there."""
    package = Path(str(files("orchestrator")))
    clone = package.parent / "freefem_scripts"
    return (clone if clone.is_dir() else package / "freefem_scripts") / name


def missing() -> Problem | None:
    """What keeps FreeFEM from being started: the first thing found."""
    wanted, server, folder = os.environ.get("ORCHESTRATOR_FREEFEM", ""), script(SERVER), environment().get("FF_LOADPATH", "")
    if executable() is None:
        return Problem(("blackbox", "code"), f"ORCHESTRATOR_FREEFEM={wanted} is no executable" if wanted else "no FreeFem++ in the path",
                       "the FreeFEM executable", f"{INSTALL}   (or ORCHESTRATOR_FREEFEM=/path/to/FreeFem++)")
    if not server.is_file():
        return Problem(("blackbox", "code"), f"no file {server}", "the FreeFEM script of the subdomains", REINSTALL)
    return no_plugin(folder) if _plugin(folder) is None else None


def no_plugin(folder: str) -> Problem:
    """The plugin is not in this folder of plugins, or cannot be loaded."""
    return Problem(("blackbox", "code"), f"FreeFEM without its plugin {PLUGIN} (folder of plugins: {folder or 'none'})",
                   f"{PLUGIN}.so in the folder of plugins", f"{INSTALL}   (or FF_LOADPATH=/folder/of/plugins)")


def executable() -> str | None:
    """Path of FreeFEM, if it is there."""
    return shutil.which(os.environ.get("ORCHESTRATOR_FREEFEM") or "FreeFem++")


@cache
def package(path: str) -> str:
    """Debian package that an executable belongs to, with its version, e.g. "freefem++ 4.11+dfsg1-3"; '' for none."""
    record = Path("/var/lib/dpkg/info", f"{PACKAGE}.list")  # asked for it, dpkg-query takes as long as a small solve
    try:
        own = os.path.realpath(path)
        if own not in {os.path.realpath(file) for file in record.read_text().split() if Path(file).name == Path(own).name}:
            return ""
        known = Path("/var/lib/dpkg/status").read_text(errors="replace")
    except OSError:
        return ""
    version = re.search(rf"^Package: {re.escape(PACKAGE)}\n(?:.+\n)*?Version: (.+)$", known, re.MULTILINE)
    return f"{PACKAGE} {version[1]}" if version else ""


def _plugin(folder: str) -> Path | None:
    paths = [Path(part) / f"{PLUGIN}.so" for part in folder.split(";") if part]
    return next((path for path in paths if path.is_file()), None)


def _openblas() -> Path | None:
    found = [folder for name in _BLAS_FOLDERS for folder in sorted(Path("/usr/lib").glob(f"*/{name}"))]
    return next((folder for folder in found if (folder / "libblas.so.3").exists()), None)


def environment() -> dict[str, str]:
    """What FreeFEM's processes need in theirs: folders of plugins and includes, OpenBLAS."""
    result = {name: os.environ.get(name, "") for name in ("FF_LOADPATH", "FF_INCLUDEPATH", "LD_LIBRARY_PATH")}
    for name, folder in (("FF_LOADPATH", _PLUGIN_FOLDER), ("FF_INCLUDEPATH", _INCLUDE_FOLDER)):
        if not result[name] and Path(folder).is_dir():
            result[name] = folder
    if blas := _openblas():
        result["LD_LIBRARY_PATH"] = ":".join([str(blas), *filter(None, result["LD_LIBRARY_PATH"].split(":"))])
    return {name: value for name, value in result.items() if value}


def report() -> list[str]:
    """What is installed and what is missing, one line each; lines of missing things begin with ``missing``."""
    folder = environment().get("FF_LOADPATH", "")
    things = [("FreeFEM", executable(), f"FreeFEM: {INSTALL}"),
              *(("script", path if path.is_file() else None, f"script {path}: {REINSTALL}") for path in map(script, (SERVER, UNDECOMPOSED))),
              ("plugin", _plugin(folder), f"plugin {PLUGIN}.so in {folder or 'any folder'}: {INSTALL}"),
              ("OpenBLAS", _openblas(), f"OpenBLAS (factorisations six times slower): {INSTALL}"),
              ("setpriv", shutil.which("setpriv"), "setpriv (package util-linux): processes end with their pipes only")]
    return [f"{name}: {path}" if path else f"missing {otherwise}" for name, path, otherwise in things]

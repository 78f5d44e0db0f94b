"""Where the FreeFEM scripts are: in ``freefem_scripts/`` beside the package in a clone, inside it in a wheel."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

FOLDER = "freefem_scripts"
SERVER, UNDECOMPOSED = "subdomain_server.edp", "undecomposed.edp"


def script(name: str) -> Path:
    """Path of a FreeFEM script, e.g. ``SERVER``; it is for the caller to see whether the file is there."""
    package = Path(str(files("orchestrator")))
    clone = package.parent / FOLDER
    return (clone if clone.is_dir() else package / FOLDER) / name

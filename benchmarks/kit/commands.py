"""Whole runs from the command line, as a user makes them, with their wall time."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Container
from pathlib import Path
from typing import Any

from orchestrator.errors import CONVERGED, NOT_CONVERGED, BlackBoxError
from benchmarks.kit.study import Study

_MPI = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",  # more ranks than cores, in a container:
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe", "OMPI_MCA_rmaps_base_oversubscribe": "1"}


def launcher() -> Path:
    """The mpiexec that belongs to this Python's mpi4py."""
    return Path(sys.executable).with_name("mpiexec")


def without_ranks() -> str | None:
    """Why runs over several ranks cannot be made here; None where they can."""
    if importlib.util.find_spec("mpi4py") is None:
        return "mpi4py is not installed"
    return None if launcher().is_file() else f"no {launcher()}"


def orchestrate(path: Path, *options: str, ranks: int = 1, temporary: Path | None = None) -> subprocess.Popen:
    """``orchestrator run`` under way, its output collected; over several ranks by ``launcher``; ``temporary``: for TMPDIR."""
    command = [sys.executable, "-m", "orchestrator", "run", str(path), *options]
    environment = {**os.environ, **({} if temporary is None else {"TMPDIR": str(temporary)})}
    if ranks > 1:
        command, environment = [str(launcher()), "-n", str(ranks), *command], {**environment, **_MPI}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def whole_command(study: Study, name: str, config: dict[str, Any], ranks: int = 1, *, output: str = "",
                  accepted: Container[int] = (CONVERGED, NOT_CONVERGED)) -> tuple[dict[str, Any], float]:
    """Run a configuration from the command line, in the study's folder.

    Parameters
    ----------
    name : of the file that the configuration is written to
    output : the folder of its results, ``name`` if not given
    accepted : exit codes

    Returns
    -------
    its summary and its wall seconds

    Raises
    ------
    BlackBoxError : the command ended with another exit code
    """
    path = study.folder.write(f"{name}.yaml", json.dumps(config, indent=1))  # JSON is YAML
    folder = study.folder / (output or name)
    begin = time.perf_counter()
    with orchestrate(path, "--output", str(folder), "--quiet", ranks=ranks) as process:
        said, complaint = process.communicate()
    seconds = time.perf_counter() - begin
    if process.returncode not in accepted:
        told = complaint.strip() or said.strip() or f"the run ended with code {process.returncode}"
        raise BlackBoxError(f"{name}: {told}")
    return json.loads((folder / "summary.json").read_text(encoding="utf-8")), seconds

"""Whole runs from the command line, as a user makes them, with their wall time."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.kit.study import Study
from orchestrator import BlackBoxError

CONVERGED, NOT_CONVERGED, BAD_INPUT = 0, 1, 2  # exit codes
CORES = len(os.sched_getaffinity(0))
MPI = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",  # more ranks than cores, in a container:
       "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe", "OMPI_MCA_rmaps_base_oversubscribe": "1"}
_CLONE = str(Path(__file__).resolve().parents[2])


def launcher() -> Path:
    """The mpiexec that belongs to this Python's mpi4py."""
    return Path(sys.executable).with_name("mpiexec")


def without_ranks() -> str | None:
    """Why runs over several ranks cannot be made here; None where they can."""
    if importlib.util.find_spec("mpi4py") is None:
        return "mpi4py is not installed"
    return None if launcher().is_file() else f"no {launcher()}"


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """What is started meanwhile has these values in its environment."""
    before = {name: os.environ.get(name) for name in values}
    os.environ |= dict(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def orchestrate(path: Path, *options: str, ranks: int = 1, temporary: Path | None = None, command: str = "run") -> subprocess.Popen:
    """``orchestrator run``, or another command, under way, its output collected; over several ranks by ``launcher``; ``temporary``: for TMPDIR."""
    words = [sys.executable, "-m", "orchestrator", command, str(path), *options]
    environment = {**os.environ, **({} if temporary is None else {"TMPDIR": str(temporary)})}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installation has its bytecode
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (_CLONE, environment.get("PYTHONPATH"))))
    if ranks > 1:
        words, environment = [str(launcher()), "-n", str(ranks), *words], {**environment, **MPI}
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def whole_command(study: Study, name: str, config: Mapping[str, Any] | Path, ranks: int = 1, *, output: str = "",
                  overrides: Sequence[str] = (), accepted: Container[int] = (CONVERGED, NOT_CONVERGED)) -> tuple[dict[str, Any], float]:
    """Run a configuration from the command line, in the study's folder.

    Parameters
    ----------
    name : of the file that the configuration is written to
    config : plain data, or the place of a file
    overrides : ``key=value`` texts
    output : the folder of its results, ``name`` if not given
    accepted : exit codes

    Returns
    -------
    its summary and its wall seconds

    Raises
    ------
    BlackBoxError : the command ended with another exit code
    """
    path, folder = study.folder / f"{name}.yaml", study.folder / (output or name)
    if isinstance(config, Path):
        path = config
    else:
        path.write_text(json.dumps(config, indent=1), encoding="utf-8")  # JSON is YAML
    more = [word for text in overrides for word in ("--set", text)]
    begin = time.perf_counter()
    with orchestrate(path, "--output", str(folder), "--quiet", *more, ranks=ranks) as process:
        said, complaint = process.communicate()
    seconds = time.perf_counter() - begin
    if process.returncode not in accepted:
        told = complaint.strip() or said.strip() or f"the run ended with code {process.returncode}"
        raise BlackBoxError(f"{name}: {told}")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    if summary["stop_reason"].startswith("failed"):  # by a mistake of ours, with a traceback
        raise BlackBoxError(f"{name}: {summary['stop_reason']}")
    return summary, seconds


def codes_seconds(summary: Mapping[str, Any]) -> float:
    """CPU seconds of the codes, by their own clocks."""
    return sum(summary["timing"]["blackbox"].values())


def cpu_of_children() -> float:
    """CPU seconds of all processes that have ended: what a busy machine does not change."""
    used = os.times()
    return used.children_user + used.children_system


def cpu_seconds() -> float:
    """CPU seconds of this process and of all that it has started and that have ended."""
    return time.process_time() + cpu_of_children()


def shares(summary: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """What a run took: wall seconds, and the codes' *floor*, their own seconds shared evenly by the cores.

    Returns
    -------
    among them ``busiest_factorising``, on the codes' clock; ``balance``, the mean over the busiest worker; ``idle``, the share of
    the iterations in which workers wait
    """
    setup, loop = (summary["workload"][period] for period in ("set_up", "iterations"))
    code = [sum(w[stage] for w in pair for stage in ("assemble", "factorise", "solve")) for pair in zip(setup["workers"], loop["workers"])]
    floor = codes_seconds(summary) / min(len(code), CORES)
    return {"subdomains": summary["subdomains"], "dofs": summary["dofs"], "iterations": summary["iterations"],
            "seconds": seconds, "floor": floor, "over_floor": seconds / floor, "factorising": summary["timing"]["load"],
            "busiest_factorising": max(w["assemble"] + w["factorise"] for w in setup["workers"]),
            "balance": sum(code) / len(code) / max(code),
            "idle": sum(w["waiting"] + w["idle"] for w in loop["workers"]) / sum(w["seconds"] for w in loop["workers"])}

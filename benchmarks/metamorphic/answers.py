"""What a scene answers, in a form that can be turned, scaled, renamed and compared."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from benchmarks.metamorphic.probes import vectors
from orchestrator import BlackBoxError, InputError, Problem, Solution, build_scene, load_config, solve
from orchestrator.run import run

BESIDE = ("files", "ranks", "sittings")  # of a scene's data, what is not in its YAML
REFUSED, CONVERGED, STOPPED, CODE_FAILED, BROKEN = "refused", "converged", "stopped", "code failed", "traceback"
SINGULAR = "too close to singular"  # of slender bodies and extreme moduli, said by name: exit code 3


@dataclass(frozen=True)
class Answer:
    """Of one run; T load steps.

    Parameters
    ----------
    outcome : one of the words above
    said : why it was refused, stopped or broke
    bound : guaranteed relative error in the energy norm, nan where there is none
    parts : per name of a part (T, n, 3) displacements of its nodes, in the order of its own mesh
    reactions, moments : (entries of boundary, T, 3); moments about the origin
    energy : (T,)
    places : per name of a part (n, 3), where its nodes are
    probes : per name of a probe and kind of vector (T, 3)
    solution : what was solved; None unless it converged
    seconds : wall time
    """

    outcome: str
    said: str = ""
    bound: float = float("nan")
    parts: dict[str, np.ndarray] = field(default_factory=dict)
    reactions: np.ndarray | None = None
    moments: np.ndarray | None = None
    energy: np.ndarray | None = None
    places: dict[str, np.ndarray] = field(default_factory=dict)
    probes: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    solution: Solution | None = None
    seconds: float = 0.0

    def seen(self, turn: np.ndarray, length: float, force: float, factor: float, names: Mapping[str, str]) -> Answer:
        """The same in other axes, units and names: x → length · turn x, forces → force · factor · turn f.

        Parameters
        ----------
        turn : (3, 3) orthogonal; its determinant is −1 for a mirror, in which moments go the other way round
        factor : of displacements and forces, not of places
        names : of parts, old → new
        """
        about = turn * np.linalg.det(turn)
        sizes = {"u": length * turn, "f": force * turn, "m": force * length * about}
        return replace(
            self, parts={names.get(k, k): length * factor * u @ turn.T for k, u in self.parts.items()},
            places={names.get(k, k): length * x @ turn.T for k, x in self.places.items()},
            probes={(k, kind): factor * x @ sizes[kind].T for (k, kind), x in self.probes.items()},
            reactions=force * factor * self.reactions @ turn.T, moments=force * length * factor * self.moments @ about.T,
            energy=force * length * factor**2 * self.energy)


def answer(data: Mapping[str, Any]) -> Answer:
    """Solves a scene, by the file that holds it, and says how that went."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="trial-") as folder:
        path = Path(folder) / "scene.yaml"
        write(data, path)
        try:
            solution = _solved(path, data)
        except InputError as error:
            found = Answer(REFUSED, "; ".join(p.found for p in error.problems))
        except BlackBoxError as error:
            found = Answer(SINGULAR if "too close to singular" in str(error) else CODE_FAILED, str(error))
        except Exception as error:  # noqa: BLE001 - what nobody has foreseen is a finding
            import traceback

            found = Answer(BROKEN, f"{type(error).__name__}: {error}\n{''.join(traceback.format_tb(error.__traceback__)[-3:])}")
        else:
            found = _answered(solution) if solution.converged else Answer(STOPPED, solution.stop_reason)
    return replace(found, seconds=time.perf_counter() - begin)


def write(data: Mapping[str, Any], path: Path, comment: str = "") -> None:
    """Writes a scene as YAML, and its files beside it."""
    yaml = YAML()
    yaml.default_flow_style, yaml.width = None, 120
    with open(path, "w", encoding="utf-8") as file:
        file.writelines(f"# {line}\n" for line in comment.splitlines())
        yaml.dump({k: v for k, v in data.items() if k not in BESIDE}, file)
    for name, text in data.get("files", {}).items():
        (path.parent / name).write_text(text, encoding="utf-8")


def _solved(path: Path, data: Mapping[str, Any]) -> Solution:
    if "ranks" in data:
        return _by_ranks(path, data["ranks"])
    return _stopped_once(path, data["sittings"]) if "sittings" in data else solve(load_config(path).config)


def _stopped_once(path: Path, iterations: int) -> Solution:
    """The solution of a run that was stopped after some iterations, if it takes as many, and resumed, read from its folder, on the scene
    built here."""
    folder, quiet = path.parent / "results", ["output.figures=false"]
    loaded = load_config(path, quiet)
    if run(load_config(path, [*quiet, f"method.max_iterations={iterations}"]), output=folder, quiet=True):
        run(loaded, output=folder, resume=True, quiet=True)
    return replace(Solution.read(folder), scene=build_scene(loaded.config))


def _by_ranks(path: Path, ranks: int) -> Solution:
    """The solution of a run under mpiexec, read from its folder, on the scene built here."""
    folder = path.parent / "results"
    # run as root, and with more ranks than cores, where that is so
    allowed = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_rmaps_base_oversubscribe": "1"}
    done = subprocess.run(["mpiexec", "-n", str(ranks), sys.executable, "-m", "orchestrator", "run", str(path), "--output", str(folder),
                           "--set", "output.figures=false", "--quiet"], capture_output=True, text=True, env=os.environ | allowed)
    if done.returncode == 2:
        raise InputError(Problem((), done.stderr[-600:], ""))
    if done.returncode not in (0, 1):
        raise RuntimeError(f"exit code {done.returncode}: {done.stderr[-1500:]}")
    return replace(Solution.read(folder), scene=build_scene(load_config(path).config))


def bodies(solution: Solution) -> list[tuple[int, str]]:
    """Index and name of the volumes that are no ground's and no tool's."""
    tools = {i.tool.name for i in solution.scene.interfaces if i.tool is not None}
    return [(number, name) for number, name in enumerate(solution.scene.mesh.volumes) if not name.startswith("ground of ") and name not in tools]


def _answered(solution: Solution) -> Answer:
    mesh = solution.scene.mesh
    nodes = {name: np.unique(mesh.cells[mesh.volume == number]) for number, name in bodies(solution)}
    parts = {name: _displacement(solution, number)[:, nodes[name]] for number, name in bodies(solution)}
    return Answer(
        CONVERGED, "; ".join(solution.summary["warnings"]), solution.error_bound,
        parts, solution.reactions,
        np.array(solution.summary["reaction_moments"]["moments"], float).reshape(solution.reactions.shape), solution.energy,
        {name: mesh.nodes[n] for name, n in nodes.items()}, vectors(solution.summary["probes"]), solution)


def _displacement(solution: Solution, number: int) -> np.ndarray:
    """(T, n, 3) of a volume on the nodes of the mesh: bodies that open may share nodes of it, at which ``displacement`` is their mean."""
    scene, sides = solution.scene, solution.fields.sides
    if sides is None:
        return solution.displacement
    total, count = np.zeros_like(solution.displacement), np.zeros(len(scene.mesh.nodes))
    for e in np.unique(scene.cell_subdomain[scene.mesh.volume == number]):
        nodes = scene.subdomains[e].nodes
        total[:, nodes] += sides[e]
        count[nodes] += 1
    return total / np.maximum(count, 1)[:, None]

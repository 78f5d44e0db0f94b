"""A configuration in, a solution, its files or its words out: all that these tests know."""

import io
import json
import os
import runpy
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from unittest.mock import patch

import gmsh
import meshio
import numpy as np
import orchestrator

ROOT = Path(__file__).parents[2]
BESIDE = Path(sys.executable).with_name("mpiexec")
MPIEXEC = str(BESIDE if BESIDE.exists() else shutil.which("mpiexec"))
# more ranks than cores, maybe as root: what Open MPI refuses unless told
ALLOWED = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
           "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
           "OMPI_MCA_rmaps_base_oversubscribe": "1", "PYTHONPATH": str(ROOT)}
CONFIGS = ROOT / "configs"
STEEL = {"young": 200e3, "poisson": 0.3}
HELD = [0, 0, 0]
OPEN, STICK, SLIP = 0, 1, 2  # statuses in fields.npz
# One worker, no figures: scenes are small, and three processes share two cores.
QUICK = {"blackbox": {"workers": 1}, "output": {"figures": False}}
Body = tuple[np.ndarray, np.ndarray]  # nodes (n, 3), tets (m, 4)
SIX = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]]


def stopped(problem: dict, reference: bool = False, **changes: object) -> orchestrator.Solution:
    """Return the solution of a problem, converged or not; ``changes`` replace its sections."""
    config = orchestrator.config_from({**QUICK, **problem, **changes})
    return orchestrator.solve(config, reference=reference)


def solved(problem: dict, reference: bool = False, **changes: object) -> orchestrator.Solution:
    """Return the solution of a problem that converges."""
    solution = stopped(problem, reference, **changes)
    assert solution.converged, (solution, solution.summary["advice"])
    return solution


def box(name: str, size: Sequence[float], cells: Sequence[int], at: Sequence[float] = (0, 0, 0),
        **more: object) -> dict:
    """Return an entry of ``parts``: a box of bricks with its lowest corner ``at`` a point."""
    mesh = {"box": {"size": list(size), "cells": list(cells)}}
    return {"name": name, "mesh": mesh, "move": {"translate": list(at)}, **more}


def on(axis: str, at: float) -> dict:
    """Return the place of a boundary entry: a plane."""
    return {"plane": axis, "at": at}


def rollers(*axes: str, at: float = 0.0) -> list[dict]:
    """Return boundary entries: planes of symmetry through a point of each axis."""
    return [{"on": on(a, at), "displacement": [0 if a == b else None for b in "xyz"]} for a in axes]


def bricks(size: Sequence[float], cells: Sequence[int], shape: Callable = np.asarray) -> Body:
    """Return a box of bricks, six tets to each, with its nodes where ``shape`` takes them."""
    counts = np.array(cells) + 1
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3)
    number = np.arange(len(index)).reshape(counts)
    ends = [[slice(end, count - 1 + end) for end in (0, 1)] for count in counts]
    corner = np.stack([number[places].ravel() for places in product(*ends)], axis=1)
    nodes, tets = shape(index * np.array(size) / cells), corner[:, SIX].reshape(-1, 4)
    flipped = np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]]) < 0
    tets[flipped, :2] = tets[flipped, 1::-1]
    return nodes, tets


def written(path: Path, **bodies: Body) -> dict:
    """Return the ``mesh`` of a gmsh file with one volume for each body; they share no nodes."""
    starts = np.cumsum([0, *(len(nodes) for nodes, _ in bodies.values())])
    group = np.repeat(np.arange(1, len(bodies) + 1), [len(tets) for _, tets in bodies.values()])
    nodes = [nodes for nodes, _ in bodies.values()]
    tets = [tets + start for (_, tets), start in zip(bodies.values(), starts)]
    mesh = meshio.Mesh(np.concatenate(nodes), [("tetra", np.concatenate(tets))],
                       cell_data={"gmsh:physical": [group], "gmsh:geometrical": [group]},
                       field_data={name: np.array([k, 3]) for k, name in enumerate(bodies, 1)})
    meshio.write(path, mesh, "gmsh22", binary=False)
    return {"file": str(path)}


@dataclass(frozen=True)
class Done:
    """What a command has ended with: exit code, standard output and error."""

    code: int
    out: str
    err: str


def call(*words: object) -> Done:
    """Run ``python -m orchestrator`` with these words in this process."""
    size = {"COLUMNS": "80", "TERM": "dumb"}
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        with (redirect_stdout(out), redirect_stderr(err), patch.dict(os.environ, size),
              patch.object(sys, "argv", ["orchestrator", *map(str, words)])):
            try:
                runpy.run_module("orchestrator", run_name="__main__")
            except SystemExit as ended:
                code = int(ended.code or 0)
        told = []
        for stream in (out, err):
            stream.seek(0, io.SEEK_SET)
            told.append(stream.read())
    return Done(code, *told)


def run(path: Path, out: Path, *changes: str, code: int = 0, flags: Sequence[str] = ()) -> dict:
    """Return the summary of a YAML file that is run, with ``--set`` for each change."""
    settings = [word for change in [*changes, "output.figures=false"] for word in ("--set", change)]
    done = call("run", path, "--output", out, "--quiet", *flags, *settings)
    assert done.code == code, (done.code, done.out, done.err)
    return json.loads((out / "summary.json").read_text())


def groove(folder: Path, bore: float = 0.0) -> list[dict]:
    """Parts of a quarter of a shaft with a groove, in its hub: a torus between two cylinders, each a CAD face.

    bore : radius of a hole through the shaft; 0: none
    """
    quarter = {"angle": np.pi / 2}
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    solid = gmsh.model.occ
    for name in ("shaft", "hub"):
        gmsh.model.add(name)
        inner = solid.cut([(3, solid.addCylinder(0, 0, 0, 0, 0, 14, 12, **quarter))],
                          [(3, solid.addTorus(0, 0, 7, 14, 5))])[0]
        if name == "shaft" and bore:
            solid.cut(inner, [(3, solid.addCylinder(0, 0, 0, 0, 0, 14, bore))])
        if name == "hub":
            solid.cut([(3, solid.addCylinder(0, 0, 0, 0, 0, 14, 20, **quarter))], inner)
        solid.synchronize()
        gmsh.write(str(folder / f"{name}.step"))
    gmsh.finalize()
    return [{"name": name, "mesh": {"step": str(folder / f"{name}.step"), "h": h}}
            for name, h in (("shaft", 7), ("hub", 8))]

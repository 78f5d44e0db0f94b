"""Small problems for the whole chain: configurations, meshes with parts, and solutions, in process unless told otherwise."""

from contextlib import contextmanager
from pathlib import Path

import meshio
import numpy as np
from in_process import IN_PROCESS

from orchestrator.blackbox.models import extended_model
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config.model import Config
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.setup import RankPart, make_soles_of, prepare
from orchestrator.results.solution import Solution
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch

CLAMP = {"on": {"plane": "x", "at": 0.0}, "displacement": [0.0, 0.0, 0.0]}
PULL = {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 1.0, 0.0]}

SLICES = {"slices": {"axis": "x", "count": 4}}
CUBES = {"mesh": {"box": {"size": [4.0, 2.0, 2.0], "cells": [8, 4, 4]}}, "subdomains": {"grid": [4, 2, 2]}}
METIS = {"mesh": {"box": {"size": [4.0, 2.0, 2.0], "cells": [8, 4, 4]}}, "subdomains": {"metis": 7}}


def config(**changes) -> Config:
    """A bar of 4 × 1 × 1 held at x = 0, pulled and sheared at x = 4, in four slices of 96 tets."""
    data = {"name": "bar", "mesh": {"box": {"size": [4.0, 1.0, 1.0], "cells": [8, 2, 2]}}, "subdomains": SLICES,
            "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": [CLAMP, PULL], "blackbox": IN_PROCESS}
    return Config.model_validate({**data, **changes})


def method(sole=None, **changes) -> dict:
    """The ``method`` section with some entries changed."""
    return {"method": {"sole": sole or {}, **changes}}


def solved(reference=True, **changes) -> Solution:
    """The solution of a changed bar, by default with the undecomposed one beside it."""
    made = config(**changes)
    return solve(made, build_scene(made), reference=reference)


def prepared(made: Config, scene: Scene, blackbox) -> Decomposition:
    """A scene in the black box, ready to iterate."""
    part = RankPart.of(scene, made.method)
    return prepare(part, make_soles_of(part, made.method), made.method, blackbox, Stopwatch())


@contextmanager
def naked_beside(made: Config):
    """A configuration's scene, its black box, ready to iterate, and the stiffness (3n, 3n) of every subdomain without soles."""
    scene = build_scene(made)
    with box_of(made) as blackbox:
        yield scene, blackbox, prepared(made, scene, blackbox), blackbox.stiffness(
            [extended_model(scene, s, [], []) for s in scene.subdomains])


def decomposed(made: Config) -> Decomposition:
    """A configuration, ready to iterate, its black box closed."""
    with box_of(made) as blackbox:
        return prepared(made, build_scene(made), blackbox)


def close(one, two, tolerance=1e-9) -> bool:
    """Whether arrays are alike, to a share of the largest number."""
    one, two = np.asarray(one), np.asarray(two)
    return np.abs(one - two).max() <= tolerance * np.abs(two).max()


def box_of(made: Config):
    """The black box of a configuration."""
    return make_blackbox(made.blackbox)


def saved(mesh: Mesh, path: Path) -> dict:
    """Writes a mesh, one reference number per volume from 1, and returns the ``mesh`` section that reads it."""
    meshio.Mesh(mesh.nodes, [("tetra", mesh.cells)], cell_data={"medit:ref": [mesh.volume + 1]}).write(path)
    return {"file": str(path)}


def layered(path: Path, labels, size=(4.0, 1.0, 1.0), cells=(8, 2, 2)) -> dict:
    """A mesh file of a box whose cells along x belong to the volumes of ``labels``, repeated evenly."""
    mesh = bricks(np.array(size), np.array(cells), "box")
    centre = mesh.nodes[mesh.cells].mean(axis=1)[:, 0]
    mesh.volume = np.asarray(labels)[np.minimum((centre / size[0] * len(labels)).astype(int), len(labels) - 1)]
    return saved(mesh, path)


def irregular(path: Path, size=(4.0, 2.0, 2.0), cells=(8, 4, 4), seed=3) -> dict:
    """A mesh file of a box with displaced inner nodes."""
    mesh = bricks(np.array(size), np.array(cells), "box")
    step = np.array(size) / cells
    inner = np.all((mesh.nodes > 1e-9) & (mesh.nodes < np.array(size) - 1e-9), axis=1)
    mesh.nodes[inner] += np.random.default_rng(seed).uniform(-0.15, 0.15, (int(inner.sum()), 3)) * step
    return saved(mesh, path)

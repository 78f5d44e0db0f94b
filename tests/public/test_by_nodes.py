"""Bonded cubes by nodes: iterations that see neither contrast nor cuts, and the same answer however."""

import json
import os
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import orchestrator
import pytest
from helpers import ALLOWED, HELD, MPIEXEC, QUICK, STEEL, box, bricks, on, solved

SIDE, CELLS = 3, 12  # subdomains of a cube along each side, and bricks
SECONDS = 300


def cube(path: Path, contrast: float = 1000.0, unit: float = 1.0, force: float = 1.0,
         soft: tuple = (), **more) -> dict:
    """A cube whose bricks are soft or stiff at random, clamped at one end, bent at the other. Along
    an edge of it two stiff ones, of two subdomains, are an island in soft ones. Or one brick
    and that at the lowest corner alone are ``soft``."""
    nodes, tets = bricks([SIDE * unit] * 3, [CELLS] * 3)
    names = ["soft", "stiff"] if contrast > 1 else ["stiff"]
    stiff = np.random.default_rng(0).integers(0, len(names), [CELLS] * 3)
    border = CELLS // SIDE
    stiff[-2:, border - 2 : border + 2, -2:] = 0
    stiff[-1, border - 1 : border + 1, -1] = len(names) - 1
    if soft:
        stiff[:], stiff[soft], stiff[0, 0, 0] = 1, 0, 0
    group = stiff.ravel().repeat(6) + 1
    mesh = meshio.Mesh(nodes, [("tetra", tets)],
                       field_data={name: [k, 3] for k, name in enumerate(names, 1)},
                       cell_data={"gmsh:physical": [group], "gmsh:geometrical": [group]})
    meshio.write(path, mesh, "gmsh22", binary=False)
    young = 200e3 * force / unit**2
    return {"name": "cube", "mesh": {"file": str(path)}, "subdomains": {"grid": [SIDE] * 3},
            "materials": [{"young": young if name == "stiff" else young / contrast, "poisson": 0.3,
                           "on": name} for name in names],
            "boundary": [{"on": on("x", 0), "displacement": HELD},
                         {"on": on("x", SIDE * unit),
                          "traction": [10 * force / unit**2, 0, 10 * force / unit**2]}], **more}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The cube, solved by default, with its solution in one piece."""
    return solved(cube(tmp_path_factory.mktemp("cube") / "cube.msh"), reference=True)


def told(solution: orchestrator.Solution) -> None:
    """Assert that the bound is one, and not far from the true error."""
    summary = solution.summary
    assert summary["error_kind"] == "guaranteed"
    assert summary["true_error"] <= summary["error_bound"] <= 1e-6
    assert summary["error_bound"] <= 5 * summary["true_error"]


@pytest.fixture(scope="module")
def even(tmp_path_factory):
    """The same cube of one matter."""
    return solved(cube(tmp_path_factory.mktemp("even") / "cube.msh", contrast=1), reference=True)


def test_contrast_costs_little(plain, even):
    """Moduli 1:1000 at random: at most 22 iterations, as many as of one matter but for a few."""
    told(plain)
    told(even)
    assert even.iterations <= plain.iterations <= min(22, even.iterations + 6)


def test_a_soft_brick_amid_stiff_ones_is_no_island(even, tmp_path):
    """It is the last piece of the mesh, and has no node of its own."""
    amid = solved(cube(tmp_path / "amid.msh", soft=(-2, -2, -2)), reference=True)
    told(amid)
    assert amid.iterations <= even.iterations + 2


def test_irregular_cuts_cost_little(even, tmp_path):
    """METIS's parts of the same cube take no more than half as many iterations again."""
    problem = cube(tmp_path / "cut.msh", contrast=1) | {"subdomains": {"metis": SIDE**3}}
    cut = solved(problem, reference=True)
    told(cut)
    assert cut.iterations <= 1.5 * even.iterations


@pytest.mark.parametrize("method", [{"sole": {"kind": "symmetric"}}, {"sole": {"kind": "layer"}},
                                    {"macro": {"strategy": "none"}}],
                         ids=["symmetric", "layer", "no macro problem"])
def test_other_soles_find_the_same(method, plain, tmp_path):
    """The paper's soles are there as before; what they find differs by the errors told."""
    other = solved(cube(tmp_path / "other.msh"), method=method)
    apart = np.abs(other.displacement - plain.displacement).max()
    assert apart <= 1e-5 * np.abs(plain.displacement).max()
    assert other.iterations > plain.iterations


@pytest.mark.parametrize("unit, force", [(1e-3, 1.0), (25.4, 4.45)], ids=["m", "other"])
def test_other_units(unit, force, plain, tmp_path):
    """Lengths and forces scale; iterations stay."""
    found = solved(cube(tmp_path / "cube.msh", unit=unit, force=force))
    apart = np.abs(found.displacement / unit - plain.displacement).max()
    assert apart <= 1e-8 * np.abs(plain.displacement).max()
    assert found.iterations == plain.iterations


def test_a_body_that_is_not_cut():
    """A subdomain that meets no other has no sole, and is solved beside the others."""
    parts = [box("whole", [1, 1, 1], [2, 2, 2]), box("cut", [4, 2, 2], [8, 4, 4], [5, 0, 0])]
    found = solved({
        "name": "apart", "parts": parts, "subdomains": {"groups": True, "split_above": 300},
        "materials": [STEEL],
        "boundary": [{"on": "whole/zmin", "displacement": HELD},
                     {"on": "cut/xmin", "displacement": [0, 0, 1e-3]},
                     {"on": "whole/zmax", "traction": [1, 0, 1]},
                     {"on": "cut/xmax", "traction": [[1, 0, 1], [0, 1, 0]]}]}, reference=True)
    told(found)
    assert found.summary["subdomains"] > 2


@pytest.mark.xdist_group("ranks")
def test_two_ranks_find_what_one_process_finds(plain, tmp_path):
    """The same iterations; displacements to what the tolerance leaves."""
    path = tmp_path / "cube.yaml"
    path.write_text(json.dumps({**QUICK, **cube(tmp_path / "cube.msh")}))
    done = subprocess.run([MPIEXEC, "-n", "2", sys.executable, "-m", "orchestrator", "run", path,
                           "--quiet", "--output", tmp_path / "two"], env={**os.environ, **ALLOWED}, timeout=SECONDS,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done
    two = orchestrator.Solution.read(tmp_path / "two")
    assert two.iterations == plain.iterations
    apart = np.abs(two.displacement - plain.displacement).max()
    assert apart <= 1e-8 * np.abs(plain.displacement).max()

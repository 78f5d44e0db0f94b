"""Work that is left out changes no result, through FreeFEM."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from blackbox_case import box, settings
from method_case import CLAMP, CUBES, PULL, method, solved

from orchestrator.blackbox.shared import SharedModels, representatives
from orchestrator.blackbox.protocol import Traits
from orchestrator.blackbox.start import make_blackbox
from orchestrator.method.iterated import load_cases

INVARIANT = Traits(translation_invariant=True)
ROOT = Path(__file__).parents[1]


# --- congruent models -------------------------------------------------------------------------------------


def test_models_are_congruent_up_to_a_translation_only():
    """Another place is the same model; another numbering, matter, clamping, trace, size or shape is not."""
    model = box()
    fixed, region = model.fixed.copy(), model.region.copy()
    fixed[-1] = True
    region[0] = 1 - region[0]
    bent = model.nodes.copy()
    bent[-1] += 1e-6
    others = [
        replace(model, name="there", nodes=model.nodes + [3.0, -40.0, 7.0]),
        replace(model, fixed=fixed), replace(model, region=region), replace(model, trace=model.trace[::-1]),
        replace(model, materials=model.materials * [1.001, 1.0]), replace(model, nodes=model.nodes * 2),
        replace(model, nodes=bent), replace(model, nodes=model.nodes * [1, 1, -1]),
        replace(model, cells=model.cells[::-1], region=model.region[::-1]),
        replace(model, materials=model.materials[::-1], region=1 - model.region)]  # other words for the same matter
    assert representatives([model, *others], lambda code: INVARIANT).tolist() == [0, 0, 2, 3, 4, 5, 6, 7, 8, 9, 0]
    metres = [replace(m, nodes=m.nodes / 1000) for m in [model, *others]]
    assert representatives(metres, lambda code: INVARIANT).tolist() == [0, 0, 2, 3, 4, 5, 6, 7, 8, 9, 0]


# --- repeated right-hand sides ----------------------------------------------------------------------------


def test_a_right_hand_side_is_solved_once():
    """Zero, twice in one request, in two congruent subdomains, or again in the next request: all answered alike."""
    model = box()
    f = np.random.default_rng(0).standard_normal((3, len(model.trace)))
    with make_blackbox(settings()) as pool:
        asked = []
        shared = SharedModels(pool, True, workers=1, steps=1)
        shared.load([model, replace(model, nodes=model.nodes + 1.0), box(seed=4)])
        expected = pool.traces({0: f, 1: f})
        shared.inner = SimpleNamespace(traces=lambda rows: asked.append(sum(map(len, rows.values()))) or pool.traces(rows))
        first = shared.traces({0: f[[0, 1, 0]], 1: np.vstack([f[1], 0 * f[1], f[2]]), 2: f[:1]})
        second = shared.traces({0: f[[2, 0]], 2: np.vstack([f[:1], f[1:2]])})
    assert np.array_equal(first[0], expected[0][[0, 1, 0]])
    assert np.array_equal(first[1], np.vstack([expected[0][1], 0 * f[1], expected[0][2]]))
    assert np.array_equal(second[0], expected[0][[2, 0]]) and np.array_equal(second[2], expected[1][:2])
    assert asked == [4, 1]  # of seven: one twice, one in the twin, one zero; of four those that are new


# --- load steps that follow from others -------------------------------------------------------------------

STEPS = {"boundary": [
    {"on": {"plane": "x", "at": 0.0}, "displacement": [0.0, 0.0, 0.001], "history": "settle"},
    {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 1.0, 0.0], "history": "pull"}],
    "loads": [{"body_force": [0.0, 0.0, -1.0], "history": "pull"}],
    "histories": {"settle": [1.0, 0.0, -2.0, 0.5, 0.0], "pull": [0.0, 0.5, 1.0, -3.0, 0.0]}}


def test_the_bound_of_a_superposition():
    """At a lax tolerance the true error of all steps, followed through the iterations, stays below the bound."""
    few = solved(**CUBES, **STEPS, **method(tolerance={"error": 1e-3}))
    assert load_cases(few.scene).left_out == 3
    error, bound = few.summary["true_error"], few.summary["error_bound"]
    assert error <= bound <= 1e-3 and bound <= 6 * error


# --- modules ----------------------------------------------------------------------------------------------


def loaded_modules(*commands: str) -> list[set[str]]:
    """Names of the modules that are there after each of some commands, one after the other in one process."""
    code = ("import runpy, sys\n"
            f"for command in {commands!r}:\n"
            "    sys.argv = ['orchestrator', *command.split()]\n"
            "    try:\n        runpy.run_module('orchestrator', run_name='__main__')\n"
            "    except SystemExit as left:\n        assert not left.code, left.code\n"
            "    print('\\nMODULES', *sys.modules, flush=True)")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [set(line.split()) for line in done.stdout.splitlines() if line.startswith("MODULES")]


@pytest.mark.long
def test_commands_load_only_what_they_need(tmp_path):
    """A structured mesh needs numpy and scipy alone; METIS comes with METIS. Without fields and figures nothing that draws or writes
    them is loaded, and no stress is computed; one process needs nothing of MPI, and what is bonded no compiler."""
    path, heavy = tmp_path / "bar.yaml", {"gmsh", "pyvista", "vtkmodules", "matplotlib", "meshio", "pymetis", "numba", "mpi4py"}
    path.write_text(json.dumps({
        "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
        "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [CLAMP, PULL], "output": {"directory": str(tmp_path / "out"), "fields": False, "figures": False}}))
    *checked, run, metis = loaded_modules(
        "check configs/traction_beam.yaml", "check configs/two_blocks.yaml", "check --syntax-only configs/polycrystal_100.yaml",
        f"run {path} --quiet", "check configs/metis_box.yaml")
    assert len(checked) == 3 and not heavy & checked[-1] and not heavy & run and metis & heavy == {"pymetis"}
    assert {"orchestrator.run", "orchestrator.method.coarse.kernels"} <= run and "orchestrator.parallel.mpi" not in run
    assert not (tmp_path / "out" / "fields").exists() and not (tmp_path / "out" / "figures").exists()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())

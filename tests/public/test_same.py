"""One answer: by ranks, in other units, with other numbers of nodes, and after a run was killed."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import orchestrator
import pytest
from helpers import ALLOWED, HELD, MPIEXEC, QUICK, STEEL, bricks, on, run, solved, written

SECONDS = 300  # for what hangs, on a slow machine too
CONTACT = {"interfaces": [{"law": "contact", "friction": 0.2}],
           "method": {"tolerance": {"law": 1e-7}}}
BOXES = {"name": "boxes", "mesh": {"box": {"size": [2, 2, 2], "cells": [4, 4, 4]}},
         "subdomains": {"grid": [2, 1, 2]}, "materials": [STEEL],
         "boundary": [{"on": "zmin", "displacement": HELD},
                      {"on": "zmax", "displacement": [[0, 0, -2e-3], [1e-3, 0, -2e-3]]}]}


def file_of(problem: dict, folder: Path) -> Path:
    """Return a YAML file of a problem."""
    path = folder / f"{problem['name']}.yaml"
    path.write_text(json.dumps({**QUICK, **problem}, indent=1))
    return path


def same(one, other, rel: float, order=None) -> None:
    """Assert that displacements, reactions, energies and statuses are those of another solution."""
    order = np.arange(one.displacement.shape[1]) if order is None else order
    for a, b in ((one.displacement, other.displacement[:, order]), (one.reactions, other.reactions),
                 (one.energy, other.energy)):
        assert np.abs(a - b).max() <= rel * np.abs(a).max()
    assert one.summary["status_counts"] == other.summary["status_counts"]


@pytest.fixture
def begin():
    """What starts a command; whatever a test that fails has started ends with it."""
    started = []

    def start(*words: object) -> subprocess.Popen:
        started.append(subprocess.Popen([*map(str, words)], env={**os.environ, **ALLOWED},
                                        text=True,
                                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE))
        return started[-1]

    yield start
    for process in started:
        if process.poll() is None:
            process.terminate()
            process.communicate(timeout=SECONDS)


@pytest.mark.xdist_group("ranks")
@pytest.mark.parametrize("law", [pytest.param({}, marks=pytest.mark.long), CONTACT],
                         ids=["bonded", "contact"])
def test_two_ranks_find_what_one_process_finds(law, tmp_path, begin):
    """Sums round otherwise: the same iterations, values to what the tolerance leaves."""
    path = file_of({**BOXES, **law}, tmp_path)
    run(path, tmp_path / "one")
    ranks = begin(MPIEXEC, "-n", 2, sys.executable, "-m", "orchestrator", "run", path, "--quiet",
                  "--output", tmp_path / "two")
    told = ranks.communicate(timeout=SECONDS)
    assert ranks.returncode == 0, told
    one, two = (orchestrator.Solution.read(tmp_path / name) for name in ("one", "two"))
    assert one.iterations == two.iterations
    same(one, two, 1e-8)


def test_a_killed_run_goes_on(tmp_path, begin):
    """SIGKILL amid the iterations; resumed, it ends where and when an undisturbed run ends."""
    slow = {"macro": {"strategy": "none"}, "acceleration": "none", "relaxation": 0.15,
            "tolerance": {"indicator": 1e-4}, "max_iterations": 5000}
    problem = {"name": "slow", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
               "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [STEEL],
               "boundary": [{"on": "xmin", "displacement": HELD},
                            {"on": "xmax", "traction": [9, 0, 5]}]}
    path = file_of({**problem, "method": slow}, tmp_path)
    whole = run(path, tmp_path / "whole")
    out = tmp_path / "killed"
    killed = begin(sys.executable, "-m", "orchestrator", "run", path, "--quiet", "--output", out)
    history, end = out / "history.csv", time.monotonic() + SECONDS
    while not history.is_file() or history.read_text().count("\n") < 20:
        assert killed.poll() is None and time.monotonic() < end, killed.communicate()
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.communicate(timeout=SECONDS)
    assert killed.returncode == -signal.SIGKILL and not (out / "summary.json").is_file()
    resumed = run(path, out, flags=["--resume"])
    assert resumed["iterations"] == whole["iterations"]
    one, two = (orchestrator.Solution.read(folder) for folder in (tmp_path / "whole", out))
    assert np.array_equal(two.history["iteration"], one.history["iteration"])
    same(one, two, 1e-10)


def irregular(x: np.ndarray) -> np.ndarray:
    """Nodes moved along the faces and inside, the faces themselves where they were."""
    return x + 0.05 * np.sin(3 * x[:, [1, 2, 0]]) * np.sin(np.pi * x) * (x[:, [2]] > 0)


def pressed(mesh: dict, unit: float = 1.0, force: float = 1.0, code: str = "freefem") -> dict:
    """Two boxes with unlike meshes, the upper one pressed and pushed; a unit of length, of
    force."""
    path = np.array([[0, 0, -1e-3], [5e-4, 2e-4, -1e-3]]) * unit
    return {"name": "pressed", "mesh": mesh, "subdomains": "groups",
            "interfaces": CONTACT["interfaces"],
            "materials": [{"young": 200e3 * force / unit**2, "poisson": 0.3}],
            "boundary": [{"on": on("z", 0), "displacement": HELD},
                         {"on": on("z", 2 * unit), "displacement": path.tolist()}],
            "blackbox": {"code": code, "workers": 1}, "method": {"tolerance": {"law": 1e-9}}}


def bodies() -> dict:
    """Two irregular boxes of side 1, one on the other."""
    low, high = bricks([1, 1, 1], (3, 3, 2), irregular), bricks([1, 1, 1], (3, 3, 2))
    return {"low": low, "high": (high[0] + [0, 0, 1], high[1])}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return solved(pressed(written(tmp_path_factory.mktemp("boxes") / "boxes.msh", **bodies())))


@pytest.mark.parametrize("unit, force", [(1e-3, 1.0), (25.4, 4.45)], ids=["m", "other"])
def test_other_units(unit, force, plain, tmp_path):
    """Lengths and forces scale, statuses stay."""
    mesh = {**written(tmp_path / "boxes.msh", **bodies()), "scale": unit}
    found = solved(pressed(mesh, unit, force))
    assert np.abs(found.displacement / unit - plain.displacement).max() <= 1e-6 * 1e-3
    assert np.abs(found.reactions / force - plain.reactions).max() <= 1e-6 * plain.reactions.max()
    assert found.summary["status_counts"] == plain.summary["status_counts"]


def test_other_numbers_of_nodes(plain, tmp_path):
    """Nodes and tets in any order."""
    rng, mixed, order, start = np.random.default_rng(5), {}, [], 0
    for name, (nodes, tets) in bodies().items():
        place = rng.permutation(len(nodes))
        moved = np.empty_like(nodes)
        moved[place] = nodes
        mixed[name] = moved, rng.permutation(place[tets])
        order.append(start + place)
        start += len(nodes)
    found = solved(pressed(written(tmp_path / "mixed.msh", **mixed)))
    same(plain, found, 1e-6, np.concatenate(order))


@pytest.mark.parametrize("code", ["calculix", "scikit-fem"])
@pytest.mark.long
def test_other_codes(code, plain, tmp_path):
    """What they compute with is theirs, what comes out is the same."""
    if code == "calculix" and shutil.which("ccx") is None:
        pytest.skip("no CalculiX here")
    found = solved(pressed(written(tmp_path / "boxes.msh", **bodies()), code=code))
    same(plain, found, 1e-6)

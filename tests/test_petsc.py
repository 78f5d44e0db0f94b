"""The macro problem over ranks by PETSc, the real one: the same as without, and as one process."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from petsc_case import SCENES
from processes import begin
from ranks_case import found
from test_mpi import ALLOWED, SECONDS

from orchestrator.parallel import petsc

pytestmark = pytest.mark.xdist_group("ranks")
HERE = Path(__file__).parent
MADE = HERE.parent / ".venv-cluster/bin/python"  # what ./setup.sh cluster makes
PYTHON = os.environ.get("PETSC_PYTHON", str(MADE) if MADE.exists() else sys.executable)


def environment() -> dict[str, str]:
    return {**os.environ, **ALLOWED, "PYTHONPATH": os.pathsep.join([str(HERE.parent), str(HERE)]), "OPENBLAS_NUM_THREADS": "1"}


@cache
def without() -> str:
    """Why there is no PETSc for the Python that would be taken."""
    program = "from orchestrator.parallel.petsc import lacking; print(lacking())"
    return subprocess.run([PYTHON, "-c", program], env=environment(), capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.long
@pytest.mark.parametrize("ranks", [2, 4])
def test_either_engine_finds_what_one_process_finds(ranks, tmp_path):
    if without():
        pytest.skip(without())
    command = ("/usr/bin/mpiexec", "-n", str(ranks), PYTHON, str(HERE / "petsc_case.py"), str(tmp_path))
    run = begin(*command, env=environment(), stdin=subprocess.DEVNULL)
    _, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == 0, errors
    for rank in range(ranks):
        there = np.load(tmp_path / f"rank-{rank}.npz")
        for spread, common in (("spread", "common"), ("sparse, spread", "common"), ("sparse, common", "common")):
            assert np.abs(there[spread] - there[common]).max() <= 1e-12 * np.abs(there[common]).max()
        assert there["singular, common"] == there["singular, spread"] == "a pivot vanishes"
    for scene in SCENES:
        alone = found(scene)
        for engine in ("common", "spread"):
            together = np.load(tmp_path / f"{scene}-{engine}.npz")
            assert together["iterations"] == alone["iterations"]
            for name in ("displacement", "reactions", "energy", "carried", "stresses"):
                off = np.abs(together[name] - alone[name]).max()
                assert off <= 1e-10 * np.abs(alone[name]).max(), (scene, engine, name, off)


def test_what_is_lacking_is_told(monkeypatch, tmp_path):
    """Nothing installed, a binding for another Python, and one that was made for another numpy."""
    monkeypatch.delenv("PETSC_DIR", raising=False)
    monkeypatch.setattr(petsc, "absent", lambda name: not any((Path(path) / name).is_dir() for path in sys.path))
    monkeypatch.setattr(sys, "path", [])
    assert "petsc4py is not installed" in petsc.lacking(str(tmp_path))
    assert "./setup.sh cluster" in petsc.lacking(str(tmp_path))
    binding = tmp_path / "petsc3.18/x86_64-linux-gnu-real/lib/python3/dist-packages/petsc4py"
    (binding / "lib").mkdir(parents=True)
    assert "is not for Python" in petsc.lacking(str(tmp_path))
    (binding / f"lib/PETSc.{sys.implementation.cache_tag}-x86_64-linux-gnu.so").touch()
    (binding / "__init__.py").write_text('__version__ = "3.18.5"')
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    del sys.modules["petsc4py"]
    monkeypatch.setattr(petsc.np, "__version__", "2.4.6")
    assert "petsc4py 3.18.5 goes with numpy below 2, and numpy 2.4.6 is here" in petsc.lacking(str(tmp_path))
    monkeypatch.setattr(petsc.np, "__version__", "1.26.4")
    assert petsc.lacking(str(tmp_path)) == "" and sys.path == [str(binding.parent)]

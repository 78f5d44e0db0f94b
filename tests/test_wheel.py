"""What a wheel holds: installed outside the clone, it solves as the clone does."""

import json
import os
import shutil
import site
import subprocess
import sys
import venv
from pathlib import Path

import pytest

pytestmark = pytest.mark.xdist_group("wheel")  # it is built and installed once
ROOT = Path(__file__).parents[1]
CONFIGS = ROOT / "configs"


def call(*command, cwd) -> subprocess.CompletedProcess:
    """A command that may not know of the clone."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run([*map(str, command)], cwd=cwd, env=environment, capture_output=True, text=True)


def pip(*arguments, cwd) -> None:
    done = call(sys.executable, "-m", "pip", "--quiet", "--no-input", "--disable-pip-version-check", *arguments, cwd=cwd)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The programs of an environment in which the project is nothing but its wheel."""
    there = tmp_path_factory.mktemp("installed")
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", there, ROOT, cwd=there)
    venv.create(there / "venv", symlinks=True)
    programs = there / "venv" / "bin"
    pip("--python", programs / "python", "install", "--no-deps", "--no-index", *there.glob("*.whl"), cwd=there)
    # What the project depends on is here already: its folders are added, but not the .pth files in them, so that
    # the clone stays out of sight.
    packages = next((there / "venv").glob("lib/python*/site-packages"))
    (packages / "dependencies.pth").write_text("\n".join(site.getsitepackages()))
    return programs


@pytest.fixture
def folder(installed, tmp_path) -> Path:
    """A folder far from the clone, where the package is that of the wheel."""
    done = call(installed / "python", "-c", "import orchestrator; print(orchestrator.__file__)", cwd=tmp_path)
    assert Path(done.stdout.strip()).is_relative_to(installed.parent)
    return tmp_path


@pytest.mark.long
def test_a_beam_is_pulled(installed, folder):
    """The first shipped configuration, with fields and figures; coarser, so that the stress is still exact."""
    shutil.copy(CONFIGS / "traction_beam.yaml", folder)
    done = call(installed / "orchestrator", "run", "traction_beam.yaml", "--set", "mesh.beam.h=5", cwd=folder)
    assert done.returncode == 0, done.stderr
    results = folder / "results" / "traction_beam"
    summary = json.loads((results / "summary.json").read_text())
    assert summary["converged"] and summary["error_bound"] <= 1e-6
    assert [force[0] for force in summary["reactions"][0]] == [pytest.approx(-1000, rel=1e-5)]
    assert {"convergence.png", "deformed.png", "time.png"} <= {path.name for path in (results / "figures").iterdir()}


@pytest.mark.long
def test_doctor_sees_the_scripts(installed, folder):
    """And misses them when they are not there; then no run starts either."""
    healthy = call(installed / "orchestrator", "doctor", cwd=folder)
    assert healthy.returncode == 0 and "missing" not in healthy.stdout
    scripts = [Path(line.split()[1]) for line in healthy.stdout.splitlines() if line.startswith("script: ")]
    assert [path.name for path in scripts] == ["subdomain_server.edp", "undecomposed.edp"]
    assert all(path.is_relative_to(installed.parent) for path in scripts)
    hidden = scripts[0].rename(scripts[0].with_suffix(".hidden"))
    try:
        ill = call(installed / "orchestrator", "doctor", cwd=folder)
        refused = call(installed / "orchestrator", "run", CONFIGS / "traction_beam.yaml", "--output", folder, cwd=folder)
    finally:
        hidden.rename(scripts[0])
    assert ill.returncode == 2 and f"missing script {scripts[0]}" in ill.stdout
    assert refused.returncode == 2 and f"no file {scripts[0]}" in refused.stderr


@pytest.mark.long
def test_nothing_is_left_when_it_goes(installed, folder, monkeypatch):
    """Loops compiled for it are in the user's cache directory, so that pip takes away all that is beside the package. The last test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    packages = next((installed.parent / "lib").glob("python*/site-packages"))
    before = {path.name for path in packages.iterdir()}
    done = call(installed / "orchestrator", "doctor", cwd=folder)
    assert done.returncode == 0 and f"kept in {folder / 'cache' / 'latin-orchestrator'}" in done.stdout, done.stdout + done.stderr
    decorated = sum(path.read_text().count("\n@compiled\n") for path in (ROOT / "orchestrator").rglob("*.py"))
    starting = 1  # compiled._nothing, which a run has while it meshes
    assert len(list((folder / "cache").rglob("*.nbc"))) == decorated - starting > 5
    pip("--python", installed / "python", "uninstall", "--yes", "latin-orchestrator", cwd=folder)
    assert {path.name for path in packages.iterdir()} == before - {"orchestrator", *(name for name in before if "latin" in name)}
    assert not (installed / "orchestrator").exists()

"""What is shipped beside the package says the same as the package: recipe, images, workflows, tested versions."""

import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# Packages that conda-forge calls otherwise.
CONDA = {"gmsh": "python-gmsh", "matplotlib": "matplotlib-base", "vtk": "vtk-base"}


def ranges(entries: list[str]) -> dict[str, str]:
    return {name: span for name, span in (re.match(r"([\w.-]+)\s*(.*)", entry).groups() for entry in entries)}


def test_the_recipe_has_the_ranges_of_the_package():
    """All that a run on one machine needs; ranks take conda's own MPI."""
    recipe = YAML(typ="safe").load((ROOT / "packaging/conda/recipe.yaml").read_text())
    extras = PROJECT["optional-dependencies"]
    wanted = ranges([*PROJECT["dependencies"], *extras["mesh"], *extras["figures"], *extras["fast"]])
    found = ranges(recipe["requirements"]["run"])
    assert {CONDA.get(name, name): span for name, span in wanted.items()}.items() <= found.items()
    assert found["python"] == PROJECT["requires-python"] and found["freefem"] == ">=4.11"
    assert recipe["build"]["python"]["entry_points"] == [f"{name} = {place}" for name, place in PROJECT["scripts"].items()]
    version = re.search(r'__version__ = "(.+)"', (ROOT / "orchestrator/__init__.py").read_text())[1]
    assert recipe["context"]["version"] == version


def test_every_package_has_a_tested_version_within_its_range():
    pinned = {}
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            name, _, version = line.partition(" ")[0].partition("==")
            pinned[name.lower().replace("_", "-").replace(".", "-")] = tuple(int(n) for n in re.findall(r"\d+", version))
    entries = [*PROJECT["dependencies"], *(entry for extra in PROJECT["optional-dependencies"].values() for entry in extra)]
    for name, span in ranges([entry for entry in entries if not entry.startswith("latin-orchestrator")]).items():
        version = pinned[name.lower().replace(".", "-")]
        for sign, bound in re.findall(r"(>=|<)([\d.]+)", span):
            limit = tuple(int(n) for n in bound.split("."))
            assert version >= limit if sign == ">=" else version < limit, (name, version, span)


@pytest.mark.parametrize("script", ["setup.sh", ".ci/run", ".ci/versions"])
def test_scripts_can_be_read(script):
    assert subprocess.run(["bash", "-n", str(ROOT / script)]).returncode == 0


def test_both_images_take_the_same_steps(tmp_path):
    """Of all that a clone has, the same files, and the same commands; machine code of Apptainer's is each user's own."""
    docker, apptainer = ((ROOT / "packaging" / name).read_text() for name in ("Dockerfile", "apptainer.def"))
    assert re.search("^FROM (.+)", docker, re.MULTILINE)[1] == re.search("^From: (.+)", apptainer, re.MULTILINE)[1]
    steps = re.search(r"^RUN ((?:.+\\\n)*.+)", docker, re.MULTILINE)[1].split("&&")
    wanted = [step.strip(" \\\n") for step in steps if "chmod" not in step]
    given = [line.strip() for line in re.search(r"%post\n((?: .+\n)+)", apptainer)[1].splitlines()]
    assert [line for line in given if not line.startswith(("export ", "cd "))] == wanted
    clone, image = tmp_path / "clone", tmp_path / "image"
    for name in ("Makefile", "orchestrator/results/a.py", "orchestrator/__pycache__/a.pyc", "results/a", ".venv/a", ".git/a", "site/a"):
        (clone / name).parent.mkdir(parents=True, exist_ok=True)
        (clone / name).touch()
    (clone / ".dockerignore").write_text((ROOT / ".dockerignore").read_text())
    setup = re.search(r"%setup\n((?: .+\n)+)", apptainer)[1]
    subprocess.run(["sh", "-cex", setup], cwd=clone, env={**os.environ, "APPTAINER_ROOTFS": str(image)}, check=True)
    found = {str(path.relative_to(image / "opt/latin-orchestrator")) for path in image.rglob("*") if path.is_file()}
    assert found == {"Makefile", "orchestrator/results/a.py"}


def test_workflows_and_images_call_what_there_is():
    jobs = YAML(typ="safe").load((ROOT / ".github/workflows/tests.yml").read_text())["jobs"]
    told = "\n".join(step["run"] for job in jobs.values() for step in job["steps"] if "run" in step)
    told += "\n" + (ROOT / "packaging/Dockerfile").read_text() + (ROOT / "packaging/apptainer.def").read_text()
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert {"setup", "test-all", "docs"} <= set(re.findall(r"(?:^|&& )make ([a-z-]+)", told, flags=re.MULTILINE)) <= set(targets)
    assert all((ROOT / path).is_file() for path in re.findall(r"(?:configs|packaging|\.ci)/[\w./]+", told))
    machines = set(re.search(r"machines=\((.+)\)", (ROOT / ".ci/run").read_text())[1].split())
    assert set(jobs["tests"]["strategy"]["matrix"]["machine"]) <= machines

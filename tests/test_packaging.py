"""What is shipped beside the package says the same as the package: recipe, images, workflows, tested versions."""

import re
import tomllib
from pathlib import Path

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

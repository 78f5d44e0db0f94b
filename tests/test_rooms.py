"""Data flows one way: no module imports itself by way of others, and no room one to its right."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

pytestmark = pytest.mark.xdist_group("rooms")  # one process parses all modules
PACKAGE = Path(__file__).parents[1] / "orchestrator"
MODULES = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
           for path in PACKAGE.rglob("*.py")}
ROOMS = ["config", "laws", "scene", "blackbox", "method", "results"]  # what is in none of them serves them, or runs them


def above(name: str) -> list[str]:
    """The packages that a module is in: they are imported before it."""
    parts = name.split(".")
    return [package for n in range(1, len(parts)) if (package := ".".join(parts[:n])) in MODULES]


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """All within one; what is in expressions, which hold no import, is left out."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.stmt, ast.ExceptHandler, ast.match_case)):
            yield child
            yield from statements(child)


def imported(name: str) -> Iterator[str]:
    """Modules of the package that one imports anywhere in it, for type checks too, and the packages that they are in."""
    for node in statements(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            named = [f"{node.module}.{alias.name}" for alias in node.names]
            found = [one if one in MODULES else node.module for one in named]
        else:
            found = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for one in found:
            yield from (*above(one), *([one] if one in MODULES else []))


@cache
def imports() -> dict[str, set[str]]:
    """What each module imports, and the packages that it is in: parsed when a test asks, not by all who collect tests."""
    return {name: {*imported(name), *above(name)} - {name} for name in MODULES}


def room(name: str) -> int | None:
    first = (name.split(".") + [""])[1]
    return ROOMS.index(first) if first in ROOMS else None


def test_no_import_circles():
    """Functions may import what imports them once all is there; at the head of modules and packages nobody can."""
    list(TopologicalSorter(imports()).static_order())  # raises CycleError


def test_no_arrows_up():
    up = [f"{name} imports {one}" for name, others in imports().items() for one in others
          if room(name) is not None and room(one) is not None and room(one) > room(name)]
    assert not up


def test_the_model_knows_no_room_but_its_own():
    """Laws, loads and codes bring their models when a configuration names them."""
    code = ("import sys, orchestrator.config.load; "
            "print(sorted({'.'.join(m.split('.')[:2]) for m in sys.modules if m.startswith(('numpy', 'orchestrator.'))}))")
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent)
    assert found.stdout.strip() == str(["orchestrator.config", "orchestrator.errors", "orchestrator.registry"])


def test_lines_fit_a_screen():
    folders = (PACKAGE.parent / name for name in ("orchestrator", "benchmarks", "tests", "configs", "meshes", "docs"))  # not what runs leave
    long = [f"{path}:{number}" for folder in folders for path in sorted(folder.rglob("*.py"))
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if len(line) > 150]
    assert not long

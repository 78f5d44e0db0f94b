"""Which faults the tests miss: operators of some modules are changed one by one, and the fitting tests run.

    python -m benchmarks.mutation orchestrator/laws/contact.py --tests tests/test_laws.py --most 60

A mutant that no test sees is printed with its line. Each runs in a process of its own, forked when libraries are loaded,
on a copy of the clone.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import os
import random
import shutil
import signal
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SWAPPED = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
           ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And}
NAMES = {"minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min", "any": "all", "all": "any", "True": "False"}
PATIENCE = 300  # seconds for the tests of one mutant; longer is seen too


def places(tree: ast.Module) -> list[tuple[int, str]]:
    """(number among all nodes, what is changed) of every mutant."""
    found = []
    silent = {id(part) for node in ast.walk(tree) for part in (
        [node.returns, *(a.annotation for a in [*node.args.args, *node.args.kwonlyargs])] if isinstance(node, ast.FunctionDef)
        else node.decorator_list if isinstance(node, ast.ClassDef)  # that objects are frozen changes no answer
        else [node.annotation] if isinstance(node, ast.AnnAssign) else []) if part is not None for part in ast.walk(part)}
    for number, node in enumerate(ast.walk(tree)):
        if id(node) in silent:
            continue
        if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
            found.append((number, "comparison"))
        elif isinstance(node, (ast.BinOp, ast.BoolOp, ast.AugAssign)) and type(node.op) in SWAPPED:
            found.append((number, "operator"))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
            found.append((number, "sign"))
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
            found.append((number, "constant"))
        elif isinstance(node, (ast.Attribute, ast.Name)) and getattr(node, "attr", getattr(node, "id", "")) in NAMES:
            found.append((number, "function"))
    return found


def mutant(tree: ast.Module, number: int) -> tuple[str, int]:
    """Its source, and the line that differs."""
    changed = copy.deepcopy(tree)
    node = list(ast.walk(changed))[number]
    if isinstance(node, ast.Compare):
        node.ops[0] = SWAPPED[type(node.ops[0])]()
    elif isinstance(node, (ast.BinOp, ast.BoolOp, ast.AugAssign)):
        node.op = SWAPPED[type(node.op)]()
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd() if isinstance(node.op, ast.USub) else ast.Not()
        if isinstance(node.op, ast.Not):
            node.operand = ast.UnaryOp(ast.Not(), node.operand)
    elif isinstance(node, ast.Constant):
        node.value = not node.value if isinstance(node.value, bool) else node.value + 1
    elif isinstance(node, ast.Attribute):
        node.attr = NAMES[node.attr]
    else:
        node.id = NAMES[node.id]
    return ast.unparse(ast.fix_missing_locations(changed)), node.lineno


def seen(copied: Path, module: str, source: str, tests: list[str]) -> bool:
    """Whether one of the tests fails with that source."""
    (copied / module).write_text(source, encoding="utf-8")
    child = os.fork()
    if child == 0:
        os.setsid()
        signal.alarm(PATIENCE)
        os.chdir(copied)
        sys.path[:0] = [str(copied), str(copied / "tests")]
        os.environ["PYTHONPATH"] = str(copied)
        with open(copied / "said.txt", "w") as said:
            os.dup2(said.fileno(), 1)
            os.dup2(said.fileno(), 2)
        import pytest

        os._exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-m", "not long", *tests])))
    _, status = os.waitpid(child, 0)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return status != 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="+")
    parser.add_argument("--tests", nargs="+", required=True)
    parser.add_argument("--most", type=int, default=10**6, help="mutants of each module, drawn at random")
    asked = parser.parse_args()
    sys.dont_write_bytecode = True
    import gmsh, meshio, numpy, pydantic, pytest, scipy.sparse.linalg, scipy.spatial, typer  # noqa: F401, E401 - once for all

    with tempfile.TemporaryDirectory() as folder:
        copied = Path(folder) / "clone"
        for part in ("orchestrator", "benchmarks", "tests", "configs", "meshes", "examples", "freefem_scripts", "docs"):
            shutil.copytree(ROOT / part, copied / part, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", copied)
        for module in asked.modules:
            original = (ROOT / module).read_text(encoding="utf-8")
            tree, lines = ast.parse(original), original.splitlines()
            if seen(copied, module, original, asked.tests):
                sys.exit("the tests fail without any mutant:\n" + (copied / "said.txt").read_text(encoding="utf-8"))
            chosen = places(tree)
            chosen = random.Random(1).sample(chosen, min(asked.most, len(chosen)))
            alive = 0
            for number, what in sorted(chosen):
                source, line = mutant(tree, number)
                if not seen(copied, module, source, asked.tests):
                    alive += 1
                    print(f"  {module}:{line}: {what}: {lines[line - 1].strip()}", flush=True)
            (copied / module).write_text(original, encoding="utf-8")
            print(f"{module}: {len(chosen) - alive} of {len(chosen)} seen", flush=True)


if __name__ == "__main__":
    main()

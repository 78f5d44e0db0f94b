"""Hold the package to a weight that only falls.

The weight of a room (a folder of the package; ``top``: the files beside them) is its code tokens, its
modules, its lines of more than 100 columns and its numbers: module constants that are some. Code tokens are the names, numbers and operators of
Python's tokenizer: neither docstrings nor the width of a line change them. ``budget.json`` has the
limits: lower one whenever the weight has fallen, never raise one.
"""

import ast
import io
import json
import re
import subprocess
import tokenize
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LIMITS = Path(__file__).with_name("budget.json")
COUNTED = {tokenize.NAME, tokenize.NUMBER, tokenize.OP}
COLUMNS = 100


def weights() -> dict[str, Counter]:
    """Return tokens, modules, wide lines and numbers of each room, and of ``all``."""
    found: dict[str, Counter] = {}
    package = ROOT / "orchestrator"
    for path in package.rglob("*.py"):
        text, inside = path.read_text(encoding="utf-8"), path.relative_to(package).parts
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        weight = Counter(tokens=sum(token.type in COUNTED for token in tokens), modules=1,
                         wide=sum(len(line) > COLUMNS for line in text.splitlines()), numbers=len(numbers(text)))
        for room in ("all", inside[0] if len(inside) > 1 else "top"):
            found.setdefault(room, Counter()).update(weight)
    return found


def limits(text: str) -> dict[tuple[str, str], int]:
    return {(room, unit): limit for room, units in json.loads(text).items()
            for unit, limit in units.items()}


def git(*words: str) -> str:
    """Return what git prints; skip where this is no clone, as in an unpacked archive."""
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no history here: git {words[0]} fails")
    return done.stdout


def trees() -> list[tuple[str, list[str], ast.Module]]:
    """Return name, lines and syntax tree of each module of the package."""
    texts = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
             for path in sorted((ROOT / "orchestrator").rglob("*.py"))}
    return [(name, text.splitlines(), ast.parse(text)) for name, text in texts.items()]


def is_number(node: ast.expr) -> bool:
    """Whether an expression is a number, or some; truth values are none."""
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    parts = {ast.UnaryOp: ("operand",), ast.BinOp: ("left", "right")}.get(type(node), ())
    inside = node.elts if isinstance(node, (ast.Tuple, ast.List)) else [getattr(node, part) for part in parts]
    return bool(inside) and all(map(is_number, inside))


def numbers(text: str) -> list[ast.Assign]:
    """Return the assignments of a module's constants that are numbers."""
    lines = text.splitlines()
    return [node for node in ast.parse(text).body
            if isinstance(node, ast.Assign) and is_number(node.value) and re.match(r"_?[A-Z]", lines[node.lineno - 1])]


def test_each_number_with_a_name_has_its_reason():
    """Module constants that are numbers: a comment beside them, or above."""
    bare = []
    for name, lines, _ in trees():
        for node in numbers("\n".join(lines)):
            above = lines[node.lineno - 2].lstrip() if node.lineno > 1 else ""
            if not above.startswith("#") and "#" not in "".join(lines[node.lineno - 1 : node.end_lineno]):
                bare.append(f"{name}:{node.lineno}")
    assert not bare


def test_no_docstring_is_a_riddle():
    """It begins with a verb, or the name of a thing: not with "What"."""
    riddles = [f"{name}: {text}" for name, _, tree in trees() for node in ast.walk(tree)
               if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
               and (text := (ast.get_docstring(node) or "").partition("\n")[0]).startswith("What ")]
    assert not riddles


def test_the_package_keeps_to_its_budget():
    found, allowed = weights(), limits(LIMITS.read_text(encoding="utf-8"))
    assert found.keys() == {room for room, _ in allowed}, "each room has limits, and each limit a room"
    over = [f"{room}: {found[room][unit]:,} {unit}, at most {limit:,}"
            for (room, unit), limit in allowed.items() if found[room][unit] > limit]
    assert not over


def test_limits_only_fall():
    """The working copy beside the last commit, and each version beside the one before it, back to a commit
    of its own that says why they had to rise: its subject begins with "Budget raised"."""
    name = LIMITS.relative_to(ROOT).as_posix()
    found = [line.split(" ", 1) for line in git("log", "--format=%H %s", "--", name).splitlines()]
    raised = [subject.startswith("Budget raised") for _, subject in found]
    revisions = [revision for revision, _ in found[: raised.index(True) + 1 if True in raised else None]]
    versions = [LIMITS.read_text(encoding="utf-8"),
                *(git("show", f"{revision}:{name}") for revision in revisions)]
    risen = []
    for later, earlier in zip(map(limits, versions), map(limits, versions[1:])):
        risen += [f"{room} {unit}: {earlier[room, unit]:,} to {later[room, unit]:,}"
                  for room, unit in later.keys() & earlier.keys()
                  if later[room, unit] > earlier[room, unit]]
    assert not risen

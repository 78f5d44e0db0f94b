"""Hold the package to a weight that only falls.

The weight of a room (a folder of the package; ``top``: the files beside them) is its code tokens, its
modules and its lines of more than 100 columns. Code tokens are the names, numbers and operators of
Python's tokenizer: neither docstrings nor the width of a line change them. ``budget.json`` has the
limits: lower one whenever the weight has fallen, never raise one.
"""

import io
import json
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
    """Return tokens, modules and wide lines of each room, and of ``all``."""
    found: dict[str, Counter] = {}
    package = ROOT / "orchestrator"
    for path in package.rglob("*.py"):
        text, inside = path.read_text(encoding="utf-8"), path.relative_to(package).parts
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        weight = Counter(tokens=sum(token.type in COUNTED for token in tokens), modules=1,
                         wide=sum(len(line) > COLUMNS for line in text.splitlines()))
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

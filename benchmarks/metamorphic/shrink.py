"""Make a scene that failed as small as it can be and still fail in the same way.

    python -m benchmarks.metamorphic.shrink scene.yaml smaller.yaml

The first line of the file says the relation and what it draws with, as the study leaves it: ``# cut otherwise 7000006001: …``.
"""

from __future__ import annotations

import copy
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.metamorphic.answers import write
from benchmarks.metamorphic.chunks import Trial
from benchmarks.metamorphic.kept import read
from benchmarks.metamorphic.pool import judged

LIMIT = 120.0  # seconds for one attempt
LISTS = ("boundary", "loads", "interfaces", "materials")


def failure(data: dict, relation: str, number: int) -> str:
    """What is wrong with a scene under a relation, in words that do not name numbers; empty where nothing is."""
    trial = Trial(divmod(number, 1000), data, [], [] if relation in ("itself", "in one piece") else [relation])
    found = next(judged(iter([trial]), 1, LIMIT))[1]
    if relation == "itself":
        kind = found["outcome"]
        said = found["said"]
    else:
        kind, said = found["tried"].get(relation, ""), found["details"].get(relation, "")
    if kind in ("", "agree", "refused", "not sayable", "another slave", "converged"):
        return ""
    if kind in ("traceback", "stopped"):
        kind += " " + re.sub(r"[-\d.]+(e[-+]\d+)?", "#", said.splitlines()[0])[:40]
    return kind


def smaller(data: dict) -> Iterator[dict]:
    """Scenes that are simpler in one respect, those that gain most first."""
    for part in data["parts"]:
        if len(data["parts"]) > 1:
            yield _without(data, part["name"])
    for key in LISTS:
        for at in range(len(data.get(key, []))):
            if key != "materials" or at:
                made = copy.deepcopy(data)
                del made[key][at]
                yield made if made[key] or key in ("boundary", "materials") else {k: v for k, v in made.items() if k != key}
    if "histories" in data:
        yield {k: _plain(v) for k, v in data.items() if k != "histories"}
        for at in range(len(data["histories"].get("h", [])) if len(data["histories"].get("h", [])) > 1 else 0):
            yield {**data, "histories": {"h": [x for i, x in enumerate(data["histories"]["h"]) if i != at]}}
    if data["subdomains"] != "groups":
        yield {**data, "subdomains": "groups"}
    if data.get("blackbox", {}).get("element"):
        yield {**data, "blackbox": {k: v for k, v in data["blackbox"].items() if k != "element"}}
    yield from _simpler_parts(data)
    yield from _simpler_entries(data)


def _simpler_parts(data: dict) -> Iterator[dict]:
    for at, part in enumerate(data["parts"]):
        if "material" in part:
            yield _with_part(data, at, {k: v for k, v in part.items() if k != "material"})
        cells = part["mesh"]["box"]["cells"]
        for axis in range(3):
            for fewer in sorted({1, cells[axis] // 2, cells[axis] - 1} - {0, cells[axis]}):
                made = copy.deepcopy(part)
                made["mesh"]["box"]["cells"][axis] = fewer
                yield _with_part(data, at, made)
        if "rotate" in part.get("move", {}) and "translate" not in part["move"]:
            yield _with_part(data, at, {k: v for k, v in part.items() if k != "move"})


def _simpler_entries(data: dict) -> Iterator[dict]:
    plain = {"young": 200e3, "poisson": 0.3}
    for key in LISTS:
        for at, entry in enumerate(data.get(key, [])):
            for name, value in entry.items():
                if name in ("history", "density", "expansion", "friction", "tolerance", "frame", "pairing", "tension_only", "gap"):
                    yield _with_entry(data, key, at, {k: v for k, v in entry.items() if k != name})
                elif name in plain and value != plain[name]:
                    yield _with_entry(data, key, at, {**entry, name: plain[name]})
                elif isinstance(value, list) and all(isinstance(x, (int, float)) for x in value):
                    for axis in range(len(value)):
                        if value[axis]:
                            yield _with_entry(data, key, at, {**entry, name: [0.0 if i == axis else x for i, x in enumerate(value)]})


def _plain(value: Any) -> Any:
    """Without histories."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items() if k != "history"}
    return [_plain(v) for v in value] if isinstance(value, list) else value


def _without(data: dict, name: str) -> dict:
    """The scene without a part and all that names it."""
    def about(entry: dict) -> bool:
        names = [entry.get("on", "")] if isinstance(entry.get("on"), str) else []
        names += [x for x in entry.get("between", []) if isinstance(x, str)] if isinstance(entry.get("between"), list) else []
        return any(n == name or n.startswith(name + "/") for n in names)

    made = {k: [e for e in v if not about(e)] if k in LISTS else v for k, v in data.items()}
    made["parts"] = [p for p in data["parts"] if p["name"] != name]
    return {k: v for k, v in made.items() if v or k in ("boundary", "materials")}


def _with_part(data: dict, at: int, part: dict) -> dict:
    return {**data, "parts": [part if i == at else p for i, p in enumerate(data["parts"])]}


def _with_entry(data: dict, key: str, at: int, entry: dict) -> dict:
    return {**data, key: [entry if i == at else e for i, e in enumerate(data[key])]}


def shrunk(data: dict, relation: str, number: int, tell=lambda text: None) -> tuple[dict, str]:
    """The smallest scene found, and what is wrong with it."""
    wanted = failure(data, relation, number)
    if not wanted:
        return data, ""
    progress = True
    while progress:
        progress = False
        for candidate in smaller(data):
            if failure(candidate, relation, number) == wanted:
                tell(f"{len(str(data))} → {len(str(candidate))}")
                data, progress = candidate, True
                break
    return data, wanted


def main() -> None:
    source, target = map(Path, sys.argv[1:3])
    data, relation, number = read(source)
    data, wrong = shrunk(data, relation, number, print)
    if not wrong:
        raise SystemExit("nothing is wrong with it")
    write(data, target, f"{relation} {number}: {wrong}")


if __name__ == "__main__":
    main()

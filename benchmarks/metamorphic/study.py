"""The study: thousands of random scenes, each under some relations; a row for each as it comes, a folder for each finding."""

from __future__ import annotations

import csv
import os
from collections import Counter
from itertools import combinations, count
from pathlib import Path
from typing import Any

from pydantic import Field

from benchmarks.metamorphic.answers import write
from benchmarks.metamorphic.chunks import Trial, chunk
from benchmarks.kit.settings import Keys
from benchmarks.metamorphic.pool import judged

COLUMNS = ("seed", "index", "outcome", "said", "seconds", "features", "relations", "details")
WRONG = {"disagree", "refused otherwise", "traceback", "code failed", "hang", "crash"}


class Settings(Keys):
    """How many, which and how."""

    scenes: int = Field(3000, ge=1, description="scenes that are solved, those refused not counted")
    seed: int = Field(1, ge=0, description="of the first; the others follow")
    workers: int = Field(2, ge=1, le=64, description="processes")
    relations: int = Field(3, ge=1, description="tried on each scene")
    limit: float = Field(300.0, gt=0, description="seconds for a scene with its relations; longer is a hang")


def run(study, settings: Settings = Settings()) -> None:
    """Draws, solves and compares; ends with tables of what was tried."""
    table = Path(study.folder) / "scenes.csv"  # a study begins without its table
    rows = read(table) if study.resume else []
    first = settings.seed * 1_000_000
    done = {(int(r["seed"]), int(r["index"])) for r in rows}
    with open(table, "a" if rows else "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if not rows:
            writer.writeheader()
        solved = sum(r["outcome"] != "refused" for r in rows)
        trials = (t for number in count(first) for t in chunk(number, settings.relations) if t.number not in done)
        for trial, verdict in judged(trials, settings.workers, settings.limit):
            row = _row(trial, verdict)
            writer.writerow(row)
            file.flush()
            rows.append({k: str(v) for k, v in row.items()})
            if wrong := keep(trial, verdict, Path(study.folder) / "findings"):
                study.console.print(f"  {trial.number}: {wrong}")
            solved += verdict["outcome"] != "refused"
            if solved >= settings.scenes:
                break
    tell(rows, study)


def _row(trial: Trial, verdict: dict[str, Any]) -> dict[str, Any]:
    told = "; ".join(f"{k}: {v}" for k, v in verdict["details"].items())
    return {"seed": trial.number[0], "index": trial.number[1], "outcome": verdict["outcome"], "said": verdict["said"][:300],
            "seconds": round(verdict["seconds"], 2), "features": "|".join(trial.words),
            "relations": "|".join(f"{k}={v}" for k, v in verdict["tried"].items()), "details": told[:1200]}


def keep(trial: Trial, verdict: dict[str, Any], folder: Path) -> str:
    """Leaves what is wrong in a folder of its own, with both scenes; says what it is."""
    wrong = {k: v for k, v in verdict["tried"].items() if v in WRONG}
    if verdict["outcome"] in WRONG or unsound(trial, verdict):
        wrong["itself"] = verdict["outcome"]
    for relation, what in wrong.items():
        place = folder / f"{trial.number[0]}-{trial.number[1]} {relation}"
        os.makedirs(place, exist_ok=True)
        said = f"{relation} {trial.drawn}: {what}\n{verdict['details'].get(relation, verdict['said'])}"
        write(trial.data, place / "scene.yaml", said)
        if relation in verdict["variants"]:
            write(verdict["variants"][relation], place / "other.yaml", f"the same, {relation}")
    return ", ".join(f"{k} {v}" for k, v in wrong.items())


def unsound(trial: Trial, verdict: dict[str, Any]) -> bool:
    """Return whether a run stopped that should have gone on: a guard spoke, all is bonded, or the
    scene is an ordinary one, which has a solution."""
    bonded = all(e["law"] == "perfect" for e in trial.data.get("interfaces", []))
    return verdict["outcome"] == "stopped" and (
        bonded or bool(kind(trial.words)) or verdict["said"].startswith("guard"))


def kind(words: list[str]) -> str:
    """Return the kind of an ordinary scene, else nothing."""
    return next((word.removeprefix("kind ") for word in words if word.startswith("kind ")), "")


def read(table: Path) -> list[dict[str, str]]:
    """The rows of an earlier run, if there are any."""
    if not table.exists():
        return []
    with open(table, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def tell_kinds(rows: list[dict[str, str]], study) -> None:
    """Print, of each kind of ordinary scenes, how they ended and how many relations fail."""
    ends: dict[str, Counter] = {}
    for row in rows:
        if of := kind(row["features"].split("|")):
            found = ends.setdefault(of, Counter())
            found[row["said"].split(",")[0] if row["outcome"] == "stopped" else row["outcome"]] += 1
            found["relations that fail"] += sum(text.partition("=")[2] in WRONG for text in row["relations"].split("|"))
    for name, found in sorted(ends.items()):
        study.console.print(f"  kind {name:14} " + ", ".join(f"{n} {k}" for k, n in found.most_common() if n))


def tell(rows: list[dict[str, str]], study) -> None:
    """Prints outcomes, relations, features, and pairs of features that were never tried together."""
    outcomes = Counter(r["outcome"] for r in rows)
    study.console.print("scenes: " + ", ".join(f"{n} {k}" for k, n in outcomes.most_common()))
    relations: dict[str, Counter] = {}
    features: Counter = Counter()
    pairs: Counter = Counter()
    for r in rows:
        for text in filter(None, r["relations"].split("|")):
            name, _, verdict = text.partition("=")
            relations.setdefault(name, Counter())[verdict] += 1
        if r["outcome"] != "refused":
            words = sorted(r["features"].split("|"))
            features.update(words)
            pairs.update(combinations(words, 2))
    tell_kinds(rows, study)
    for name, verdicts in sorted(relations.items()):
        study.console.print(f"  {name:22} " + ", ".join(f"{n} {k}" for k, n in verdicts.most_common()))
    study.folder.joinpath("features.csv").write_text("feature,scenes\n" + "".join(f"{k},{n}\n" for k, n in features.most_common()))
    names = sorted(features)
    study.folder.joinpath("pairs.csv").write_text(",".join(["", *names]) + "\n" + "".join(
        ",".join([a, *(str(pairs[min(a, b), max(a, b)] if a != b else features[a]) for b in names)]) + "\n" for a in names))
    never = [f"{a} × {b}" for a, b in combinations(names, 2) if not pairs[a, b]]
    study.console.print(f"{len(names)} features, {len(names) * (len(names) - 1) // 2} pairs of them, never together: {len(never)}")
    refused = Counter(r["said"].split(";")[0][:60] for r in rows if r["outcome"] == "refused")
    study.folder.joinpath("refused.csv").write_text("count,said\n" + "".join(f'{n},"{k}"\n' for k, n in refused.most_common()))

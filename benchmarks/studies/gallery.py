"""The gallery: every configuration and tutorial is run, and told in a section of docs/gallery.md, with a small picture."""

from __future__ import annotations

import io
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Mapping
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.commands import cpu_of_children, MPI, whole_command
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.kit.tutorials import followed
from orchestrator import BlackBoxError, Solution
from orchestrator.results.figures.artist import drawn
from orchestrator.results.figures.pictures import deformed, draw, fitted
from orchestrator.results.summary.summary import View

ROOT = Path(__file__).resolve().parents[2]
PAGE, PICTURES = ROOT / "docs" / "gallery.md", ROOT / "docs" / "pictures" / "gallery"
WIDTH = 320  # dots of a picture
# Of each tutorial, the results that are drawn.
DRAWN = {"1_own_mesh": "plate", "2_assembly": "bracket_contact", "3_bolts": "bracket_bolted", "4_own_solver": "bar", "5_cluster": "one",
         "6_python": "python", "7_lap_joint": "lap", "8_press_fit": "fit"}
_HEAD = """# Gallery

Every configuration that is shipped, and every tutorial: what it shows, how to run it, what it takes. Displacements are drawn larger than
they are. Colours show von Mises stress, from zero to what 99 % of the view stays below; more is red. Where no stress is known they show
the displacement; grey is not known.
`orchestrator study gallery` runs all of them and writes this page. Seconds are CPU's, of all processes from start to end, on the
machine of [measured](measured.md). Runs that are left out (`--set skip=[NAME]`) have none.
"""


class Settings(Keys):
    """What may be set of the study."""

    skip: list[str] = []  # configurations that are not run: they have no numbers, their pictures stay as they are


def run(study: Study, settings: Settings = Settings()) -> None:
    """One run each, by the commands that the page names; a tutorial's are all of its commands."""
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))  # who draws finds this file
    PICTURES.mkdir(parents=True, exist_ok=True)
    lines = []
    for path in configurations():
        row = None
        if path.stem not in settings.skip:
            row = study.kept(path.stem, {"text": path.read_text(encoding="utf-8")}, lambda: _configuration(study, path))
            study.note(row, f"{path.stem}: {row['dofs']:,} dofs, {row['seconds']:.1f} s")
        lines.append(_line(path.stem, told(path), f"`orchestrator run configs/{path.name}`", row))
    for path in tutorials():
        row = study.kept(path.stem, {"text": path.read_text(encoding="utf-8")}, lambda: _tutorial(study, path))
        study.note(row, f"{path.stem}: {row['dofs']:,} dofs, {row['seconds']:.1f} s")
        lines.append(_line(path.stem, title(path), f"[tutorial](tutorials/{path.name})", row))
    PAGE.write_text(_HEAD + "\n".join(["", *lines]), encoding="utf-8")


def configurations() -> list[Path]:
    """Those that are shipped."""
    return sorted((ROOT / "configs").glob("*.yaml"))


def tutorials() -> list[Path]:
    """Those that are shipped."""
    return sorted(path for path in (ROOT / "docs" / "tutorials").iterdir() if path.suffix in (".md", ".ipynb"))


def told(path: Path) -> str:
    """What a configuration says of itself: its first comment, above the command that runs it."""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines()[1:]:
        if not line.startswith("#") or line.removeprefix("#").strip().startswith("orchestrator run"):
            break
        lines.append(line.removeprefix("#").strip())
    return " ".join(lines)


def title(path: Path) -> str:
    """Of a tutorial."""
    if path.suffix == ".ipynb":
        return "".join(json.loads(path.read_text(encoding="utf-8"))["cells"][0]["source"]).splitlines()[0].removeprefix("# ")
    return path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


def _line(name: str, what: str, how: str, row: Mapping[str, Any] | None) -> str:
    numbers = "" if row is None else f": {row['dofs']:,} dofs, {row['seconds']:.1f} CPU seconds"
    return f"## {name}\n\n![{name}](pictures/gallery/{name}.png)\n\n{what}\n\n{how}{numbers}\n"


def _configuration(study: Study, path: Path) -> dict[str, Any]:
    begin = cpu_of_children()
    whole_command(study, path.stem, path)
    return _row(study.folder / path.stem, path.stem, cpu_of_children() - begin)


def _tutorial(study: Study, path: Path) -> dict[str, Any]:
    """All commands in a folder of its own, ``orchestrator`` and ``python`` those of this process; of a notebook its cells."""
    place, programs = study.folder / path.stem, study.folder / "bin"
    place.mkdir(exist_ok=True), programs.mkdir(exist_ok=True)
    for name, call in (("orchestrator", "-m orchestrator"), ("python", "")):
        (programs / name).write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {call} "$@"\n')
        (programs / name).chmod(0o755)
    there = {**os.environ, **MPI, "PATH": os.pathsep.join([str(programs), str(Path(sys.executable).parent), os.environ["PATH"]])}
    begin = cpu_of_children()
    with chdir(place):
        for command in _cells(path) if path.suffix == ".ipynb" else (command for command, _ in followed(path)):
            done = subprocess.run(command, shell=True, capture_output=True, text=True, env=there)
            if done.returncode:
                raise BlackBoxError(f"{path.name}: {command}\n{done.stdout}{done.stderr}")
    return _row(place / "results" / DRAWN[path.stem], path.stem, cpu_of_children() - begin)


def _cells(path: Path) -> list[str]:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    Path("cells.py").write_text("\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"), encoding="utf-8")
    return ["python cells.py"]


def _row(folder: Path, name: str, seconds: float) -> dict[str, Any]:
    (PICTURES / f"{name}.png").write_bytes(drawn(thumbnail, folder))
    return {"case": name, "dofs": json.loads((folder / "summary.json").read_text(encoding="utf-8"))["dofs"], "seconds": seconds}


def thumbnail(folder: Path) -> bytes:
    """PNG of the load step with the largest stress, without scale and words."""
    from PIL import Image

    solution, buffer = Solution.read(folder), io.BytesIO()
    picture = fitted(deformed(solution.fields, View(solution.summary)))
    largest = int(np.argmax([np.nanmax(surface["colour"]) for surface in picture.surfaces]))
    Image.fromarray(draw(picture, largest, WIDTH)).quantize(256, Image.Quantize.MAXCOVERAGE).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()

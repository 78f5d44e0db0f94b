"""state.npz: where a run has ended, for another one of the same mesh to begin with.

A ``Checkpoint`` of the whole scene as in the files of checkpoint/, with ŵ and f̂ of the last local
stage, for all load steps: the search direction of the run that begins makes its state of them.
Beside it stands what the columns are of, so that a run of another mesh or of other interfaces is
refused.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from orchestrator.errors import InputError, some, wrong
from orchestrator.kept import key_of
from orchestrator.method.checkpoint import Checkpoint, HATS, Start
from orchestrator.method.iterated import load_cases
from orchestrator.results.checkpoint import Kept, read_file, TOLD, VERSION
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.model import Scene

NAME = "state.npz"
_FITS = ("a run of the same mesh, cut alike, with the same interfaces, supports and load steps; "
         "loads, friction, gaps, moduli and the tolerance may differ")
# given what says whether a folder's state fits, folder → what of it is to be begun with
Choose = Callable[[Callable[[Path], bool]], Mapping[Path, float]]
_CURE = "name another folder, or leave --start-from out"


def layout_of(scene: Scene, by_nodes: bool) -> dict[str, str]:
    """Return what a state's rows and columns are of: name → hash or number.

    by_nodes : whether bodies meet by nodes, not by interfaces, see ``TraceSpace``
    """
    layout = {"version of states": str(VERSION), "load steps": repr((
        scene.steps, load_cases(scene).chosen.tolist())),
        "traces": "nodes" if by_nodes else "interfaces"}
    layout |= {f"subdomain {s.name}": key_of([made, s.fixed]).hex()
               for s, made in zip(scene.subdomains, scene.prints)}
    for i in scene.interfaces:
        made = key_of([i.subdomains, i.nodes, i.traced(0), i.traced(1)]).hex()
        layout[f"interface {i.name}"] = layout.get(f"interface {i.name}", "") + made
    return layout


def keep_state(folder: ResultsFolder, ended: Sequence[Path], layout: Mapping[str, str]) -> None:
    """Write the state that increments have ended with, from their checkpoints, where these are
    there still.

    Raises InputError: no room
    """
    if not all(file.is_file() for file in ended):
        return
    found = [read_file(file)[1] for file in ended]
    whole = [x for x in found if x.notes["part"][1] == 1]
    arrays = {name: np.vstack([x.arrays[name] for x in whole]) for name in HATS}
    about = {name: getattr(found[-1], name) for name in TOLD}
    about |= {"notes": {"states": found[-1].notes["states"]}, "problem": layout,
              "arrays": sorted(arrays)}
    with folder.replacing(NAME) as temporary, open(temporary, "wb") as file:
        np.savez(file, about=np.frombuffer(json.dumps(about).encode(), np.uint8), **arrays)


def started_from(directory: Path, layout: Mapping[str, str]) -> Start:
    """Return where a run begins that another one's state is to serve.

    Raises InputError: there is none, or it is of another mesh, of other interfaces or load steps
    """
    path = Path(directory) / NAME
    if not path.is_file():
        raise wrong((), f"--start-from {directory}: no {NAME} there", "the folder of a run that "
                    "has ended", "end that run, with --resume, or leave --start-from out")
    try:
        about, found = read_file(path)
        theirs = about["problem"]
        widths = {name: x.shape[1] for name, x in found.arrays.items()}
    except Exception as error:  # whatever a disk has made of it
        raise wrong((), f"--start-from {directory}: {NAME} cannot be read: {error}", _FITS,
                    _CURE) from error
    if differ := [key for key in {**layout, **theirs} if layout.get(key) != theirs.get(key)]:
        raise wrong((), f"--start-from {directory}: its run does not fit, in {some(differ)}", _FITS,
                    _CURE)
    return _combined({directory: 1.0},
                     {directory: Kept(found.iteration, 0, 0, {}, found.notes, path, widths)})


def nearest_start(choose: Choose, layout: Mapping[str, str]) -> Start | None:
    """Return where a run begins that several others' states may serve; None: none does."""
    found: dict[Path, Checkpoint] = {}

    def fits(directory: Path) -> bool:
        with suppress(InputError):
            found[directory], = started_from(directory, layout).others
        return directory in found

    shares = choose(fits)
    return _combined(shares, found) if shares else None


def _combined(shares: Mapping[Path, float], found: Mapping[Path, Checkpoint]) -> Start:
    return Start(others=[found[path] for path in shares], shares=[*shares.values()],
                 origin=[{"run": str(path), "share": share} for path, share in shares.items()])

"""A sweep: variants of a configuration, one after the other in one process, which keeps what they
have in common.

The mesh is made again only where what makes it varies; processes of codes, models and factors are
kept where no model changes (see ``blackbox.start``), and so is what follows from geometry alone
(``kept``). A variant begins with the states of those near it (``nearest``), unless ``method.start``
is cold; it ends by the same criterion as ``run`` alone.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from orchestrator.accuracy.loop import run
from orchestrator.blackbox.start import KeptCodes
from orchestrator.config.load import Loaded, load_config, located
from orchestrator.config.model import Config
from orchestrator.errors import CONVERGED, NOT_CONVERGED, InputError, OrchestratorError, Problems
from orchestrator.kept import while_kept
from orchestrator.optional import absent
from orchestrator.results.checkpoint import saved
from orchestrator.results.fingerprint import digest_of, problem_of
from orchestrator.results.folder import ResultsFolder, locked
from orchestrator.results.summary.summary import numbers_of, read_summary, View
from orchestrator.results.record import GO_ON
from orchestrator.run import Means, Ranks
from orchestrator.scene.body import Meshed
from orchestrator.sweeps.nearest import chained, places_of, start_near
from orchestrator.sweeps.table import Screen, drawn, NAME as TABLE, rows_of
from orchestrator.sweeps.variants import Variant, variants_of
from orchestrator.timing import Stopwatch

NOTES, PICTURE = "sweep.json", "sweep.png"
NOT_BEGUN = -1  # no exit code


@dataclass
class Outcome:
    """End of a variant.

    exit_code : as ``run`` would have ended with; ``NOT_BEGUN`` before
    why : what went wrong, in one line
    numbers : of its summary, see ``numbers_of``
    fingerprint : of all that decides its results
    kept : it was there from an earlier sweep
    started_from : names of the variants that it began with
    """

    exit_code: int = NOT_BEGUN
    why: str = ""
    numbers: dict[str, float] = field(default_factory=dict)
    fingerprint: str = ""
    kept: bool = False
    started_from: str = ""


class Sweep:
    """Variants, and what has become of them.

    config : the YAML file; overrides : for all variants; variants : see ``variants_of``
    folder : of the table, the picture, and a folder for each variant
    figures : whether every variant is drawn, as its configuration says
    quiet : nothing is printed but errors
    Raises InputError: no variant is a valid configuration, or the folder cannot be written
    """

    def __init__(self, config: Path, overrides: Sequence[str], variants: Sequence[Variant],
                 folder: Path, figures: bool = False,
                 quiet: bool = False):
        self.variants, self.quiet = variants, quiet
        more = [] if figures else ["output.figures=false"]
        self._loaded = [_loaded(config, [*overrides, *variant.overrides, *more])
                        for variant in variants]
        if all(isinstance(one, InputError) for one in self._loaded):
            raise self._loaded[0]
        self.folder = ResultsFolder(folder)
        self.outcomes = {variant.name: Outcome() for variant in variants}
        self.units: dict[str, str] = {}
        self._meshed, self._codes = Meshed(), KeptCodes()
        self._places = places_of(variants)

    def run(self, resume: bool = False) -> int:
        """Run all variants; those that fail keep no other from running.

        resume : variants that the folder has already are not run again, one that was interrupted
            goes on
        Returns exit code: 0 all converged, else the largest of theirs
        """
        with locked(self.folder):
            before: dict[str, Outcome] = {}
            # notes of an earlier sweep, where there are any that can be read
            with suppress(OSError, ValueError, KeyError, TypeError):
                for one in json.loads((self.folder / NOTES).read_bytes())["variants"] * resume:
                    before[one["name"]] = Outcome(one["exit_code"], fingerprint=one["fingerprint"])
            screen = Screen(self.variants, self.quiet)
            try:
                with while_kept() as begin:
                    for number in chained(self._places):
                        variant = self.variants[number]
                        begin()
                        self._one(number, before.get(variant.name))
                        self._write()
                        screen.row(variant, self.outcomes[variant.name])
            finally:
                self._codes.end()
            self._draw()
            screen.end(self.folder.path, list(self.outcomes.values()))
        return max(outcome.exit_code for outcome in self.outcomes.values())

    def _one(self, number: int, before: Outcome | None) -> None:
        variant, loaded = self.variants[number], self._loaded[number]
        outcome, path = self.outcomes[variant.name], self.folder / variant.name
        try:
            if isinstance(loaded, InputError):
                raise loaded
            outcome.fingerprint = self._fingerprint(loaded.config)
            same = before is not None and before.fingerprint == outcome.fingerprint
            outcome.kept = same and before.exit_code == CONVERGED and _summary(path) is not None
            if outcome.kept:
                outcome.exit_code = CONVERGED
            else:
                self._write()  # what has been begun, to be gone on with
                label = f"variant {1 + number} of {len(self.variants)}"
                means = Means(Ranks(codes=self._codes), meshed=self._meshed, watch=Stopwatch(),
                              label="" if self.quiet else label,
                              choose=None if loaded.config.method.start == "cold"
                              else partial(self._near, number))
                outcome.exit_code = run(loaded, output=path,
                                        resume=same and saved(ResultsFolder(path)), quiet=True,
                                        means=means)
                if outcome.exit_code == NOT_CONVERGED and View(_summary(path)).started_from:
                    # no start keeps a variant from what it ends with alone
                    outcome.exit_code = run(loaded, output=path, quiet=True,
                                            means=replace(means, choose=None, watch=Stopwatch()))
        except OrchestratorError as error:
            self._codes.end()
            outcome.exit_code, outcome.why = error.exit_code, (
                str(error).splitlines() or [type(error).__name__])[0]
            if isinstance(error, InputError):  # the first in the file
                first = (located(error, loaded) if isinstance(loaded, Loaded)
                         else error).problems[0]
                outcome.why = ": ".join(filter(None, (".".join(map(str, first.path)), first.found)))
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(GO_ON) from error
        if outcome.exit_code in (CONVERGED, NOT_CONVERGED) and (summary := _summary(path)):
            view = View(summary)
            outcome.numbers, self.units = numbers_of(view), view.unit
            outcome.started_from = " ".join(Path(one["run"]).name for one in view.started_from)
            if outcome.exit_code:
                outcome.why = outcome.why or str(view.stop_reason)

    def _near(self, number: int, fits: Callable[[Path], bool]) -> dict[Path, float]:
        """Return the folders of those that a variant begins with, and what of each, see
        ``start_near``.
        """
        folders = [self.folder / variant.name for variant in self.variants]
        shares = start_near(self._places, number, lambda other: (
            self.outcomes[self.variants[other].name].exit_code == CONVERGED
            and fits(folders[other])))
        return {folders[other]: share for other, share in shares.items()}

    def _fingerprint(self, config: Config) -> str:
        """Fingerprint of all that decides the results: values, contents of files, the mesh."""
        problems, told = Problems(), config.complete()
        body = self._meshed(config, True, problems)
        problems.raise_if_any()
        told["output"] = {key: value for key, value in told["output"].items()
                          if key not in ("directory", "figures")}
        known = json.dumps(told, sort_keys=True) + digest_of(problem_of(
            config.complete(), body.mesh.nodes, body.mesh.cells))
        return hashlib.sha256(known.encode()).hexdigest()

    def _write(self) -> None:
        """The table, and how far the sweep has come."""
        self.folder.write_table(TABLE, rows_of(self.variants, self.outcomes))
        notes = [{"name": v.name, "values": v.values, **vars(self.outcomes[v.name])}
                 for v in self.variants]
        self.folder.write(NOTES, json.dumps({"variants": notes}, indent=1) + "\n")

    def _draw(self) -> None:
        """The picture, where what draws is installed."""
        if absent("matplotlib"):
            return
        found = [(variant.values, self.outcomes[variant.name].numbers) for variant in self.variants]
        if (picture := drawn(found, self.units)) is not None:
            self.folder.write(PICTURE, picture)
        else:
            self.folder.remove(PICTURE)


def _loaded(config: Path, overrides: list[str]) -> Loaded | InputError:
    try:
        return load_config(config, overrides, edited=True)
    except InputError as error:
        return error


def _summary(path: Path) -> dict[str, object] | None:
    try:
        return read_summary(path)
    except InputError:
        return None


def sweep(config: str | Path | Config | Mapping[str, Any], vary: Mapping[str, Sequence[Any]], *,
          zipped: bool = False, overrides: Sequence[str] = (), resume: bool = False,
          output: str | Path = "results/sweep") -> Any:
    """Solve a configuration with different values, as ``orchestrator sweep`` does.

    config : a YAML file, or what is in one
    vary : key, as after ``--set`` → its values; every combination, or where they are ``zipped`` the
        first values together, then the second ones
    overrides : for all variants, as after ``--set``
    resume : variants that the folder has already are not solved again
    output : the sweep's folder
    Returns a line per variant: its values, its exit code, which variants it began with, its numbers
        at the last load step; a pandas DataFrame where pandas is installed, else dictionaries
    Raises InputError: as the command

    Examples
    --------
    >>> from orchestrator import sweep
    >>> bar = {
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}},
    ...     "materials": [{"young": 200e3, "poisson": 0.0}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
    ...                  {"on": "xmax", "traction": [10, 0, 0]}]}
    >>> found = sweep(bar, {"boundary.1.traction": [[10, 0, 0], [20, 0, 0]]}, output="bars")
    >>> len(found)
    2
    """
    variants = variants_of([f"{key}={', '.join(map(json.dumps, values))}"
                            for key, values in vary.items()], zipped)
    if not isinstance(config, (str, Path)):
        told = config.complete() if isinstance(config, Config) else config
        config = ResultsFolder(output).write("config.yaml", json.dumps(told))
    done = Sweep(Path(config), overrides, variants, Path(output), quiet=True)
    done.run(resume)
    head, *rows = rows_of(variants, done.outcomes)
    if absent("pandas"):
        return [dict(zip(head, row)) for row in rows]
    from pandas import DataFrame

    return DataFrame(rows, columns=head)

"""One run from a configuration to its results folder."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from orchestrator.blackbox.codes.parts import finish_parts
from orchestrator.compiled import make_ready
from orchestrator.config.load import Loaded
from orchestrator.config.model import Config
from orchestrator.errors import CONVERGED, NOT_CONVERGED
from orchestrator.parallel.team import Team
from orchestrator.results.checkpoint import begun
from orchestrator.results.figures.artist import artist_for, Artist
from orchestrator.results.folder import ResultsFolder, locked, of_parts
from orchestrator.results.record import Record, unexpected
from orchestrator.results.solution import Solution
from orchestrator.results.starting import Choose
from orchestrator.results.progress import Progress
from orchestrator.results.summary.lines import print_summary
from orchestrator.scene.body import Meshed
from orchestrator.solving import Ranks, scene_of, solve, solved_anew
from orchestrator.timing import Stopwatch


@dataclass(frozen=True)
class Means:
    """Means that a run works with, and may leave to another one.

    ranks : who solves it, and what makes their black boxes
    artist : who draws the figures; None: one that gets ready for this run, where they are asked for
    meshed : what makes the mesh
    watch : where seconds are counted; None: since this process was started
    verbose : whether all of the summary is printed
    label : what the run is of several, for progress, which is told then even where it is quiet
    judge : given the solution before anything is written of it, gives what is to be written; None:
        as it is
    choose : chooses among other runs whose states may serve to begin with; None: none do
    """

    ranks: Ranks = Ranks()
    artist: Artist | None = None
    meshed: Meshed | None = None
    watch: Stopwatch | None = None
    verbose: bool = False
    label: str = ""
    judge: Callable[[Solution], Solution] | None = None
    choose: Choose | None = None


def run(loaded: Loaded, *, output: Path | None = None, resume: bool = False,
        reference: bool = False, start_from: Path | None = None,
        quiet: bool = False, means: Means = Means()) -> int:
    """Solve a configuration and write its results folder; on rank 0, while the others ``follow``.

    output : the results folder; None: the configuration's
    resume : go on from the checkpoint there
    reference : also solve undecomposed
    start_from : folder of a run of the same mesh whose state this one begins with
    Returns exit code: 0 converged, 1 stopped without converging
    InputError, BlackBoxError, InternalError, KeyboardInterrupt : after history, summary and
        checkpoint have been saved
    """
    config, watch, team = loaded.config, means.watch or Stopwatch.since_launch(), means.ranks.team
    folder = ResultsFolder(output or config.output.directory
                           or os.path.join("results", config.name))
    drawing = artist_for(config.output.figures) if means.artist is None else nullcontext(
        means.artist)
    with locked(folder), unexpected(folder, team), drawing as artist:
        with closing(Progress(quiet and not means.label, label=means.label)) as progress:
            _make_ready(folder, config, resume)
            scene = scene_of(config, progress, watch, means.meshed)
            with closing(Record(folder, config, scene, watch, artist, resume=resume,
                                start_from=start_from, choose=means.choose)) as record:
                team.share((config, reference))
                told = [*record.subscribers, progress]
                solution = solve(config, scene, told, reference=reference, start=record.start,
                                 watch=watch, ranks=means.ranks)
                if means.judge is None:  # who judges a mesh asks for the energy error
                    solution = solved_anew(config, solution, told, watch, means.ranks,
                                           means.meshed)
                if config.output.fields:
                    told = finish_parts(config.codes, solution.scene.subdomains, solution.parts,
                                        solution.joints, folder.of_part)
                    solution.summary["warnings"] += told
                if means.judge is not None:
                    progress.close()  # it prints
                    solution = means.judge(solution)
                record.finish(solution)
    if not quiet:
        print_summary(solution.summary, folder.path, verbose=means.verbose)
    return CONVERGED if solution.converged else NOT_CONVERGED


def _make_ready(folder: ResultsFolder, config: Config, resume: bool) -> None:
    """Find what is wrong with the folder before anything is computed."""
    folder.check_free()
    folder.check_free(
        of_parts([code.name for code in config.codes if code.writes_results]))
    if not all(entry.kind.perfect for entry in config.interfaces):
        make_ready()
    if not resume:
        begun(folder)


def follow(team: Team) -> int:
    """Solve with rank 0, which alone makes scenes, prints and writes, until it shares None.

    Returns 0: the exit code is rank 0's.
    """
    while (given := team.share(None)) is not None:
        config, reference = given
        solve(config, reference=reference, ranks=Ranks(team))
    return CONVERGED

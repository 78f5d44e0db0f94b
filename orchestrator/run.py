"""One run from configuration to results: the only place where all rooms meet."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from orchestrator.blackbox.codes.foreign.results import fields_of_parts, finish_parts
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.start import make_blackbox, with_layers, with_own_loads
from orchestrator.compiled import make_ready
from orchestrator.config import Config, Loaded
from orchestrator.config.blackbox import entry_path
from orchestrator.config.method import Method
from orchestrator.cost import predicted_cost
from orchestrator.errors import CONVERGED, NOT_CONVERGED, InputError, Problem
from orchestrator.memory import give_back, keep_at_hand, trim
from orchestrator.method.decomposition import Decomposition, prepare
from orchestrator.method.delivery.deliver import Delivered, deliver, on_whole
from orchestrator.method.delivery.pseudo_loads import with_pseudo_loads
from orchestrator.method.delivery.discretisation_estimate import DiscretisationEstimate
from orchestrator.method.delivery.reference import Reference, TrueError, check_reference, solve_reference
from orchestrator.method.events import Subscriber, Subscribers
from orchestrator.method.load_cases import LoadCases, common_load_cases
from orchestrator.method.part import Part
from orchestrator.method.increments import check_iterations, iterate
from orchestrator.method.monitors.placing import Placing, Unbalanced
from orchestrator.method.start import Start, numbers_of
from orchestrator.parallel.placement import Placement, ranks_of, with_workers
from orchestrator.parallel.team import ALONE, Team
from orchestrator.registry import LAWS
from orchestrator.results.figures.artist import Artist
from orchestrator.results.fields.estimated import estimated
from orchestrator.results.fields.files import write_piece
from orchestrator.results.fields.piece import Piece
from orchestrator.results.folder import ResultsFolder, of_parts
from orchestrator.results.kept_mesh import kept_mesh
from orchestrator.results.lock import locked
from orchestrator.results.record import Record
from orchestrator.results.solution import Solution, fields_of
from orchestrator.results.subscribers.checkpoint import begun
from orchestrator.results.subscribers.progress import Progress
from orchestrator.results.subscribers.whole_states import whole_states
from orchestrator.results.summary.content import summarise
from orchestrator.results.summary.spent import Spent
from orchestrator.results.summary.short_form import print_summary
from orchestrator.results.summary.workload import Workload
from orchestrator.results.unexpected import unexpected
from orchestrator.savings import Savings
from orchestrator.scene.aside import set_aside
from orchestrator.scene.build import build_scene
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.make import make_soles
from orchestrator.timing import Stopwatch


def solve(config: Config, scene: Scene | None = None, subscribers: Sequence[Subscriber] = (), *,
          reference: bool = False, start: Start | None = None, watch: Stopwatch | None = None,
          team: Team = ALONE, speeds: np.ndarray | None = None,
          may_stop: Callable[[], bool] | None = None) -> Solution | Piece:
    """Solve a problem; nothing is written.

    Parameters
    ----------
    scene : default: what ``build_scene`` makes of the configuration
    subscribers : told what goes on
    reference : also solve undecomposed, and follow the true error; with perfect interfaces only
    start : where an earlier run stood, to resume from
    watch : where seconds are counted
    team : the ranks that solve it together; each calls this, rank 0 alone needs the scene, and hands out its parts. Only
        rank 0 gets the solution, the others their pieces of its fields, and only its subscribers see whole states
    speeds : (ranks,) of the ranks, shares of 1, by which they get subdomains; None: all alike
    may_stop : on rank 0, whether a run that is unbalanced can be gone on from; None: it is not asked

    Returns
    -------
    the solution, converged or not

    Raises
    ------
    InputError : the problem cannot be solved, or a code is not there
    BlackBoxError : a code fails, hangs or answers nonsense
    Unbalanced : where ``may_stop`` allows it: call it again, on all ranks, with the speeds found and the latest start

    Examples
    --------
    A bar of length 4 and modulus 200e3, pulled by 10 per unit area: it grows by 4 · 10 / 200e3.

    >>> from orchestrator import config_from, solve
    >>> config = config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.0}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}]})
    >>> solution = solve(config, reference=True)
    >>> solution.converged, solution.summary["true_error"] <= solution.error_bound <= 1e-6
    (True, True)
    >>> solution.displacement.shape    # load steps, nodes, components
    (1, 81, 3)
    >>> print(f"{solution.displacement[0, :, 0].max():.7f}, held by {solution.reactions[0, 0, 0]:.6f}")
    0.0002000, held by -10.000000
    """
    told, watch = Subscribers(subscribers), watch or Stopwatch()
    try:
        if scene is None and team.rank == 0:
            told.stage("meshing")
            with watch("mesh"):
                scene = build_scene(config, run_programs=True)
        return _solve(config, scene, told, reference, start, watch, team, speeds, may_stop)
    except Unbalanced:
        raise
    except BaseException as error:  # whatever it is, history and checkpoint are worth keeping
        told.failed(team.cause(error))
        raise


def _solve(config: Config, whole: Scene | None, told: Subscribers, reference: bool, start: Start | None,
           watch: Stopwatch, team: Team, speeds: np.ndarray | None,
           may_stop: Callable[[], bool] | None) -> Solution | Piece:
    """The stages of a solution: prepare, iterate, deliver, summarise; the whole scene is on rank 0."""
    begun = time.perf_counter()
    if team.size > 1:
        give_back()
    method, codes = config.method, with_workers(config.codes, team)
    if whole is not None:
        whole = with_own_loads(whole, codes)
    exact = _undecomposed(codes, whole, told, watch, team) if reference else None
    cases = common_load_cases(whole, method, team)
    rank_of = team.share(None if team.rank else ranks_of(whole, team.size, speeds))
    with watch("parts"):
        parts = [Part.handed_out(whole, rank_of, team)]
    estimate, on_the_way = DiscretisationEstimate(whole, cases), reference or method.tolerance.error == "auto"
    with set_aside(whole, team.size > 1 and not on_the_way):
        placement = Placement.of(parts[0].scene, rank_of, team)
        delivered, setup_sweeps, ranks = _part_solved(  # which alone holds the part
            config, parts.pop(), placement, codes, cases, told, start, watch, team,
            estimate, (whole, exact) if reference else None,
            partial(_placing, team, begun, may_stop) if team.size > 1 and speeds is None and not on_the_way else None)
    wanted, fields, pieces, piece = method.tolerance.error == "auto" or config.output.fields, None, None, None
    if team.rank == 0:
        with watch("output"):
            delivered = on_whole(delivered, whole)
            fields = fields_of(whole, delivered, ranks)
    with watch("bound"):
        if team.rank == 0:
            if wanted and (team.size == 1 or whole.mesh.foreign):  # what stands for a part that is not ours has no moduli in fields
                found = estimated(fields) if team.size == 1 else None
                delivered = replace(delivered, discretisation=found or estimate.of_delivered(delivered.continuous))
        if team.size > 1:
            give_back()  # of this rank's part nothing is left
            if team.rank == 0:
                known = delivered.discretisation
                pieces = replace(fields, interfaces=None, believed=None, discretisation_error=known and known.cells)
            piece, pieces = Piece.handed_out(pieces, rank_of, team), None
            if found := piece.estimate(wanted and team.rank == 0 and delivered.discretisation is None):
                delivered = replace(delivered, discretisation=found)
    if team.rank:
        piece.extremes()
        return piece
    summary = summarise(config, whole, delivered, setup_sweeps, exact, ranks, watch)
    with watch("output"):
        known = delivered.discretisation
        return Solution.of(config, whole, delivered, fields.with_error(known and known.cells), summary, exact, piece)


def _part_solved(config: Config, part: Part, placement: Placement, codes: Sequence, cases: LoadCases, told: Subscribers,
                 start: Start | None, watch: Stopwatch, team: Team, estimate: DiscretisationEstimate,
                 reference: tuple[Scene | None, Reference | None] | None,
                 placing: Callable[[Decomposition], Placing] | None) -> tuple[Delivered, float, list[Spent] | None]:
    """This rank's part of a solution: what is delivered, back-substitutions in set-up, and on rank 0 what all have spent.

    Parameters
    ----------
    reference : whole scene and undecomposed solution, on rank 0, where it is asked for
    placing : watches the balance of what is decomposed; None: nobody does
    """
    method, scene, savings, workers = config.method, part.scene, Savings(), max(code.workers for code in codes)
    if team.rank == 0:
        savings.add(cases.switch, "load steps", cases.left_out)
    with watch("soles"):
        soles = make_soles(scene, method.sole, method.skip.congruent, placement.touched)
    told.stage("assembling and factorising")
    check_iterations(len(cases.chosen), all(i.law.perfect for i in scene.interfaces), method,
                     any(s.remembers for s in scene.subdomains) or any(i.law.follows for i in scene.interfaces))
    with watch("start"):
        blackbox = with_layers(make_blackbox(codes, placement.codes), method.skip, workers, len(cases.chosen), savings)
    with blackbox:
        if reference and len(codes) > 1 and any(blackbox.traits(number).own_matter for number in placement.codes):
            raise InputError(Problem(("blackbox",), "--reference with several codes, one of which has matter of its own",
                                     "the whole structure in one code", "leave out --reference, or use one code"))
        if method.tolerance.error == "auto" and any(blackbox.traits(number).own_matter for number in placement.codes):
            raise InputError(Problem(("method", "tolerance", "error"), "auto beside a code whose matter is its own",
                                     "a number: the mesh's error is estimated from the YAML's moduli", "write error: 1e-6"))
        _check_nonlinear(codes, placement.codes, blackbox, method, bool(reference), team)
        workload = Workload(blackbox.usage, watch, team)
        d = prepare(scene, soles, method, blackbox, workers, watch, savings, part)
        del soles  # with the models made of them, what set-up has held and nothing else needs
        trim()
        workload.end("set_up")

        chosen = cases.part_of(d)
        true_error = TrueError(chosen, reference[0], cases, reference[1], watch) if reference else None
        numbers = numbers_of(chosen)
        begin = Start.handed_out(start, chosen, numbers)
        if team.size > 1:
            keep_at_hand(16 * d.steps * d.space.size)  # traces of all load steps, two such arrays in one
        iterated = iterate(chosen, method, whole_states(told.all, numbers, team), watch, begin, [int(step) + 1 for step in cases.chosen],
                           {"true_error": true_error, "estimate": estimate, "placing": placing and placing(chosen)})
        if d.all_perfect and team.rank == 0:
            savings.add("bound", "evaluations of the bound's second part",
                        sum(math.isnan(event.error_bound) for event in iterated.history))
        workload.end("iterations")
        if team.size > 1:
            give_back()

        if d.nonlinear is not None:
            d = chosen = chosen.reloaded()
            iterated = with_pseudo_loads(d, iterated)
        delivered = deliver(d, chosen, cases, iterated, watch)
        ranks = team.gather(Spent.of(blackbox.usage, placement.codes, workload.record, workers, savings,
                                     true_error.asked if true_error else 0.0))
    return delivered, d.setup_sweeps, ranks


def _placing(team: Team, begun: float, may_stop: Callable[[], bool] | None, d: Decomposition) -> Placing:
    """What watches the balance of the ranks, set up since a moment of ``time.perf_counter``."""
    usage, load = d.blackbox.usage, predicted_cost([(~s.fixed).sum() for s in d.own]).sum()

    def busy() -> float:
        return max((worker.solve + worker.messages for worker in usage.activity()), default=0.0)

    return Placing(team, busy, float(load), time.perf_counter() - begun, may_stop)


def _check_nonlinear(codes: Sequence, used: Sequence[int], blackbox: BlackBox, method: Method, reference: bool,
                     team: Team) -> None:
    """Raises InputError where an entry of ``blackbox`` and its solver disagree, or where linearity is asked for."""
    for number in used:
        truly, path = blackbox.traits(number).nonlinear, entry_path(number, codes)
        if truly and not codes[number].remembers:
            raise InputError(Problem(path, f"the solver of {codes[number].code} says that it is nonlinear", "nonlinear: true in its "
                                     "entry: load steps then follow each other", "write it, or nonlinear = False in its class"))
        if codes[number].remembers and not truly:
            raise InputError(Problem((*path, "nonlinear"), f"true, and the solver of {codes[number].code} is linear",
                                     "nonlinear = True in its class, with advance and commit", "write that, or leave nonlinear out"))
    if not any(code.remembers for code in codes):
        return
    if team.size > 1:
        raise InputError(Problem(("blackbox",), f"nonlinear matter on {team.size} ranks", "one rank: load steps are committed by "
                                 "one process", "run without mpiexec; workers of the codes still share the work"))
    if reference:
        raise InputError(Problem(("blackbox",), "--reference with nonlinear matter", "a linear problem", "leave it out"))
    if method.tolerance.error is None:
        raise InputError(Problem(("method", "tolerance"), "indicator with nonlinear matter", "error: the largest residual",
                                 "write tolerance: {error: 1e-6}"))
    if method.acceleration == "gmres":
        raise InputError(Problem(("method", "acceleration"), "gmres with nonlinear matter, whose fixed point is not affine",
                                 "anderson or none", "leave it out"))


def _undecomposed(codes: Sequence, scene: Scene | None, told: Subscribers, watch: Stopwatch, team: Team) -> Reference | None:
    """The reference, on rank 0."""
    if team.rank:
        return None
    check_reference(scene)
    told.stage("solving undecomposed")
    with watch("reference"), make_blackbox(codes[0]) as whole:
        return solve_reference(scene, whole)


def run(loaded: Loaded, *, output: Path | None = None, resume: bool = False, reference: bool = False,
        quiet: bool = False, team: Team = ALONE, artist: Artist | None = None) -> int:
    """Solve a configuration and write its results folder; on rank 0, while the others ``follow``.

    Parameters
    ----------
    artist : who draws the figures; default: where they are asked for, one that gets ready now

    Returns
    -------
    exit code: 0 converged, 1 stopped without converging

    Raises
    ------
    InputError, BlackBoxError, InternalError, KeyboardInterrupt : after history, summary and checkpoint have been saved
    """
    config, watch = loaded.config, Stopwatch.since_launch()
    folder = ResultsFolder(output or config.output.directory or os.path.join("results", config.name))
    drawing = Artist() if config.output.figures and artist is None else nullcontext(artist)
    with locked(folder), unexpected(folder, team), drawing as artist:
        with Progress(quiet) as progress:
            progress.stage("meshing")
            folder.check_free()  # now, not when all has been computed
            folder.check_free(of_parts([code.name for code in config.codes if getattr(code, "writes_results", False)]))
            if not all(LAWS[entry.law].perfect for entry in config.interfaces):
                make_ready()
            if not resume:
                begun(folder)
            if team.size > 1:
                give_back()
            with watch("mesh"):
                scene = build_scene(config, kept_mesh(folder, config.parts or [config.mesh], resume), run_programs=True)
            with Record(folder, config, scene, watch, resume=resume) as record:
                told = [*record.subscribers, progress]
                team.share((config, reference))
                start, speeds, placed = record.start, None, []
                while True:
                    try:
                        solution = solve(config, scene, told, reference=reference, start=start,
                                         watch=watch, team=team, speeds=speeds, may_stop=record.keeps)
                        break
                    except Unbalanced as found:
                        start, speeds = record.latest(), found.speeds
                        placed = [f"{found}: after iteration {found.iteration} subdomains were placed anew, by the ranks' speeds"]
                progress.close()
                solution.summary["warnings"] += placed
                if config.output.fields:
                    solution.summary["warnings"] += finish_parts(config.codes, solution.scene.subdomains, solution.parts,
                                                                 solution.joints, folder.of_part)
                record.finish(solution, config.output.fields, artist, fields_of_parts(
                    config.codes, solution.scene, solution.parts, solution.joints) if config.output.fields else [])
    if not quiet:
        print_summary(solution.summary, folder.path)
    return CONVERGED if solution.converged else NOT_CONVERGED


def follow(team: Team) -> int:
    """What the other ranks do: their parts of rank 0's scene, without a word. Returns 0; the exit code is rank 0's."""
    config, reference = team.share(None)
    speeds = None
    while True:
        try:
            piece = solve(config, reference=reference, team=team, speeds=speeds)
            break
        except Unbalanced as found:
            speeds = found.speeds
    if config.output.fields:
        write_piece(piece)
    return CONVERGED

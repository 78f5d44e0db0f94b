"""One run from configuration to results: the only place where all rooms meet."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from orchestrator.blackbox.layers.stack import with_layers
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config import Config, Loaded
from orchestrator.cost import predicted_cost
from orchestrator.errors import CONVERGED, NOT_CONVERGED, InputError, OrchestratorError, Problem
from orchestrator.method.stopping.criteria import LawCriterion
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.method.delivery.guards import failed_guards, with_noise
from orchestrator.method.delivery.interface_fields import InterfaceFields, interface_fields, sides
from orchestrator.method.delivery.recovery import delivered, reactions, recover
from orchestrator.method.load_cases import expanded, load_cases
from orchestrator.method.delivery.reference import Reference, solve_reference
from orchestrator.method.decomposition import Decomposition, prepare
from orchestrator.method.iterated import Iterated
from orchestrator.method.solver import Start, iterate
from orchestrator.method.delivery.held_bodies import held_bodies
from orchestrator.parallel.placement import owners
from orchestrator.parallel.team import ALONE, Elsewhere, Team
from orchestrator.results.figures.artist import Artist
from orchestrator.results.summary.cautions import cautions
from orchestrator.results.subscribers.checkpoint import Checkpoint, SavedState, fingerprint, load_checkpoint
from orchestrator.method.stopping.discretisation import Estimate, Estimator
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.files import write_fields
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.subscribers.history import HistoryWriter, read_history
from orchestrator.results.subscribers.progress import Progress
from orchestrator.results.summary.summary import memory_peak_mb, print_summary, versions, write_summary
from orchestrator.results.subscribers.whole_states import whole_states
from orchestrator.results.summary.workload import Workload, codes_of_all, joined
from orchestrator.savings import Savings
from orchestrator.scene.build import build_scene
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.make import make_soles
from orchestrator.timing import Stopwatch, seconds_since_launch

OFTEN = 2.0  # seconds between checkpoints with several ranks: a launcher that ends them leaves little time for one


@dataclass
class Solved:
    """A finished solution, before anything is written.

    Parameters
    ----------
    scene : what was solved
    outcome : how the iterations ended, with their history
    displacement : (T, n, 3) u_D, the field that the error bound speaks of; where interfaces open, the mean
        of the sides
    parts : per subdomain (T, n_E, 3)
    summary : the content of summary.json
    reference : the undecomposed solution, if asked for
    sides : per subdomain (T, n_E, 3), continuous over perfect interfaces; None where no interface opens
    interfaces : what happens on the interfaces that are not perfect; None where there are none
    discretisation : its estimated error; None where neither the tolerance nor the fields ask for it
    """

    scene: Scene
    outcome: Iterated
    displacement: np.ndarray
    parts: list[np.ndarray]
    summary: dict
    reference: Reference | None
    sides: list[np.ndarray] | None = None
    interfaces: InterfaceFields | None = None
    discretisation: Estimate | None = None


def solve(config: Config, scene: Scene, subscribers: Sequence[Subscriber] = (), *, reference: bool = False,
          start: SavedState | None = None, watch: Stopwatch | None = None,
          stage: Callable[[str], None] = lambda name: None, team: Team = ALONE) -> Solved | None:
    """Solve a scene; nothing is written.

    Parameters
    ----------
    subscribers : called with the loop's events
    reference : also solve undecomposed, and follow the true error
    start : where an earlier run stood, to resume from
    stage : told what goes on before the first iteration
    team : the ranks that solve it together; each calls this with the same scene, only rank 0 gets the solution,
        and only its subscribers see whole states

    Raises
    ------
    InputError, BlackBoxError : see the rooms
    """
    watch = watch or Stopwatch()
    share = max(1, int(team.cores()))
    settings = [code.model_copy(update={"workers": share}) if code.workers == "auto" else code for code in config.codes]
    workers = max(code.workers for code in settings)
    exact = None
    if reference and not all(i.law.perfect for i in scene.interfaces):
        raise InputError(Problem(("interfaces",), "--reference with interfaces that are not perfect",
                                 "perfect interfaces: the undecomposed solution has no other",
                                 "leave out --reference; judge by the law residuals in the summary"))
    if reference and team.rank == 0:
        stage("solving undecomposed")
        with watch("reference"), make_blackbox(settings[0]) as whole:
            exact = solve_reference(scene, whole)
    rank_of = owners_of(scene, team.size)
    with watch("soles"):
        touched = [team.rank in rank_of[list(i.subdomains)] for i in scene.interfaces]
        soles = make_soles(scene, config.method.sole, config.method.skip.congruent, touched)
    stage("assembling and factorising")
    savings, cases = Savings(), team.share(load_cases(scene, config.method.skip) if team.rank == 0 else None)
    if team.rank == 0:
        savings.add(cases.switch, "load steps", cases.left_out)
    with watch("start"):
        near = {e for i, here in zip(scene.interfaces, touched) if here for e in i.subdomains}
        used = sorted({s.code for s in scene.subdomains if rank_of[s.index] == team.rank or s.index in near})
        blackbox = with_layers(make_blackbox(settings, used), config.method.skip, workers, len(cases.chosen), savings)
    with blackbox:
        workload = Workload(blackbox.usage, watch, team.rank, lambda: team.waited)
        decomposition = prepare(scene, soles, config.method, blackbox, workers, watch, savings, team, rank_of)
        estimator = cache(lambda: Estimator(scene))
        workload.end("set_up")
        solved = cases.part_of(decomposition)

        asked_for_reference = 0.0

        def true_error(fields, bound) -> float:
            nonlocal asked_for_reference
            asked = blackbox.usage.asked
            with watch("reference"):
                found = cases.all_steps(recover(solved, fields, bound)[0])
                error = team.share(exact.relative_error(found) if exact else None)
            asked_for_reference += blackbox.usage.asked - asked
            return error

        def estimate(view, fields, bound) -> float:
            own = delivered(view, bound, recover(view, fields, bound)[1])
            if team.rank:
                return team.share(None)
            # with contact, the steps left out are smaller than those they follow from
            return team.share(estimator()([cases.all_steps(u) for u in own] if view.all_perfect else own).relative)

        space = decomposition.space
        earlier = Start()
        if start:
            earlier = Start(start.state[space.number], start.iteration, start.sweeps - decomposition.setup_sweeps)
        outcome = iterate(solved, config.method, whole_states(subscribers, space), watch, earlier,
                          true_error=true_error if reference else None, estimate=estimate, savings=savings)
        workload.end("iterations")
        with watch("linear_stage"):
            displacement, parts = recover(solved, outcome.fields, outcome.bound)
            displacement = cases.all_steps(displacement)
            parts = [part if part is None else cases.all_steps(part) for part in parts]
            outcome = expanded(decomposition, outcome, cases)
        estimated = None
        if config.method.tolerance.error == "auto" or config.output.fields:
            with watch("bound"):
                whole = delivered(decomposition, outcome.bound, parts)
                estimated = estimator()(whole) if team.rank == 0 else None
        own, opening = None, interface_fields(decomposition, outcome)
        if not decomposition.all_perfect:
            displacement, own = sides(decomposition, outcome, parts)
        if decomposition.all_perfect:
            outcome = with_noise(decomposition, outcome, parts)
        broken = failed_guards(decomposition, outcome, parts, opening)
        if broken:
            outcome = replace(outcome, converged=False, stop_reason=f"guard: {'; '.join(broken)}")
        contact = _contact(scene, decomposition, config, outcome, opening)
        forces = reactions(decomposition, parts, outcome.fields.f)
        spent = team.gather({"clock": blackbox.usage.clock(), "memory": blackbox.usage.memory_peak_mb() + memory_peak_mb(),
                             "codes": dict(zip(used, blackbox.usage.codes())),
                             "asked": blackbox.usage.asked - asked_for_reference, "workload": workload.record,
                             "workers": workers, "savings": savings})
        if spent is None:
            return None
    setup = decomposition.setup_sweeps
    last = outcome.last
    summary = {
        "name": config.name, "converged": outcome.converged, "stop_reason": outcome.stop_reason,
        "iterations": outcome.iterations,
        "sweeps": {"setup": setup, "iterations": outcome.sweeps, "total": setup + outcome.sweeps},
        "indicator": last.indicator, "error_bound": outcome.bound.relative,
        "true_error": exact.relative_error(displacement) if exact else None,
        "discretisation_error": estimated and estimated.relative, "tolerance": last.tolerance,
        "residuals": {name: getattr(last, name) for name in
                      ("displacement_jump", "force_imbalance", "residual", "macro_imbalance")}
        | contact.pop("law_residuals", {}),
        **size_of(scene), "energy": 0.5 * outcome.bound.energy, "reactions": forces,
        **contact, "warnings": cautions(scene, own or parts, opening, contact.get("detached", ())),
        **everybodys(spent, scene), "ranks": team.size, "config": config.complete(),
    }
    return Solved(scene, outcome, displacement, parts, summary, exact, own, opening, estimated)


def everybodys(spent: list[dict], scene: Scene) -> dict:
    """The part of the summary that adds up what each rank has used."""
    codes = codes_of_all([rank["codes"] for rank in spent])
    for number, entry in codes.items():
        entry["subdomains"] = [s.index for s in scene.subdomains if s.code == number]
    clocks = [rank["clock"] for rank in spent]
    return {
        "timing": {"blackbox": {stage: sum(clock[stage] for clock in clocks) for stage in clocks[0]}},
        "asking_seconds": max(rank["asked"] for rank in spent), "codes": list(codes.values()),
        "versions": versions({entry["code"]: entry["version"] for entry in codes.values()}),
        "workload": joined([rank["workload"] for rank in spent]), "workers": sum(rank["workers"] for rank in spent),
        "memory_peak_mb": sum(rank["memory"] for rank in spent),
        "skipped": sum((rank["savings"] for rank in spent), Savings()).table(),
    }


def _contact(scene: Scene, decomposition: Decomposition, config: Config, outcome: Iterated,
             interfaces: InterfaceFields | None) -> dict:
    """The part of the summary that speaks of interfaces that are not perfect; empty where all are."""
    if decomposition.all_perfect:
        return {}
    laws = LawCriterion(decomposition, config.method.tolerance).laws(outcome.fields, outcome.local)
    if interfaces is None:
        return {}
    detached, weakly_held = held_bodies(scene, interfaces)
    return {
        "law_residuals": laws.named,
        "status_counts": interfaces.counts,
        "interface_resultants": [
            {"name": str(name), "subdomains": [scene.subdomains[e].name for e in pair], "law": str(law),
             "resultant": force}
            for name, law, pair, force in zip(interfaces.names, interfaces.laws, interfaces.subdomains,
                                              interfaces.resultant.swapaxes(0, 1).tolist())],
        "detached": detached, "weakly_held": weakly_held,
    }


def size_of(scene: Scene) -> dict:
    """The part of the summary that says how large the problem is."""
    return {
        "dofs": 3 * len(scene.mesh.nodes), "dofs_decomposed": 3 * sum(len(s.nodes) for s in scene.subdomains),
        "subdomains": len(scene.subdomains), "interfaces": len(scene.interfaces),
        "interface_nodes": sum(len(i.global_nodes) for i in scene.interfaces), "load_steps": scene.steps,
    }


def run(loaded: Loaded, *, output: Path | None = None, resume: bool = False, reference: bool = False,
        quiet: bool = False, team: Team = ALONE) -> int:
    """Solve a configuration and write its results folder; on rank 0, while the others ``follow``.

    Returns
    -------
    exit code: 0 converged, 1 stopped without converging

    Raises
    ------
    InputError, BlackBoxError, KeyboardInterrupt : after history, summary and checkpoint have been saved
    """
    config, watch = loaded.config, Stopwatch()
    watch.start -= (launch := seconds_since_launch())
    watch.seconds["startup"] = launch
    folder = ResultsFolder(output or config.output.directory or os.path.join("results", config.name))
    with Artist() if config.output.figures else nullcontext() as artist:
        progress = Progress(quiet)
        try:
            progress.stage("meshing")
            with watch("mesh"):
                scene = build_scene(config)
            key = fingerprint(config.complete(), scene.mesh.nodes, scene.mesh.cells)
            saved = load_checkpoint(folder, key) if resume else None
            if not resume:
                folder.clear()
            checkpoint, last = Checkpoint(folder, key, *([OFTEN] if team.size > 1 else [])), LastEvent()
            with HistoryWriter(folder, saved.iteration if saved else None) as history:
                try:
                    team.share((config, scene, reference, saved))
                    solved = solve(config, scene, (history, checkpoint, progress, last), reference=reference,
                                   start=saved, watch=watch, stage=progress.stage, team=team)
                except (OrchestratorError, KeyboardInterrupt, Elsewhere) as error:
                    _write_remains(folder, config, scene, watch, checkpoint, last, team.cause(error))
                    raise
        finally:
            progress.close()
        _write(folder, solved, watch, config, artist)
    if not quiet:
        print_summary(solved.summary, folder.path)
    return CONVERGED if solved.outcome.converged else NOT_CONVERGED


def follow(team: Team) -> int:
    """What the other ranks do: the same scene as rank 0, without a word. Returns 0; the exit code is rank 0's."""
    config, scene, reference, start = team.share(None)
    solve(config, scene, reference=reference, start=start, team=team)
    return CONVERGED


def owners_of(scene: Scene, ranks: int) -> np.ndarray:
    """(subdomains,) int, the rank of each, by predicted cost and neighbourhood.

    Raises
    ------
    InputError : more ranks than subdomains
    """
    count = len(scene.subdomains)
    if ranks > count:
        raise InputError(Problem(("subdomains",), f"{ranks} ranks for {count} subdomain{'s' if count > 1 else ''}",
                                 "at least one subdomain for every rank",
                                 f"mpiexec -n {count} at most, or cut into more subdomains"))
    costs = predicted_cost([(~s.fixed).sum() for s in scene.subdomains])
    return owners(costs, [i.subdomains for i in scene.interfaces], [int(i.free.sum()) for i in scene.interfaces], ranks)


class LastEvent(Subscriber):
    """Remembers the last iteration, for the summary of a run that dies."""

    def __init__(self) -> None:
        self.last: Iteration | None = None

    def iteration(self, event: Iteration) -> None:
        self.last = event


def _write(folder: ResultsFolder, solved: Solved, watch: Stopwatch, config: Config, artist: Artist | None) -> None:
    """Fields, figures and summary of a finished run."""
    scene, summary = solved.scene, solved.summary
    with watch("output"):
        fields = Fields.of(scene, solved.displacement, solved.sides, solved.interfaces,
                           solved.discretisation and solved.discretisation.cells)
        if artist:
            _time(summary, watch)
            artist.begin(folder, summary, read_history(folder / "history.csv"), fields)
        if config.output.fields:
            write_fields(folder, fields)
        if artist:
            artist.finish()
    _time(summary, watch)
    write_summary(folder, summary)


def _time(summary: dict, watch: Stopwatch) -> None:
    summary["timing"] = {"total": watch.total, **watch.seconds, "blackbox": summary["timing"].get("blackbox", {})}
    # what is left when no code is at work; the reference is neither's
    summary["orchestrator_seconds"] = watch.total - summary["asking_seconds"] - watch.seconds.get("reference", 0.0)


def _write_remains(folder: ResultsFolder, config: Config, scene: Scene, watch: Stopwatch, checkpoint: Checkpoint,
                   last: LastEvent, error: BaseException) -> None:
    """What a run that dies leaves behind: a checkpoint, and a summary that says where it stood."""
    checkpoint.write()
    event = last.last
    reason = "interrupted" if isinstance(error, KeyboardInterrupt) else f"failed: {str(error).splitlines()[0]}"
    write_summary(folder, {
        "name": config.name, "converged": False, "stop_reason": reason,
        "iterations": event.iteration if event else 0, "indicator": event.indicator if event else None,
        "error_bound": event.error_bound if event else None, **size_of(scene),
        "timing": {"total": watch.total, **watch.seconds}, "versions": versions(), "config": config.complete(),
    })

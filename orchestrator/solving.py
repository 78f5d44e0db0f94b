"""Solution of a problem: its scene made, and solved, on one rank or several, stage after stage:

    parts        every rank gets its subdomains, and which load steps and forces are asked for
    codes        are started, and compared with what the configuration says of them
    set-up       each subdomain on its soles is factorised (``method.setup``)
    iterations   Algorithm 1 (``method.latin``), increment by increment, with all that is in
                 ``registry.MONITORS``
    delivery     fields inside the subdomains, forces, guards (``method.delivery``)
    answer       what rank 0 finds of all ranks' fields, and the summary (``results``)

Where sides have slid and are paired anew, all is solved a second time (``paired_anew``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import SharedModels
from orchestrator.blackbox.start import find_codes, make_blackbox, with_own_loads
from orchestrator.config.blackbox import CodeSettings
from orchestrator.config.model import Config
from orchestrator.errors import wrong
from orchestrator.method.checkpoint import numbers_of, Start
from orchestrator.method.delivery.deliver import deliver, Delivered
from orchestrator.method.delivery.flux import ForceProbes
from orchestrator.method.delivery.reference import (
    check_reference, Reference, solve_reference, WholeErrors)
from orchestrator.method.events import Subscriber, Subscribers
from orchestrator.method.increments import check_iterations, iterate
from orchestrator.method.iterated import load_cases
from orchestrator.method.setup import make_soles_of, prepare, RankPart
from orchestrator.optional import check_there
from orchestrator.paired_anew import paired_anew
from orchestrator.parallel.numbering import Placement, ranks_of, with_workers
from orchestrator.parallel.team import ALONE, Team
from orchestrator.processes import trim
from orchestrator.refused import by_keys, check_codes
from orchestrator.results.fields.fields import Fields
from orchestrator.results.history import interfaces_of_all, OnRanks
from orchestrator.results.solution import Solution, unsound
from orchestrator.results.summary.workload import Spent, Workload
from orchestrator.scene.body import Meshed
from orchestrator.scene.build import build_scene
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


@dataclass(frozen=True)
class Ranks:
    """Ranks that solve a problem together.

    codes : what makes a black box for each of them
    """

    team: Team = ALONE
    codes: Callable[[Sequence[CodeSettings], Sequence[int]], BlackBox] = make_blackbox


@dataclass(frozen=True)
class OneSolution:
    """One solution; every rank has its own. Fields as parameters of ``solving.solve``."""

    config: Config
    told: Subscribers
    start: Start | None
    watch: Stopwatch
    ranks: Ranks
    reference: bool

    def of(self, scene: Scene | None) -> Solution | None:
        """Return the solution on rank 0, which alone has a scene; None elsewhere."""
        team, method, watch = self.ranks.team, self.config.method, self.watch
        codes, exact, follows = with_workers(
            self.config.codes, team), None, method.tolerance.error == "auto"
        if not team.rank:
            scene = with_own_loads(scene, codes)
            if self.reference:
                exact = self._undecomposed(scene, codes[0])
        rank_of = team.share(None if team.rank else ranks_of(scene, team.size))
        with watch("parts"):
            part = RankPart.handed_out(scene, method, rank_of, team)
        forces = team.share(None if team.rank else ForceProbes.of(scene))
        own = [part.scene.subdomains[e] for e in part.space.subdomains]
        errors = WholeErrors(scene, load_cases(part.scene, own, team), exact, watch)
        placement = Placement.of(part.scene, rank_of, team)
        delivered, setup_sweeps, spent = self._delivered(
            part, codes, placement, errors, forces.of_rank(part.space.subdomains))
        del part, own
        trim()
        interfaces = interfaces_of_all(delivered.interfaces, team)
        if team.rank:
            return None
        lost = unsound(scene, spent)
        with watch("output"):
            delivered = delivered.told(scene, interfaces, lost, forces.within)
            fields = Fields.of(scene, delivered.displacement, delivered.sides,
                               delivered.interfaces, lost)
        if follows or self.config.output.fields:
            with watch("bound"):
                found = errors.estimator(delivered.continuous)
            delivered, fields = replace(delivered,
                                        discretisation=found), fields.with_error(found.cells)
        with watch("output"):
            return Solution.of(self.config, scene, delivered, fields, setup_sweeps, exact, spent,
                               watch)

    def _undecomposed(self, scene: Scene, code: CodeSettings) -> Reference:
        check_reference(scene)
        self.told.stage("solving undecomposed")
        with self.watch("reference"), make_blackbox(code) as whole:
            return solve_reference(scene, whole)

    def _delivered(self, part: RankPart, codes: Sequence[CodeSettings], placement: Placement,
                   errors: WholeErrors,
                   forces: ForceProbes) -> tuple[Delivered, float, list[Spent] | None]:
        """Return what this rank's part delivers, back-substitutions in set-up, and on rank 0 what
        all have spent.
        """
        team, method, watch, cases = self.ranks.team, self.config.method, self.watch, errors.cases
        workers = max(code.workers for code in codes)
        with watch("soles"):
            soles = make_soles_of(part, method, placement.touched)
        self.told.stage("assembling and factorising")
        check_iterations(len(cases.chosen), part.scene, method)
        with watch("start"):
            blackbox = SharedModels(self.ranks.codes(codes, placement.codes),
                                    method.skip.congruent, workers, len(cases.chosen))
        self.told.working(blackbox.usage)
        with blackbox:
            check_codes(codes, placement.codes, blackbox, method, self.reference, team)
            workload = Workload(blackbox.usage, watch, team)
            d = prepare(part, soles, method, blackbox, watch)
            del soles  # with the models made of them, what set-up has held and nothing else needs
            trim()
            blackbox.ready()
            workload.end("set_up")
            chosen = cases.part_of(d)
            iterated = iterate(chosen, method, [OnRanks(self.told.all, numbers_of(chosen), team)],
                               watch, Start.handed_out(self.start, chosen),
                               [int(step) + 1 for step in cases.chosen],
                               errors.given(self.reference))
            workload.end("iterations")
            trim()
            delivered = deliver(d, cases, iterated, watch, forces)
            spent = team.gather(Spent.of(blackbox.usage, placement.codes, workload.record, workers,
                                         errors.asked))
        return delivered, d.made.sweeps, spent


def solve(config: Config, scene: Scene | None = None, subscribers: Sequence[Subscriber] = (), *,
          reference: bool = False,
          start: Start | None = None, watch: Stopwatch | None = None,
          ranks: Ranks = Ranks()) -> Solution | None:
    """Solve a problem; nothing is written.

    scene : default: ``scene_of`` the configuration, also where sides that slid are paired anew
        (``pairing: auto``); on a scene that is given pairs stay as they are
    subscribers : told what goes on
    reference : also solve undecomposed, and follow the true error; with perfect interfaces only
    start : where an earlier run stood, to resume from
    watch : where seconds are counted
    ranks : that solve it together; each calls this. Rank 0 alone has the scene, and hands out its
        parts. Only it gets the solution, and only its subscribers see whole states
    Returns the solution, converged or not, on rank 0; None on others
    Raises InputError: the problem cannot be solved, or a code is not there
    Raises BlackBoxError: a code fails, hangs or answers nonsense

    Examples
    --------
    A bar of length 4 and modulus 200e3, pulled by 10 per unit area: it grows by 4 · 10 / 200e3.

    >>> from orchestrator import config_from, solve
    >>> config = config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}},
    ...     "materials": [{"young": 200e3, "poisson": 0.0}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
    ...                  {"on": "xmax", "traction": [10, 0, 0]}]})
    >>> solution = solve(config, reference=True)
    >>> solution.converged, solution.summary["true_error"] <= solution.error_bound <= 1e-6
    (True, True)
    >>> solution.displacement.shape    # load steps, nodes, components
    (1, 81, 3)
    >>> moved, held = solution.displacement[0, :, 0].max(), solution.reactions[0, 0, 0]
    >>> print(f"{moved:.7f}, held by {held:.6f}")
    0.0002000, held by -10.000000
    """
    told, watch, team = Subscribers(subscribers), watch or Stopwatch(), ranks.team
    try:
        if config.method.accuracy is not None:
            raise wrong(("method", "accuracy"), "accuracy where one mesh is solved on",
                        "orchestrator run, which solves on several", "remove accuracy here")
        if not all(entry.kind.perfect for entry in config.interfaces):
            check_there("numba")  # before the time it takes to mesh
        if anew := team.share(scene is None):
            scene = None if team.rank else scene_of(config, told, watch)
        with by_keys():
            solution = OneSolution(config, told, start, watch, ranks, reference).of(scene)
    except BaseException as error:  # whatever it is, history and checkpoint are worth keeping
        told.failed(team.cause(error))
        raise
    if not anew or team.size > 1:
        return solution
    return solved_anew(config, solution, subscribers, watch, ranks)


def solved_anew(config: Config, first: Solution, subscribers: Sequence[Subscriber],
                watch: Stopwatch, ranks: Ranks, meshed: Meshed | None = None) -> Solution:
    """Return a first solution, or the one with sides paired anew that have slid, see
    ``paired_anew``; the other ranks ``run.follow``. Parameters as for ``solve`` and ``scene_of``.
    """
    # what is kept to go on from is of the first run: its traces are others
    told = [each for each in subscribers if not each.wants_checkpoints]

    def again(config: Config, scene: Scene, start: Start) -> Solution:
        ranks.team.share((config, False))
        return solve(config, scene, told, start=start, watch=watch, ranks=ranks)

    return paired_anew(config, first,
                       lambda config: scene_of(config, Subscribers(subscribers), watch, meshed,
                                               "pairing sides anew"), again)


def scene_of(config: Config, told: Subscribers, watch: Stopwatch, meshed: Meshed | None = None,
             stage: str = "meshing") -> Scene:
    """Return the scene of a configuration, programs started, after a look whether its code is
    there; subscribers are told.

    meshed : as of ``build_scene``
    Raises InputError: as ``build_scene``, or a code is not there
    """
    told.stage(stage)
    with watch("mesh"):
        # a code that all subdomains need: before the time it takes to mesh
        if len(config.codes) == 1:
            find_codes(config.codes, run_programs=False)
        scene = build_scene(config, run_programs=True, meshed=meshed or Meshed().once)
        trim()
    told.made(scene)
    return scene

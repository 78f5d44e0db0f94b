"""One solution of a scene, on one rank or several: hand out parts, set them up, iterate, deliver,
summarise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import SharedModels
from orchestrator.blackbox.start import make_blackbox, with_own_loads
from orchestrator.config.blackbox import CodeSettings
from orchestrator.config.model import Config
from orchestrator.method.checkpoint import Start, numbers_of
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.deliver import Delivered, deliver
from orchestrator.method.delivery.flux import ForceProbes
from orchestrator.method.delivery.reference import DiscretisationEstimate, Reference, TrueError, check_reference, solve_reference
from orchestrator.method.events import Subscribers
from orchestrator.method.increments import check_iterations, iterate
from orchestrator.method.iterated import Iterated, LoadCases, load_cases
from orchestrator.method.setup import make_soles_of, RankPart, prepare
from orchestrator.parallel.placement import Placement, ranks_of, with_workers
from orchestrator.parallel.team import ALONE, Team
from orchestrator.processes import trim
from orchestrator.refused import check_codes
from orchestrator.results.ranks import OnRanks, interfaces_of_all
from orchestrator.results.fields.fields import Fields
from orchestrator.results.solution import Solution, unsound
from orchestrator.results.summary.workload import Spent, Workload
from orchestrator.scene.model import Scene
from orchestrator.timing import Savings, Stopwatch


@dataclass(frozen=True)
class Ranks:
    """Ranks that solve a problem together.

    codes : what makes a black box for each of them
    """

    team: Team = ALONE
    codes: Callable[[Sequence[CodeSettings], Sequence[int]], BlackBox] = make_blackbox


class Solving:
    """One solution; every rank has its own.

    whole : the scene, on rank 0
    rank_of : (subdomains,) int
    exact : the undecomposed solution, on rank 0 where it is asked for
    """

    def __init__(self, config: Config, scene: Scene | None, told: Subscribers, start: Start | None,
                 watch: Stopwatch, ranks: Ranks, reference: bool):
        self.config, self.told, self.start, self.watch, self.ranks = config, told, start, watch, ranks
        team, self.codes = ranks.team, with_workers(config.codes, ranks.team)
        self.whole = None if scene is None else with_own_loads(scene, self.codes)
        self.reference, self.exact = reference, self._undecomposed() if reference and not team.rank else None
        self.rank_of: np.ndarray = team.share(None if team.rank
                                              else ranks_of(self.whole, team.size))

    def solution(self) -> Solution | None:
        """Return the solution on rank 0, None elsewhere."""
        team, watch, wanted = self.ranks.team, self.watch, self.config.method.tolerance.error == "auto"
        with watch("parts"):
            part = RankPart.handed_out(self.whole, self.config.method, self.rank_of, team)
        forces = team.share(None if team.rank else ForceProbes.of(self.whole))
        self.forces = forces.of_rank(part.space.subdomains)
        own = [part.scene.subdomains[e] for e in part.space.subdomains]
        self.cases: LoadCases = load_cases(part.scene, self.config.method.skip, own, team)
        self.estimate = DiscretisationEstimate(self.whole, self.cases)
        delivered, setup_sweeps, spent = self._part_solved(part)
        del part, own
        trim()
        interfaces = interfaces_of_all(delivered.interfaces, team)
        if team.rank:
            return None
        lost = unsound(self.whole, spent)
        with watch("output"):
            delivered = delivered.told(self.whole, interfaces, lost, self.forces.within)
            fields = Fields.of(self.whole, delivered.displacement, delivered.sides,
                               delivered.interfaces, lost)
        if wanted or self.config.output.fields:
            with watch("bound"):
                found = self.estimate.estimator(delivered.continuous)
            delivered, fields = replace(delivered,
                                        discretisation=found), fields.with_error(found.cells)
        with watch("output"):
            return Solution.of(self.config, self.whole, delivered, fields, setup_sweeps, self.exact,
                               spent, watch)

    def _undecomposed(self) -> Reference:
        check_reference(self.whole)
        self.told.stage("solving undecomposed")
        with self.watch("reference"), make_blackbox(self.codes[0]) as whole:
            return solve_reference(self.whole, whole)

    def _part_solved(self, part: RankPart) -> tuple[Delivered, float, list[Spent] | None]:
        """Return what this rank's part delivers, back-substitutions in set-up, and on rank 0 what
        all have spent.
        """
        team, method, watch, savings = self.ranks.team, self.config.method, self.watch, Savings()
        placement, workers = Placement.of(part.scene, self.rank_of,
                                          team), max(code.workers for code in self.codes)
        if team.rank == 0:
            savings.add(self.cases.switch, "load steps", self.cases.left_out)
        with watch("soles"):
            soles = make_soles_of(part, method, placement.touched)
        self.told.stage("assembling and factorising")
        check_iterations(len(self.cases.chosen), part.scene.bonded, method,
                         part.scene.remembers or any(i.follows for i in part.scene.interfaces))
        with watch("start"):
            blackbox = SharedModels(self.ranks.codes(self.codes, placement.codes), method.skip,
                                    workers, len(self.cases.chosen), savings)
        self.told.working(blackbox.usage)
        with blackbox:
            check_codes(self.codes, placement.codes, blackbox, method, self.reference, team)
            workload = Workload(blackbox.usage, watch, team)
            d = prepare(part, soles, method, blackbox, watch, savings)
            del soles  # with the models made of them, what set-up has held and nothing else needs
            trim()
            workload.end("set_up")
            chosen = self.cases.part_of(d)
            true_error = TrueError(chosen, self.whole, self.cases, self.exact,
                                   watch) if self.reference else None
            iterated = self._iterated(chosen, {"true_error": true_error, "estimate": self.estimate})
            if d.all_perfect and team.rank == 0:
                savings.add("bound", "evaluations of the bound's second part",
                            sum(math.isnan(event.error_bound) for event in iterated.history))
            workload.end("iterations")
            trim()
            if d.nonlinear is not None:
                d = chosen = chosen.reloaded()
                # under the pseudo-loads that matter has by now
                iterated = replace(iterated, bound=d.bounded(iterated.fields))
            delivered = deliver(d, chosen, self.cases, iterated, watch, self.forces)
            spent = team.gather(Spent.of(blackbox.usage, placement.codes, workload.record, workers,
                                         savings,
                                         true_error.asked if true_error else 0.0))
        return delivered, d.made.sweeps, spent

    def _iterated(self, chosen: Decomposition, monitors: dict[str, object]) -> Iterated:
        """Iterate from where the run begins; ``monitors``: what some of them are given."""
        told = OnRanks(self.told.all, numbers_of(chosen), self.ranks.team)
        return iterate(chosen, self.config.method, [told], self.watch,
                       Start.handed_out(self.start, chosen),
                       [int(step) + 1 for step in self.cases.chosen], monitors)

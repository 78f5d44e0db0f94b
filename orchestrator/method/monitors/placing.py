"""Whether subdomains are to be placed on the ranks anew: where one rank's codes take much longer than those of the mean rank.

Predicted cost says who gets what, see ``parallel.placement``. Where the machine says otherwise, for whatever reason (a slower
node, another program on it, a prediction that is wrong), the run stops after an iteration, all is set up again on ranks whose
share is their measured speed, and goes on where it stood, as resumed runs do. That is once, and only where the seconds saved in
the iterations to come outweigh those of a set-up: factors are made anew on every rank. Each rank counts with the least seconds that a
request has taken it: what else the machine does for a moment makes some of them longer, what makes a rank slow makes all.

Every rank knows all ranks' seconds, and all decide alike.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.parallel.team import Team
from orchestrator.timing import STAGES

IMBALANCE = 1.3  # seconds of the slowest rank over the mean
LEAST = 3  # requests before that is judged
NOTICED = 1.0  # seconds that are to be saved at least: below that the clock tells noise
CERTAIN = 1.0  # times the set-up's seconds that are to be saved


class Unbalanced(Exception):
    """The run is to go on with subdomains placed by the ranks' speeds (ranks,), shares of 1; on all ranks at once."""

    def __init__(self, speeds: np.ndarray, imbalance: float, iteration: int):
        super().__init__(f"the slowest rank's codes took {imbalance:.1f} times as long as the mean")
        self.speeds, self.imbalance, self.iteration = speeds, imbalance, iteration


class Placing(Monitor):
    """What the ranks' codes take, iteration by iteration.

    team : the ranks
    busy : seconds so far in which this rank's codes were at work
    load : predicted cost of its subdomains
    set_up : seconds that its set-up took
    possible : on rank 0, whether what has been done so far can be gone on from
    """

    name = "placing"

    def __init__(self, team: Team, busy: Callable[[], float], load: float, set_up: float, possible: Callable[[], bool] | None):
        self._team, self._busy, self._load, self._set_up, self._possible = team, busy, load, set_up, possible
        self._before, self._requests, self._least = busy(), 0, np.inf

    @classmethod
    def of(cls, case: Case) -> Placing | None:
        return case.given.get("placing")

    def judge(self, now: Evaluation) -> Verdict:
        """After an iteration that is not the last.

        Raises Unbalanced: it pays to place anew
        """
        if now.verdict.reason:
            return Verdict()
        self._requests += 1
        table, before = np.zeros((4, self._team.size)), self._before  # this rank's column
        self._before = self._busy()
        if self._before > before:  # a state of zeros asks for nothing
            self._least = min(self._least, self._before - before)
        sound = self._possible is not None and self._possible()
        table[:, self._team.rank] = self._least if np.isfinite(self._least) else 0.0, self._load, self._set_up, sound
        busy, load, set_up, sound = self._team.sum(table)[0]
        if self._requests < LEAST or not sound.any() or busy.min() <= 0 or busy.max() <= IMBALANCE * busy.mean():
            return Verdict()
        speeds = load / busy
        gain = (busy.max() - load.sum() / speeds.sum()) * max(STAGES - self._requests, self._requests + 1)
        if gain > max(NOTICED, CERTAIN * set_up.max()):
            raise Unbalanced(speeds / speeds.sum(), float(busy.max() / busy.mean()), now.number)
        return Verdict()

"""Where iterations begin, if not at the beginning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.refusal import Refusal
from orchestrator.method.memory import COMMON, Memory, Numbers


@dataclass(frozen=True)
class Start:
    """Where iterations begin: from a state, or exactly where an earlier run stood.

    Parameters
    ----------
    state : (T, D) s; None: zero, and in batches of load steps the last state of the batch before
    iteration, sweeps : done so far, set-up not counted
    seconds : spent so far
    ended : the last iteration of each batch of load steps that is done
    latest : the latest iterations of the batch under way, as many as have to be known to go on after the last
    before : of the iterations, those that ``max_iterations`` does not count; None: all
    """

    state: np.ndarray | None = None
    iteration: int = 0
    sweeps: float = 0.0
    seconds: float = 0.0
    ended: Sequence[Memory] = ()
    latest: Sequence[Memory] = ()
    before: int | None = None

    @staticmethod
    def handed_out(start: Start | None, d: Decomposition, numbers: Numbers) -> Start:
        """A rank's part of what rank 0 knows of the whole scene.

        Parameters
        ----------
        start : on rank 0; None: the beginning
        numbers : which columns of the whole scene's arrays are this rank's

        Raises
        ------
        Refusal : it does not fit to the decomposition
        """
        team = d.space.team
        everyone = team.gather(numbers)
        if start is None and not team.rank:
            start = Start()
        if start is not None:
            start._check(d.steps, everyone)
            if team.size == 1:
                return start
        return team.hand_out(lambda rank: start._of_rank(everyone[rank]))

    def _of_rank(self, numbers: Numbers) -> Start:
        """The columns that are a rank's."""
        return replace(self, state=None if self.state is None else self.state[:, numbers["trace"]],
                       ended=[m.of_rank(numbers) for m in self.ended], latest=[m.of_rank(numbers) for m in self.latest])

    def _check(self, steps: int, everyone: Sequence[Numbers]) -> None:
        """Shapes and values.

        Parameters
        ----------
        steps : load steps that are solved
        everyone : per rank, its columns

        Raises
        ------
        Refusal : an array has another shape, or values that are no numbers
        """
        totals = {kind: 1 + max(int(numbers[kind].max(initial=-1)) for numbers in everyone) for kind in everyone[0]}
        given = [(m.iteration, m.arrays) for m in (*self.ended, *self.latest)]
        if self.state is not None:
            given.append((self.iteration, {"trace/state": self.state}))
        for iteration, arrays in given:
            for name, array in arrays.items():
                kind = name.partition("/")[0]
                wrong = None
                if array.ndim != (1 if name.startswith("common/factorised") else 2):
                    wrong = f"{array.ndim} dimensions"
                elif kind != COMMON and array.shape[1] != totals[kind] or name == "trace/state" and len(array) != steps:
                    wrong = f"shape {array.shape} where there are {totals[kind]:,} columns"
                elif kind != "interface" and not np.isfinite(array).all():
                    wrong = "values that are not finite"
                if wrong:
                    raise Refusal("another start", iteration=iteration, name=name, wrong=wrong)


def numbers_of(d: Decomposition) -> Numbers:
    """Which columns of the whole scene's arrays are this rank's."""
    none = np.empty(0, dtype=int)
    return {"trace": d.space.link.number, "boundary": d.space.link.boundary_number,
            "macro": none if d.stage.macro is None else d.stage.macro.number,
            "interface": none if d.coarse is None else d.coarse.interfaces}

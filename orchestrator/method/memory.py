"""What has to be known of an iteration to go on after it as if nothing had happened.

Every part of the method that has a memory (acceleration, coarse problem, criterion, ending) tells what its last step
has added, and takes back what it once told. ``Memory`` carries that, of one iteration; arrays are named after how they
are numbered, ``kind/name``:

- ``trace``, ``boundary``  (T, D) and (T, B), the columns as in ``TraceSpace``;
- ``macro``                (T, size), the columns as in ``Macro``; several ranks may have the same ones;
- ``interface``            (T, I), a column per interface;
- ``common``               the same on all ranks, or known on rank 0 alone.

Among ranks each has its own columns; what is kept has those of the whole scene, so that a run may go on with
another number of ranks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

INTERVAL = 8  # iterations after which the memory is told as a whole, not only what has been added
COMMON = "common"
MONITOR = "monitor."  # name of a monitor's array, behind its kind: needed at the end of an increment, too
# kind → number of each of this rank's columns in the whole scene
Numbers = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Memory:
    """What one iteration has added.

    Parameters
    ----------
    iteration : linear stages after set-up
    batch : of load steps, which one
    back : how many iterations, this one included, have to be known to go on after it
    arrays : ``kind/name`` → array; not to be changed
    notes : numbers, texts and lists of these, by the part of the method that they belong to
    """

    iteration: int
    batch: int
    back: int
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ended(self) -> bool:
        """Whether it was the last iteration of its batch: its fields are among the arrays."""
        return self.notes.get("reason") is not None

    def of_rank(self, numbers: Numbers) -> Memory:
        """One rank's columns of what is known of the whole scene."""
        return self._with({name: array if kind == COMMON else array[:, numbers[kind]]
                           for name, kind, array in self._kinds()})

    def of_all(self, whole: Mapping[str, np.ndarray]) -> Memory:
        """With the whole scene's columns of its ``spread``, on rank 0."""
        return self._with(dict(self.arrays) | dict(whole))

    @property
    def spread(self) -> dict[str, np.ndarray]:
        """The arrays of which every rank has some columns."""
        return {name: array for name, kind, array in self._kinds() if kind != COMMON}

    def _kinds(self) -> list[tuple[str, str, np.ndarray]]:
        return [(name, name.partition("/")[0], array) for name, array in self.arrays.items()]

    def _with(self, arrays: Mapping[str, np.ndarray]) -> Memory:
        return Memory(self.iteration, self.batch, self.back, arrays, self.notes)

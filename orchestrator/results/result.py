"""One run as one object: summary, history and fields, to and from the files of its folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.npz import read_npz, write_npz
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.subscribers.history import read_history, write_history
from orchestrator.results.summary.summary import read_summary, write_summary


@dataclass(frozen=True)
class Result:
    """What a run has found.

    Parameters
    ----------
    summary : as in summary.json
    history : column of history.csv → (iterations,) array
    fields : displacements on the undecomposed mesh, None if none were asked for
    directory : the folder it was read from or written to

    Examples
    --------
    >>> result = Result.read("results/traction_beam")            # doctest: +SKIP
    >>> result.history["error_bound"][-1], result.displacement   # doctest: +SKIP
    """

    summary: dict[str, object]
    history: dict[str, np.ndarray]
    fields: Fields | None = None
    directory: Path | None = None

    @classmethod
    def read(cls, directory: str | os.PathLike[str]) -> Result:
        """Reads a results folder.

        Raises
        ------
        InputError : missing folder, or not one that a run has written
        """
        summary = read_summary(directory)  # first: its message says best what is wrong with a foreign folder
        return cls(summary, read_history(directory), read_npz(directory), Path(directory))

    def write(self, directory: str | os.PathLike[str]) -> Path:
        """Writes summary.json, history.csv and fields.npz; ``read`` gives the same object back."""
        folder = ResultsFolder(directory)
        write_history(folder, self.history)
        if self.fields is not None:
            write_npz(folder, self.fields)
        write_summary(folder, self.summary)
        return folder.path

    @property
    def converged(self) -> bool:
        return bool(self.summary["converged"])

    @property
    def iterations(self) -> int:
        return int(self.summary["iterations"])

    @property
    def displacement(self) -> np.ndarray | None:
        """(steps, n, 3) in the node order of the input mesh; None without fields."""
        return None if self.fields is None else self.fields.displacement

    def __repr__(self) -> str:
        state = "converged" if self.converged else f"stopped ({self.summary.get('stop_reason')})"
        bound = self.summary.get("error_bound")
        tail = "" if bound is None else f", error bound {bound:.1e}"
        return f"Result({self.summary.get('name')}: {state} after {self.iterations} iterations{tail})"

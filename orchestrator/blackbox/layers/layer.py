"""A black box around another one: what it does not do itself is left to the inner one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox, Model, Traits
from orchestrator.blackbox.usage import Usage


class Layer:
    """Base of layers: keeps the protocol of ``protocol.BlackBox`` by asking the inner black box.

    Parameters
    ----------
    inner : a black box, itself a layer perhaps
    """

    def __init__(self, inner: BlackBox):
        self.inner = inner

    def load(self, models: Sequence[Model]) -> None:
        """As the protocol says."""
        self.inner.load(models)

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        return self.inner.traces(forces)

    def all_traces(self, forces: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Answers (rows, B) to trace forces (rows, B) of all subdomains at once, side by side; zero for other columns.

        Parameters
        ----------
        parts : per subdomain, its columns
        """
        asked = {e: np.ascontiguousarray(forces[:, part]) for e, part in enumerate(parts) if part.stop > part.start}
        result = np.zeros(forces.shape)
        for e, answer in self.traces(asked).items():
            result[:, parts[e]] = answer
        return result

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        return self.inner.fields(forces)

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        """As the protocol says."""
        return self.inner.stiffness(models)

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """As the protocol says."""
        return self.inner.advance(forces, commit)

    def traits(self, code: int = 0) -> Traits:
        """As the protocol says."""
        return self.inner.traits(code)

    def close(self) -> None:
        """As the protocol says."""
        self.inner.close()

    @property
    def usage(self) -> Usage:
        """That of the inner black box: a layer has no process of its own."""
        return self.inner.usage

    def __enter__(self) -> Self:
        self.inner.__enter__()
        return self

    def __exit__(self, *exc) -> None:
        self.inner.__exit__(*exc)

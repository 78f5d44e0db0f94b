"""A black box that several runs use, one after the other: what a run asks again that the one before has asked is there.

Processes stay, and so do models and their factors where all models of a run are those of the run before, to the last byte: runs that
differ in loads, bolts' forces, gaps or friction then share everything that a code has made. Nonlinear models remember load steps: they
are made anew for every run.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config.blackbox import CodeSettings


class KeptCodes:
    """Makes black boxes, as ``make_blackbox`` does, but lends the last one again where the same codes are asked for.

    To be ended after the last run, and after a run that has failed: nobody knows what its codes are in the middle of.
    """

    def __init__(self) -> None:
        self._asked: tuple[list[CodeSettings], list[int]] | None = None
        self._box: KeptBlackBox | None = None

    def __call__(self, settings: Sequence[CodeSettings], used: Iterable[int]) -> BlackBox:
        """A black box for one run; raises as ``make_blackbox`` does."""
        asked = list(settings), sorted(set(used))
        if self._box is None or self._asked != asked:
            self.end()
            self._box, self._asked = KeptBlackBox(make_blackbox(*asked)), asked
        self._box.begin()
        return self._box

    def end(self) -> None:
        """End all processes; may be called twice."""
        if self._box is not None:
            self._box.end()
        self._box = None


class KeptBlackBox(BlackBox):
    """Loads nothing and assembles nothing that it had for the run before.

    inner : the pool, or what guards it
    """

    def __init__(self, inner: BlackBox):
        super().__init__(inner)
        self._loaded: list[bytes] = []  # keys of the models that the inner one holds
        self._before: dict[bytes, sp.csr_array] = {}  # stiffness matrices, of the run before
        self._matrices: dict[bytes, sp.csr_array] = {}  # and of this one

    def begin(self) -> None:
        """Another run begins; seconds count from now on."""
        self._before, self._matrices = self._matrices, {}
        self.usage.afresh()

    def load(self, models: Sequence[Model]) -> None:
        keys = [key_of(model) for model in models]
        if keys == self._loaded and not any(self._changes(model) for model in models):
            return
        self._loaded = []
        super().load(models)
        self._loaded = keys

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        keys = [key_of(model) for model in models]
        known = self._before | self._matrices
        new = [i for i, model in enumerate(models) if keys[i] not in known or self._changes(model)]
        known |= zip((keys[i] for i in new), super().stiffness([models[i] for i in new]) if new else ())
        self._matrices |= {key: known[key] for key in keys}
        return [known[key] for key in keys]

    def _changes(self, model: Model) -> bool:
        """Whether it is another one after each run."""
        return self.traits(model.code).nonlinear

    def close(self) -> None:
        """A run has ended; the processes stay until all of them have."""

    def end(self) -> None:
        """End all processes and remove all files."""
        self.inner.close()


def key_of(model: Model) -> bytes:
    """Hash of all that a model is: equal for models that are, to the last byte."""
    digest = hashlib.sha256()

    def take(value: object) -> None:
        if isinstance(value, np.ndarray):
            digest.update(f"{value.dtype}{value.shape}".encode())
            digest.update(np.ascontiguousarray(value).data)
        elif is_dataclass(value):
            for field in fields(value):
                take(getattr(value, field.name))
        else:
            digest.update(f"{value!r};".encode())

    take(model)
    return digest.digest()

"""What the orchestrator asks of a finite element code, and nothing more.

A black box receives meshes with materials and clamped dofs, and answers nodal forces with
nodal displacements. It never hears of interfaces, search directions or macro problems: a
sole is plain matter to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.usage import Usage


@dataclass(frozen=True)
class Origin:
    """What a model is in the user's mesh. It refers to the scene's arrays and copies none.

    Parameters
    ----------
    nodes : (b,) int, numbers in the user's mesh of the model's first nodes; −1, and those after them: soles'
    cells : (c,) int, numbers there of its first tets; −1, and those after them: soles'
    volume : (all tets of the mesh,) int, index into ``volumes``
    volumes : names of volumes
    """

    nodes: np.ndarray
    cells: np.ndarray
    volume: np.ndarray
    volumes: Sequence[str]

    def arrays(self, nodes: int, cells: int) -> dict[str, np.ndarray]:
        """Of a model with so many nodes and tets: ``number`` (n,) of each node in the user's mesh and ``volume`` (m,)
        of each tet, −1 for soles; ``sole`` (m,) bool; ``volumes``, names."""
        number, volume = np.full(nodes, -1), np.full(cells, -1)
        number[: len(self.nodes)] = self.nodes
        volume[: len(self.cells)] = np.where(self.cells >= 0, self.volume[self.cells], -1)
        return {"number": number, "volume": volume, "sole": volume < 0, "volumes": np.array(list(self.volumes), dtype=str)}


    @staticmethod
    def side_by_side(models: Sequence[Model]) -> Origin | None:
        """That of one model that holds all these, in order."""
        known = [model.origin for model in models if model.origin is not None]
        if not known:
            return None
        nodes, cells = [], []
        for model in models:
            for numbers, of_origin, count in ((nodes, "nodes", len(model.nodes)), (cells, "cells", len(model.cells))):
                own = getattr(model.origin, of_origin) if model.origin is not None else np.empty(0, int)
                numbers += [own, np.full(count - len(own), -1)]
        return Origin(np.concatenate(nodes), np.concatenate(cells), known[0].volume, known[0].volumes)


@dataclass
class Model:
    """A finite element model as plain data. Dof = 3 * node + component.

    Parameters
    ----------
    name : for messages and logs
    nodes : (n, 3) float
    cells : (m, 4 or 10) int, positively oriented tets; with ten nodes, those in the middle of the edges 01, 12, 02,
        03, 13, 23 come last (VTK's order)
    region : (m,) int, index into ``materials``
    materials : (r, 2) float, Young's modulus and Poisson's ratio of each region
    fixed : (n, 3) bool, dofs clamped to zero
    trace : (t,) int, dofs on which traces are exchanged; none of them fixed, no repetition
    code : which black box of the configuration it is for, where there are several
    origin : what it is in the user's mesh; None: nothing but a sole, or several models in one
    """

    name: str
    nodes: np.ndarray
    cells: np.ndarray
    region: np.ndarray
    materials: np.ndarray
    fixed: np.ndarray
    trace: np.ndarray
    code: int = 0
    origin: Origin | None = None


@dataclass(frozen=True)
class Traits:
    """What may be relied on with a code, and what not.

    Parameters
    ----------
    translation_invariant : its answers depend neither on where a model is nor on its name, so that one model may
        answer for others that differ by a translation
    own_matter : its material is its own, not ``Model.materials``: nothing is known of its stiffness but that it is
        symmetric and vanishes on rigid motions
    keeps_models : answers come from factors that it holds, many models in one process
    floor : relative error, in energy, that its own matrices' digits leave whatever is done with them
    nonlinear : its models answer ``advance`` otherwise than their elastic stiffness does, and remember load steps
    """

    translation_invariant: bool = False
    own_matter: bool = False
    keeps_models: bool = True
    floor: float = 0.0
    nonlinear: bool = False


@runtime_checkable
class BlackBox(Protocol):
    """A pool of finite element processes that hosts many models and keeps all cores busy.

    All methods raise BlackBoxError when the code fails, hangs or answers nonsense.
    Used as a context manager: leaving the block ends every process and removes every file.
    """

    def load(self, models: Sequence[Model]) -> None:
        """Assemble and factorise every model; model i is known as ``i`` from then on, those before are forgotten."""

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Back-substitutions on trace dofs: model → (rhs, t) nodal forces, to the (rhs, t) displacements there."""

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Back-substitutions on all dofs: model → (rhs, 3n) nodal forces, to the (rhs, 3n) displacements.

        Forces on clamped dofs are ignored.
        """

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        """Stiffness matrices (3n, 3n) of models, symmetric, without regard to ``fixed`` or ``trace``."""

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """What nonlinear models truly do from the end of the last committed load step.

        Parameters
        ----------
        forces : model → (3n,) nodal forces on free dofs, prescribed displacements on those that are clamped
        commit : this is the end of the load step, which the next one starts from

        Returns
        -------
        model → (2, 3n): displacements u, and K u − r, K being the elastic stiffness and r the forces that u needs
        """

    def traits(self, code: int = 0) -> Traits:
        """What may be relied on with the code of the models whose ``Model.code`` it is."""

    def close(self) -> None:
        """End all processes and remove all files; may be called twice."""

    @property
    def usage(self) -> Usage:
        """What it has taken of the machine so far."""

    def __enter__(self) -> "BlackBox": ...

    def __exit__(self, *exc) -> None: ...

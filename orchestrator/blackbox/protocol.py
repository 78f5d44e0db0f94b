"""The protocol: all that the orchestrator asks of a finite element code.

A black box receives meshes with materials and clamped dofs, and answers nodal forces with nodal
displacements. It never hears of interfaces, search directions or macro problems: a sole is plain
matter to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.blackbox.usage import Usage

if TYPE_CHECKING:
    import scipy.sparse as sp


@dataclass(frozen=True)
class Origin:
    """A model's place in the user's mesh. It refers to the scene's arrays and copies none.

    nodes : (b,) int, numbers in the user's mesh of the model's first nodes; −1, and those after
        them: soles'
    cells : (c,) int, numbers there of its first tets; −1, and those after them: soles'
    volume : (all tets of the mesh,) int, index into ``volumes``, names
    """

    nodes: np.ndarray
    cells: np.ndarray
    volume: np.ndarray
    volumes: Sequence[str]

    def arrays(self, nodes: int, cells: int) -> dict[str, np.ndarray]:
        """Arrays of a model with so many nodes and tets: ``number`` (n,) of each node in the user's
        mesh and ``volume`` (m,)
        of each tet, −1 for soles; ``sole`` (m,) bool; ``volumes``, names."""
        number, volume = np.full(nodes, -1), np.full(cells, -1)
        number[: len(self.nodes)] = self.nodes
        volume[: len(self.cells)] = np.where(self.cells >= 0, self.volume[self.cells], -1)
        return {"number": number, "volume": volume, "sole": volume < 0,
                "volumes": np.array(list(self.volumes), str)}


@dataclass
class Model:
    """A finite element model as plain data. Dof = 3 * node + component.

    name : for messages and logs
    nodes : (n, 3) float
    cells : (m, 4 or 10) int, positively oriented tets; with ten nodes, those in the middle of the
        edges 01, 12, 02, 03, 13, 23 come last (VTK's order)
    region : (m,) int, index into ``materials``
    materials : (r, 2) float, Young's modulus and Poisson's ratio of each region
    fixed : (n, 3) bool, dofs clamped to zero
    trace : (t,) int, dofs on which traces are exchanged; none of them fixed, no repetition
    code : which black box of the configuration it is for, where there are several
    origin : what it is in the user's mesh; None: nothing but a sole
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
    """Properties of a code that may be relied on.

    translation_invariant : its answers depend neither on where a model is nor on its name, so that
        one model may answer for others that differ by a translation
    own_matter : its material is its own, not ``Model.materials``: nothing is known of its stiffness
        but that it is symmetric and vanishes on rigid motions
    keeps_models : answers come from factors that it holds, many models in one process
    floor : relative error, in energy, that its own matrices' digits leave whatever is done with
        them
    nonlinear : its models answer ``advance`` otherwise than their elastic stiffness does, and
        remember load steps
    """

    translation_invariant: bool = False
    own_matter: bool = False
    keeps_models: bool = True
    floor: float = 0.0
    nonlinear: bool = False


class BlackBox:
    """A pool of finite element processes that hosts many models and keeps all cores busy, or a
    layer around an inner one, itself a layer
    perhaps, to which it leaves what it does not do itself. All methods raise BlackBoxError when the
    code fails, hangs or answers nonsense.
    Used as a context manager: leaving the block ends every process and removes every file."""

    def __init__(self, inner: BlackBox):
        self.inner = inner

    @cached_property
    def usage(self) -> Usage:
        """The share of the machine that it has taken so far."""
        return self.inner.usage

    @property
    def key(self) -> bytes:
        """Tells apart what is loaded, see ``kept``; of one that serves several runs alone."""
        return self.inner.key

    def load(self, models: Sequence[Model]) -> None:
        """Assemble and factorise every model; model i is known as ``i`` from then on, those before
        are forgotten.
        """
        self.inner.load(models)

    def ready(self) -> None:
        """Be told that set-up has ended: what is asked from now on is not asked again."""
        self.inner.ready()

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Back-substitutions on trace dofs: model → (rhs, t) nodal forces, to the (rhs, t)
        displacements there.
        """
        return self.inner.traces(forces)

    def all_traces(self, forces: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Answers (rows, B) to trace forces (rows, B) of all subdomains at once, side by side; zero
        for other columns.

        parts : per subdomain, its columns
        """
        asked = {e: np.ascontiguousarray(forces[:, part]) for e, part in enumerate(parts)
                 if part.stop > part.start}
        result = np.zeros(forces.shape)
        for e, answer in self.traces(asked).items():
            result[:, parts[e]] = answer
        return result

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Back-substitutions on all dofs: model → (rhs, 3n) nodal forces, to the (rhs, 3n)
        displacements. Forces on clamped dofs are
        ignored."""
        return self.inner.fields(forces)

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        """Stiffness matrices (3n, 3n) of models, symmetric, without regard to ``fixed`` or
        ``trace``.
        """
        return self.inner.stiffness(models)

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """True response of nonlinear models from the end of the last committed load step.

        forces : model → (3n,) nodal forces on free dofs, prescribed displacements on those that are
            clamped
        commit : this is the end of the load step, which the next one starts from

        Returns model → (2, 3n): displacements u, and K u − r, K being the elastic stiffness and r
        the forces that u needs.
        """
        return self.inner.advance(forces, commit)

    def traits(self, code: int = 0) -> Traits:
        """Properties that may be relied on, of the code of the models whose ``Model.code`` it
        is.
        """
        return self.inner.traits(code)

    def close(self) -> None:
        """End all processes and remove all files; may be called twice."""
        self.inner.close()

    def __enter__(self) -> BlackBox:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

"""Models that a black box is tried with, and the answers that it should give."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.template import Solver
from orchestrator.blackbox.codes.adapter import AGREE, diagnosis, difference
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.scene.mesh.sources import bricks


@dataclass
class Trial:
    """A black box under trial: what it was asked and what it answered.

    models : two bodies of four materials, equal but for where they are held, and two soles: thin
        layers clamped at their outer faces, equal but for their place
    exact : per model, its reference stiffness
    forces : per model (4, t) trace forces
    """

    blackbox: BlackBox
    models: list[Model]
    exact: list[sp.csr_array]
    forces: list[np.ndarray]
    stiffness: list[sp.csr_array] = field(default_factory=list)
    traces: dict[int, np.ndarray] = field(default_factory=dict)

    def first(self, rows: np.ndarray) -> np.ndarray:
        """The black box's answers of the first model to trace forces (rhs, t)."""
        return self.blackbox.traces({0: rows})[0]

    def everywhere(self, index: int) -> np.ndarray:
        """The trace forces among all dofs, (4, 3n)."""
        full = np.zeros((len(self.forces[index]), self.models[index].fixed.size))
        full[:, self.models[index].trace] = self.forces[index]
        return full

    def answers(self, index: int, forces: np.ndarray) -> np.ndarray:
        """(rhs, 3n) displacements that the reference stiffness gives to forces (rhs, 3n)."""
        return Solver().solve(Solver().prepare(self.models[index]), forces)

    def expected(self, index: int) -> np.ndarray:
        """(4, 3n) displacements that it gives to the trace forces."""
        return self.answers(index, self.everywhere(index))

    def wrong(self, what: str, index: int, found: np.ndarray, forces: np.ndarray,
              dofs=slice(None)) -> str:
        """Say what is wrong with displacements of a model; those of another model are told as
        such.
        """
        said = diagnosis(found, self.answers(index, forces)[:, dofs])
        if not said:
            return ""
        name = self.models[index].name
        for other, model in enumerate(self.models):
            if other != index and self.exact[other].shape == self.exact[index].shape:
                if difference(found, self.answers(other, forces)[:, dofs]) <= AGREE:
                    said = (
                        f"those of another model of the same size, the {model.name}: what solve() "
                        "needs belongs to each")
        return f"{what} of the {name}: {said}"


def trial_models() -> list[Model]:
    """Small, distorted, with nothing symmetric in them that could hide a mistake."""
    materials = [[200e3, 0.3], [70e3, 0.2], [1e3, 0.4], [400e3, 0.1]]
    body = _sample("body", [1.0, 0.8, 0.6], [3, 2, 2], materials, 0)
    held = body.fixed.reshape(-1, 3)[::-1].copy()  # the other end, as many dofs
    free = np.flatnonzero(~held)
    twin = replace(body, name="twin body", fixed=held,
                   trace=np.random.default_rng(1).permutation(free)[: len(body.trace)])
    sole = _sample("sole", [1.0, 1.0, 0.05], [3, 3, 1], [[100e3, 0.25]], 2)
    return [body, twin, sole,
            replace(sole, name="second sole", nodes=sole.nodes + [2.0, -1.0, 0.5])]


def _sample(name: str, size: list[float], cells: list[int], materials: list[list[float]],
            axis: int) -> Model:
    """A distorted box clamped at its end along an axis; traces on half of the other dofs, in no
    order.
    """
    mesh, rng = bricks(np.array(size), np.array(cells), name), np.random.default_rng(axis)
    step = np.array(size) / np.array(cells)
    nodes = mesh.nodes + rng.uniform(-0.12, 0.12, mesh.nodes.shape) * step
    fixed = np.repeat(np.isclose(mesh.nodes[:, axis], 0.0)[:, None], 3, axis=1)
    fixed[-1, 1] = True  # one component alone
    free = np.flatnonzero(~fixed)
    region = np.arange(len(mesh.cells)) * 5 // 3 % len(materials)
    return Model(name, nodes, mesh.cells, region, np.array(materials), fixed,
                 rng.permutation(free)[: len(free) // 2])

"""Guard around a code: its matrices and its fields must be those of the matter that it was given.

- a stiffness K is symmetric, vanishes on rigid motions, and answers the uniform strains with the
forces of the model's
  mesh and moduli, node by node (the patch test), which is their exact energy too;
- displacements u under forces f hold K u = f on all free dofs, with K u from the mesh and the
moduli.

Where a code's matter is its own, what is known of the stiffness is symmetry and rigid motions
alone; that its answers fit its stiffness is then tested by its own server.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models import Matter
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.errors import BlackBoxError
from orchestrator.scene.mesh.geometry import format_point

# Relative, see ``patch_errors`` and ``imbalance``. Measured on all hard cases: below 2e-15 through
# FreeFEM, scikit-fem
# and by hand, below 1e-13 through CalculiX, whose decks have 14 digits. Answers of six digits stay
# below 1e-5; what
# that leaves of a result is part of its bound.
PATCH, BALANCED = 1e-8, 1e-5
DIGITS = 1e-13  # of coordinates, in decks


class GuardedCode(BlackBox):
    """A code's black box whose stiffness matrices and fields are judged where they arrive.

    Raises BlackBoxError, naming the model, for what its matter cannot have answered.

    inner : the pool
    codes : ``Model.code`` of those to judge; default all
    """

    def __init__(self, inner: BlackBox, codes: Collection[int] | None = None):
        super().__init__(inner)
        self.codes, self._models = codes, []

    def load(self, models: Sequence[Model]) -> None:
        """Load models; of every model that the code keeps, the answer to one load is judged, all
        being there. It costs one
        back-substitution per model, and finds a code that mixes up its models."""
        super().load(models)
        self._models = list(models)
        random = np.random.default_rng(len(models))
        forces = {i: np.where(m.fixed.ravel(), 0.0, random.uniform(0.5, 1.0, (1, m.fixed.size)))
                  for i, m in enumerate(models) if self._known(m) and not m.fixed.all()}
        if forces := {i: f for i, f in forces.items()
                      if self.inner.traits(models[i].code).keeps_models}:
            self.fields(forces)

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        answers = super().fields(forces)
        asked = [i for i, u in answers.items() if len(u) and self._known(self._models[i])]
        for i, (left, node) in zip(asked,
                                   _threads().map(
                                       lambda i: imbalance(self._models[i], answers[i],
                                                           np.asarray(forces[i])), asked)):
            model = self._models[i]
            if not left <= BALANCED:
                raise BlackBoxError(
                    "guard: displacements that do not balance the forces: near "
                    f"{format_point(model.nodes[node])} a share of {left:.1e} is left over, "
                    f"{BALANCED:.0e} allowed (its materials, units or models are mixed up, or its "
                    f"answers have few digits; {OWN})", model.name)
        return answers

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        matrices = super().stiffness(models)
        judged = [i for i, model in enumerate(models) if self._judges(model)]
        for i, wrong in zip(judged,
                            _threads().map(
                                lambda i: wrong_stiffness(models[i], matrices[i],
                                                          not self._known(models[i])), judged)):
            if wrong:
                raise BlackBoxError(f"guard: {wrong}", models[i].name)
        return matrices

    def _judges(self, model: Model) -> bool:
        return self.codes is None or model.code in self.codes

    def _known(self, model: Model) -> bool:
        """Whether a model's matter is the YAML's."""
        return self._judges(model) and not self.inner.traits(model.code).own_matter


@cache
def _threads() -> ThreadPoolExecutor:
    """Threads that judge, since the codes' cores have nothing else to do meanwhile. They stay: to
    start them costs more than to judge a
    small model."""
    return ThreadPoolExecutor(len(os.sched_getaffinity(0)), "guard")


OWN = "a solver whose material is its own says so: own_matter = True in its class"


def wrong_stiffness(model: Model, matrix: sp.csr_array, own_matter: bool = False) -> str:
    """Say what is wrong with a stiffness (3n, 3n); empty where nothing is wrong."""
    if matrix.shape != (model.fixed.size,) * 2:
        return f"a stiffness of {matrix.shape} for {model.fixed.size} dofs"
    diagonal = matrix.diagonal()
    if diagonal.min(initial=0.0) < -PATCH * np.abs(diagonal).max(initial=0.0):
        worst = int(np.argmin(diagonal))
        why = "is its modulus below zero somewhere?" if own_matter else f"a wrong sign; {OWN}"
        return (
            "a stiffness that is not positive: to move a node near "
            f"{format_point(model.nodes[worst // 3])} by itself gives energy away, "
            f"{diagonal[worst]:.3g} beside {diagonal.max():.3g} at others ({why})")
    symmetry, rigid, strain, node, allowed = patch_errors(model, matrix, own_matter)
    if not symmetry <= PATCH:
        return f"a stiffness that is not symmetric: |K − Kᵀ| is {symmetry:.1e} |K|"
    if not rigid <= allowed:
        why = (
            " (supports inside it; or a form that is not symmetric in u and v, of which one "
            "triangle is taken)" if own_matter else "")
        return (
            f"a stiffness by which rigid motions cost force: {rigid:.1e} of |K| near "
            f"{format_point(model.nodes[node])}{why}")
    if not strain <= allowed:
        return (
            "a stiffness that is not that of the model's mesh and materials: uniform strains need "
            f"other forces, by {strain:.1e} of |K| near {format_point(model.nodes[node])} (other "
            f"moduli or units, a plane state, an element that fails the patch test; {OWN})")
    return ""


def patch_errors(model: Model, matrix: sp.csr_array,
                 own_matter: bool = False) -> tuple[float, float, float, int, float]:
    """Distance of a stiffness from symmetry, from rest under rigid motions, from the forces of
    uniform strains.

    Each is relative to the row's diagonal entry times the largest displacement. Four columns tell:
    a random translation, rotation and strain, with no component that is small, and displacements at
    random.

    Returns symmetry, rigid, strain : float; strain 0 where the matter is the code's own
    node : where the worst of the last two is
    allowed : ``PATCH``, or what coordinates of few digits leave of thin tets far from the origin
    """
    random = np.random.default_rng(3)
    place = model.nodes - (model.nodes.min(axis=0) + model.nodes.max(axis=0)) / 2
    size = np.abs(place).max(initial=0.0) or 1.0
    place /= size
    ab, ac, bc = random.uniform(0.5, 1.0, 3)
    turn, strain = np.array([[0, -ab, ac], [ab, 0, -bc], [-ac, bc, 0]]), random.uniform(
        0.5, 1.0, (3, 3))
    strain = (strain + strain.T) / 2
    fields = np.empty((model.fixed.size, 4))
    fields[:, 0] = np.resize(random.uniform(0.5, 1.0, 3), len(fields))
    fields[:, 1], fields[:, 2] = (place @ turn.T).ravel(), (place @ strain).ravel()
    fields[:, 3] = _apart_from_zero(random, len(fields))
    found, matter = matrix @ fields, Matter.of(model)
    scale = np.maximum(matrix.diagonal(), np.finfo(float).tiny)
    symmetry = np.abs(found[:, 3] - matrix.T @ fields[:, 3]) / scale
    rigid = np.abs(found[:, :2]).max(axis=1) / scale
    allowed = max(PATCH, DIGITS * float(np.abs(model.nodes).max() * np.abs(matter.slopes).max()))
    strained = np.zeros(len(fields))
    if not own_matter:
        strained = np.abs(found[:, 2] - matter.forces_of_strain(strain) / size) / scale
    worst = rigid if rigid.max(initial=0.0) > allowed else strained
    node = int(np.argmax(worst)) // 3 if len(worst) else 0
    return *(float(x.max(initial=0.0)) for x in (symmetry, rigid, strained)), node, allowed


def _apart_from_zero(random: np.random.Generator, count: int) -> np.ndarray:
    """Random numbers of either sign between a half and one."""
    return random.uniform(0.5, 1.0, count) * random.choice([-1.0, 1.0], count)


def imbalance(model: Model, u: np.ndarray, forces: np.ndarray) -> tuple[float, int]:
    """The share of forces (rhs, 3n) that displacements (rhs, 3n) leave unbalanced on free dofs, and
    its node. Returns largest |K u −
    f| / √d over the largest √d |u|, d being the nodes' own stiffness: rounding of a factorisation
    leaves equal shares of that everywhere,
    however different the moduli; of rows in a random combination"""
    matter = Matter.of(model)
    free = ~model.fixed.ravel()
    root = np.sqrt(np.repeat(matter.stiff, 3))
    size = (root * np.abs(u)).max(axis=1, initial=0.0)
    # all rows in one: what is wrong in any of them is wrong in a random combination
    weight = _apart_from_zero(np.random.default_rng(len(u)), len(u)) if len(u) > 1 else np.ones(1)
    weight = (weight / np.where(size > 0, size, 1.0))[None]
    left = np.abs(matter.forces(weight @ u) - weight @ forces)[0]
    left = np.where(free, left, 0.0) / np.where(root > 0, root, 1.0)
    return float(left.max(initial=0.0)), int(np.argmax(left)) // 3 if len(left) else 0

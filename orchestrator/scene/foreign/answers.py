"""A program's answers to unit forces, from which its stiffness follows.

With springs k on the joints, that hold it whatever holds it inside, it answers

    u = (S + k)⁻¹ (b_t + s)

Unit forces give C = (S + k)⁻¹, so that S = C⁻¹ − k; its own loads with no other force give b_t =
C⁻¹ u_t. k follows S: as large as its mean diagonal, few digits are lost in the difference. What is
asked besides tells whether it is such a program.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.scene.foreign.joints import Joints
from orchestrator.scene.foreign.program import ProgramRuns

# Relative. A factorisation repeats itself to rounding, and superposes to it; text of 9 digits
# leaves 1e-9.
REPEATED, LINEAR, RECIPROCAL = 1e-12, 1e-7, 1e-6
# Springs over the mean diagonal of S: outside this range digits are lost, and all is asked once
# more with other springs.
SUITED, ATTEMPTS = (1e-3, 1e3), 4


@dataclass(frozen=True)
class UnitAnswers:
    """A program's answers to unit forces.

    springs : (3n,) k that were added
    compliance, inverse : (3n, 3n) C = (S + k)⁻¹, symmetric, and S + k
    asymmetry : |C − Cᵀ| / |C| as it came
    """

    springs: np.ndarray
    compliance: np.ndarray
    inverse: np.ndarray
    asymmetry: float

    @property
    def stiffness(self) -> np.ndarray:
        """(3n, 3n) S."""
        return self.inverse - np.diag(self.springs)

    @cached_property
    def digits(self) -> float:
        """Relative error of C's entries as they were written; 0 where they are all that doubles
        have.
        """
        return _digits(self.compliance[np.triu_indices(len(self.compliance))])

    @property
    def error(self) -> np.ndarray | None:
        """(3n, 3n) a sample of what S may be off by, −C⁻¹ E C⁻¹ for errors E of random signs; None
        where no digits are missing.
        """
        if not self.digits:
            return None
        upper = np.triu(self.digits * self.compliance
                        * np.random.default_rng(1).uniform(-1, 1, self.compliance.shape))
        return self.inverse @ (upper + upper.T - np.diag(upper.diagonal())) @ self.inverse

    @classmethod
    def of(cls, runs: ProgramRuns, joints: Joints, spring: float) -> UnitAnswers:
        """Answers of a program that is asked now.

        spring : a first guess of k
        Raises InputError: it is not linear, elastic, positive and repeatable
        """
        k = np.full(joints.points.size, spring)
        for _ in range(ATTEMPTS):
            compliance, asymmetry = _compliance(runs, joints, k)
            values, vectors = np.linalg.eigh(compliance)
            if not values[0] > 0:
                raise runs.wrong(
                    "a force moves its joint backwards: the least eigenvalue of its compliance is "
                    f"{values[0] / values[-1]:.1e} of the largest",
                    "a stiffness with the springs of springs.txt on its diagonal, which is "
                    "positive",
                                 "look for signs, for springs that are not added, and for joint "
                                 "nodes that are held inside: leave these out of the joint")
            answers = cls(k, compliance, (vectors / values) @ vectors.T, asymmetry)
            wanted = float(np.abs(np.diag(answers.stiffness)).mean()) or spring
            if SUITED[0] * wanted <= k[0] <= SUITED[1] * wanted:
                break
            k = np.full(len(k), wanted)
        return answers


def _compliance(runs: ProgramRuns, joints: Joints, k: np.ndarray) -> tuple[np.ndarray, float]:
    """(3n, 3n) answers to unit forces, symmetric, and how far they are from it as they come."""
    n = len(k)
    random = np.random.default_rng(n)
    probe = random.uniform(0.5, 1.0, n) * random.choice([-1.0, 1.0], n)
    asked = np.vstack([np.eye(n), probe, 2 * probe, np.zeros(n)])
    found = runs.displacements(joints.ids, k, [0] * len(asked), asked)
    C, once, twice, nothing = found[:n], found[n], found[n + 1], found[n + 2]
    again = runs.displacements(joints.ids, k, [0], probe[None])[0]
    size = np.abs(once).max()
    if not size > 0:
        raise runs.wrong("forces on its joint do not move it", "displacements of the joint nodes",
                         "add the forces of forces.txt to the right-hand side")
    if np.abs(nothing).max() > LINEAR * size:
        raise runs.wrong(f"without any load its joint moves by {np.abs(nothing).max():.3g}",
                         "its own loads in cases whose first line is not 0, and in those "
                         "alone", "leave them out where own is 0")
    if np.abs(again - once).max() > max(REPEATED, 100 * _digits(once)) * size:
        raise runs.wrong(
            "the same forces are answered otherwise the second time: "
            f"{np.abs(again - once).max() / size:.1e}",
                         "answers that depend on the files alone",
            "look for what it remembers or takes at random, and for cases whose results are added "
            "to the next")
    left = max(np.abs(twice - 2 * once).max(), np.abs(probe @ C - once).max())
    if left > LINEAR * size:
        raise runs.wrong(f"twice the force is not twice the displacement: {left / size:.1e}",
                         "answers proportional to forces",
                         "leave contact, large displacements and matter that flows out")
    apart = float(np.abs(C - C.T).max() / np.abs(C).max())
    if apart > RECIPROCAL:
        raise runs.wrong(
            "answers that are not reciprocal: what a force at one node moves another by differs "
            f"from the reverse by {apart:.1e}", "a symmetric stiffness",
            "look for forces and displacements of different nodes or axes, and for matrices of "
            "which one triangle is missing")
    return (C + C.T) / 2, apart


def _digits(values: np.ndarray) -> float:
    """Relative error of values that have been written with few digits: 0 with fifteen or more."""
    for digits in range(4, 15):
        if all(float(f"{value:.{digits - 1}e}") == value for value in values.ravel()[:200]):
            return 0.5 * 10.0 ** (1 - digits)
    return 0.0

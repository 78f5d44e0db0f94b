"""A CalculiX deck as a part: included as it is, run a few times at the start, then algebra.

- its stiffness K, which CalculiX stores, condensed to the joints: S;
- for each file of loads a static run with grounded springs k on the joints: u₀, so that b = (S + k)
u₀ whatever the loads are
  (heat, pressure, prescribed displacements);
- one more with forces s on the joints besides: (S + k) u = b + s tells whether the deck is as
linear as its matrix.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from orchestrator.blackbox.codes.parts import ForeignCode, OwnFields
from orchestrator.scene.foreign.condensed import Condensed, condense, judged
from orchestrator.blackbox.codes.calculix.deck_runs import DeckRuns, Refused
from orchestrator.errors import BlackBoxError
from orchestrator.folders import temporary
from orchestrator.scene.foreign.joints import Joints, read_joints

# Relative: input and stored matrix have 14 digits, condensing costs some of them.
LINEAR = 1e-6


class DeckCode(ForeignCode):
    """A part that is a CalculiX deck."""

    def made(self) -> Condensed:
        part, path, name = self.settings.part, self.settings.place, self.settings.name
        joints = read_joints(part, path, name)
        with self._runs(joints) as runs:
            try:
                return self._made(runs)
            except Refused as error:
                raise self.wrong("calculix", f"'{name}': {error}", "a deck that CalculiX runs",
                                 "run it alone, with ccx, until it does") from error

    def _made(self, runs: DeckRuns) -> Condensed:
        part, path = self.settings.part, self.settings.place
        name, joints = self.settings.name, runs.joints
        K, active = runs.stored()
        dofs = (3 * (joints.ids[:, None] - 1) + np.arange(3)).ravel()
        free = np.flatnonzero(~joints.held.ravel())
        order = np.argsort(active)
        at = np.minimum(np.searchsorted(active[order], dofs[free]), len(active) - 1)
        lost = free[active[order][at] != dofs[free]]
        if len(lost):
            raise self.wrong("joints",
                             f"'{name}': {len(lost)} dofs of joint nodes depend on others "
                             "(*EQUATION, *MPC, *TIE, *RIGID BODY, shells, beams), the first is "
                             f"{'xyz'[lost[0] % 3]} of node {joints.ids[lost[0] // 3]}",
                             "joint nodes whose displacements are unknowns of their own",
                             "make the joint's nodes the independent side of the tie or equation, "
                             "or take other nodes for the joint")
        S = np.zeros((len(dofs), len(dofs)))
        # the probe tells
        S[np.ix_(free, free)] = condense(K, np.zeros((1, K.shape[0])), order[at], path, name,
                                         loose=True)[0]
        part_on_joints = judged(joints, S, np.zeros((1, len(dofs))), (*path, "calculix"), name)
        k = springs_of(S, free)
        M = S + np.diag(k)
        steps = len(self.settings.factors)
        if part.loads and len(part.loads) not in (1, steps):
            raise self.wrong("loads", f"{len(part.loads)} files of loads for {steps} load steps",
                             "one file for all load steps, or one for each",
                             "let history multiply a single one")
        b = np.array([M @ runs.static(k, case) for case in runs.cases]) if part.loads else np.zeros(
            (1, len(dofs)))
        b[:, joints.held.ravel()] = 0.0
        for own, case in zip(b, runs.cases or [None]):
            self._probe(runs, M, k, own, case)
        return Condensed(joints, part_on_joints.stiffness, b, part_on_joints.error)

    @contextmanager
    def _runs(self, joints: Joints) -> Iterator[DeckRuns]:
        with temporary() as folder:
            yield DeckRuns(self.settings.part, self.settings.place, joints, folder)

    def own_fields(self, u: np.ndarray, force: np.ndarray) -> OwnFields:
        """Fields on the deck's own mesh, see ``ForeignCode``: S u − b act on its joints, and
        springs k on them are held by k u. What loads inside do and what the joints do are
        superposed: a run for each file of loads, and one for each load step.
        """
        part, joints, steps = self.condensed(), self.condensed().joints, len(u)
        k = springs_of(part.stiffness, part.free)
        force = (u.reshape(steps, -1) @ part.stiffness - self.loads()).reshape(u.shape)
        asked = [force[t].ravel() + k * u[t].ravel() for t in range(steps)]
        with self._runs(joints) as runs:
            ids, points, blocks = runs.deck.ids, runs.deck.points, runs.deck.solids()
            own = [runs.everywhere(k, case) for case in runs.cases]
            found = np.stack([runs.everywhere(k, None, one * (k > 0)) for one in asked])
            for t, factor in enumerate(self.settings.factors if own else ()):
                found[t] += factor * own[t if len(own) > 1 else 0]
        left, size = np.abs(found[:, joints.ids - 1] - u)[:,
                                                          ~joints.held].max(), np.abs(
                                                              found[:, ids - 1]).max()
        if not left <= LINEAR * size:
            raise BlackBoxError(
                f"its last run moves the joints otherwise than the result, by {left / size:.1e} of "
                "the largest displacement: initial stresses, or a deck that has changed since",
                self.settings.name)
        forces = np.zeros((steps, len(ids), 3))
        forces[:, np.searchsorted(ids, joints.ids)] = force
        return OwnFields(self.settings.name, points, blocks, found[:, ids - 1], forces)

    def _probe(self, runs: DeckRuns, M: np.ndarray, k: np.ndarray, b: np.ndarray,
               case: Path | None) -> None:
        """Raises InputError where under a case of its loads, b on the joints, forces there do not
        move them as the stored matrix says.
        """
        free = np.flatnonzero(k)
        s = np.zeros(len(k))
        # as large as the loads, or such that displacements are a thousandth of the part
        size = max(float(np.abs(b).max(initial=0.0)), 1e-3 * runs.joints.size * float(k.max()))
        s[free] = size * np.random.default_rng(2).uniform(-1, 1, len(free))
        u = runs.static(k, case, s)
        left = np.abs(M @ u - b - s)[free].max() / (np.abs(M @ u)[free].max() or 1.0)
        if not left <= LINEAR:
            raise self.wrong("calculix",
                             f"'{self.settings.name}': forces on its joints do not move them as "
                             f"its stiffness says: {left:.1e} of the force is left, {LINEAR:.0e} "
                             "allowed",
                             "a linear deck, whose stiffness does not depend on its loads",
                             "look for contact, gaps, *TRANSFORM on joints, and moduli that depend "
                             "on temperature: with its loads the deck is another than without"
                             + ("" if case is None else f" ({case})"))


def springs_of(S: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(3n,) grounded springs on a part's joints: as stiff as it is, on average; none where it is
    held.
    """
    k = np.zeros(len(S))
    k[free] = np.diag(S)[free].mean()
    return k

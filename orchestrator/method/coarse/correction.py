"""Correction by the coarse contact problem: every body moves in its affine, or its rigid, fields
under the true laws, one that bends in its own softest modes (``soft_bodies``).

The slow tail of the fixed point is the motion of whole bodies against each other. It is removed by
a small nonlinear problem solved after every linear stage: each subdomain's state may change by
s += V y with n = 12 affine fields, or the 6 rigid ones among them, whose response is known from
set-up,

    U = N R,   V = k U,   W = N M⁻¹NᵀV,   F = V − k W

and y makes the forces agree with the laws on these fields, load step after load step:

    ρ(y) = Uᵀ(f + F y) − Σ_pairs Tᵀ law(F₀ + L y) = 0,     T = [U₁, −U₂]
    L = [½F₁ − keq W₁, −½F₂ + keq W₂],   F₀ as in the local stage

A few linearised steps (``linear_step``) do in nearly all iterations. The nonlinear problem is
solved (``problem``) in the first one, and later in those load steps alone where linear steps do not
bring ρ to a tenth. U is made orthonormal in k. It costs no back-substitution per iteration.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy

import numpy as np

from orchestrator.method.coarse.linear_step import LinearSteps, NodeStep
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.coarse.problem import CoarseProblem, of_all
from orchestrator.method.coarse.responses import Responses, per_body
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.local_stage import LawStage
from orchestrator.scene.conditions.supports import loose_bodies
from orchestrator.scene.model import Scene

AFFINE = 12  # fields of a body: 1, x, y and z in each component
# combinations (12, n) of the affine fields, which are monomials outside and components inside, that
# a body may move in: six rigid motions,
# then six strains
_TURNS, _STRAINS = np.zeros((AFFINE, 3)), np.zeros((AFFINE, 6))
for _turn, (_i, _j) in enumerate(((1, 2), (2, 0), (0, 1))):
    _TURNS[3 * (1 + _i) + _j, _turn], _TURNS[3 * (1 + _j) + _i, _turn] = 1.0, -1.0
    _STRAINS[[3 * (1 + _i) + _j, 3 * (1 + _j) + _i], 3 + _turn] = 1.0
    _STRAINS[3 * (1 + _turn) + _turn, _turn] = 1.0
_RIGID = np.hstack([np.eye(AFFINE, 3), _TURNS])
FIELDS = {"rigid": _RIGID, **dict.fromkeys(("auto", "affine"), np.hstack([_RIGID, _STRAINS]))}
# Longest move of a loose body in one Newton step, over the largest displacement at the start, where
# no springs stabilise contacts. How far
# others go their supports say.
REACH = 0.3
MATRIX = "common/coarse."  # and a load step: an array of checkpoints


class CoarseCorrection:
    """The coarse contact problem of one decomposition.

    scene : for the coordinates
    stage : linear stage; solves the fields of every body once
    pairs : node pairs of all interfaces, perfect ones included
    kind : "affine", 12 fields per body, as "auto" is, or "rigid", 6
    anew : whether springs of stabilisation begin anew in every iteration, see ``stabilisation``
    modes : place among the rank's ``space.subdomains`` → (t, m) displacements of its boundary dofs,
        the fields of a body that has softer ones; see ``soft_bodies``
    problem : the contact problem of one load step
    """

    def __init__(self, scene: Scene, stage: LinearStage, pairs: Pairs, kind: str,
                 modes: Mapping[int, np.ndarray] | None = None,
                 anew: bool = False):
        self.stage, self.pairs, self.anew = stage, pairs, anew
        space = stage.space
        self.bodies, self.parts = len(scene.subdomains), space.parts
        response = Responses.of(stage, *self._fields(scene, FIELDS[kind], modes or {}))
        # the first: rigid motions, or softest modes
        self.half = len(response.U) // 2 if FIELDS[kind].shape[1] == AFFINE else 0
        self.response, self.everywhere = response, space.extended(response.W, response.F)
        # ghosts come last: own parts need no room of their own
        response.W, response.F = (x[:, : space.size] for x in self.everywhere)
        K0, each = per_body(space, response.U, response.F), np.arange(len(response.U))
        dropped = np.array([~response.U[:, part].any(axis=1) for part in self.parts])
        K0[:, each, each] += dropped  # fields a body lacks stay at rest
        self.K0 = self._of_all(K0)
        self.problem = self._problem(pairs)
        self.prescribed, = space.team.max(
            max(np.abs(scene.subdomains[e].prescribed).max(initial=0.0) for e in space.subdomains))
        self.radius: float | None = None
        self.loose, self.begun, self._steps = loose_bodies(scene), False, None
        self.matrices: dict[int, np.ndarray] = {}  # of the linear steps, load step by load step

    @property
    def sweeps(self) -> int:
        """Back-substitutions per subdomain at set-up."""
        return len(self.response.U)

    def paired(self, pairs: Pairs) -> CoarseCorrection:
        """The same for sides that have been paired anew: what the bodies answer stays."""
        result = copy(self)
        result.pairs, result.problem = pairs, self._problem(pairs)
        result.problem.restore(self.problem.state())
        return result

    def _problem(self, pairs: Pairs) -> CoarseProblem:
        everywhere, = self.stage.space.extended(self.response.U)
        T = _at_points([pairs.transfer.first(everywhere), -pairs.transfer.second(everywhere)])
        fields = PairFields.of(pairs, T,
                               _at_points(map(pairs.masked, pairs.responses(*self.everywhere)),
                                          np.float32), self.bodies)
        return CoarseProblem(self.stage.space.team, self.stage.space.subdomains, fields, self.K0,
                             [self.response.W[:, part].T for part in self.parts], self.half)

    def start_from(self, local: LawStage) -> None:
        """Take over the jumps that a local stage starts from; perfect interfaces have none."""
        steps = self.pairs.at_steps_of(local.pairs)
        # perfect ones come last
        self.predict = LawStage(self.stage.direction, steps, local.before.among(len(self.pairs)))
        self.local, self.begun = local, False

    def __call__(self, fields: Admissible) -> Admissible:
        """Corrected admissible fields.

        fields : result of a linear stage
        """
        if not self.radius and self.pairs.stabilisation is None:
            moved = max(self.stage.space.team.max(np.abs(fields.w).max(initial=0.0))[0],
                        self.prescribed)
            if moved == 0:  # nothing but laws asks for anything: a jump, the force of a bolt
                moved = self.stage.space.team.max(
                    np.abs(self.predict(fields).jump).max(initial=0.0))[0]
            self.radius = REACH * moved
        (y, from_y), r, space = self._solved(fields), self.response, self.stage.space
        s, u = self._moved(fields.s, y, r.V, space.owner), self._moved(fields.u, y, r.u, r.body)
        # ghosts move with their own bodies, whose fields all ranks know
        w, f = (self._moved(x, y, response, space.owner)
                for x, response in zip(fields.extended, self.everywhere))
        anchor = self._moved(fields.extended[0], from_y, self.everywhere[0],
                             space.owner) if self.anew else None
        return Admissible.of_extended(s, u, fields.alpha, w, f, space, anchor)

    def weakened(self, share: float) -> CoarseCorrection:
        """The same with springs of stabilisation of that share of ε."""
        result = copy(self)
        result.pairs = self.pairs.weakened(share)
        result.problem = self.problem.weakened(result.pairs)
        return result

    @property
    def steps(self) -> LinearSteps:
        """The linear steps with the local stage's groups; all ranks ask together."""
        groups, bodies = self.local.groups, self.problem.bodies
        if (
            self._steps is None
            or self._steps.bodies is not bodies
            or self._steps.groups is not groups
        ):
            self.matrices = self.matrices if self._steps is None else {}
            self._steps = LinearSteps.of(bodies, groups, self.response, self.matrices)
        return self._steps

    def _solved(self, fields: Admissible) -> tuple[np.ndarray, np.ndarray]:
        """(T, bodies, n) y, and the y where springs that begin anew carry nothing: linear steps,
        and the nonlinear problem in the load steps where these do not do.
        """
        resultant, at = self._of_all(self._resultants(fields.f)).swapaxes(0, 1), self.pairs.traces(
            *fields.extended)
        F0, local, before = at.predicted(), self.local, self.predict.before
        y, from_y = np.zeros((2, *resultant.shape))
        nodes, _ = local.meeting(*fields.extended,
                                 at.jump[:, :, : len(local.pairs)] if self.anew else None)
        for t, number in enumerate(self.predict.pairs.numbers):
            anchor = at.jump[t] if self.anew else before.jump
            step = NodeStep(self.steps, t, number, F0[t], resultant[t], before, anchor, nodes)
            taken = step.taken() if self.begun else 0
            if taken:
                self.problem.newton_steps += taken
                self.problem.ended(t, "tolerance", np.linalg.norm(step.rho), step.start)
                y[t] = from_y[t] = step.y
            else:
                y[t], from_y[t] = self._placed((t, number, F0[t], resultant[t], before), anchor)
                step.residual(y[t])
            before = step.after
            if nodes is not None:
                nodes.before = nodes.after
        self.begun = True
        return y, from_y

    def _placed(self, given: tuple[int, int, np.ndarray, np.ndarray, History],
                anchor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, n) y of the nonlinear problem of a load step, and that where springs carried
        nothing."""
        if self.anew:
            return self.problem.rest(*given, anchor)
        radius = None if self.radius is None else np.where(self.loose, self.radius, np.inf)
        return self.problem.solve(*given, radius)[0], np.zeros_like(given[3])

    @staticmethod
    def _moved(at: np.ndarray, y: np.ndarray, response: np.ndarray, body: np.ndarray) -> np.ndarray:
        """at (T, n) with what fields y (T, bodies, n) add, whose response (n, D) is that of each
        column's own body.
        """
        result, starts = at.copy(), np.flatnonzero(np.diff(body, prepend=-1))
        for a, b in zip(starts, [*starts[1:], len(body)]):
            result[:, a:b] += y[:, body[a]] @ response[:, a:b]
        return result

    def state(self) -> dict[str, object]:
        """Return what a resumed run has to know."""
        matrices = {f"{MATRIX}{t}": x for t, x in self.matrices.items()}
        return {"radius": self.radius, "begun": self.begun, **matrices, **self.problem.state()}

    def restore(self, state: Mapping[str, object]) -> None:
        """Take ``state`` back."""
        self.problem.restore(state)
        self.radius, self.begun = state["radius"], state["begun"]
        self.matrices, self._steps = {int(name.removeprefix(MATRIX)): x for name, x in state.items()
                                      if name.startswith(MATRIX)}, None

    def _fields(self, scene: Scene, allowed: np.ndarray,
                modes: Mapping[int, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """(m, D) fields, and (own bodies, m, n) combinations of them that each may move in.

        allowed : (12, n) the same of affine fields
        """
        space = self.stage.space
        most, = space.team.max(max((mode.shape[1] for mode in modes.values()), default=0))
        count, width = max(int(most), AFFINE), max(int(most), allowed.shape[1])
        fields, combined = np.zeros((count, space.size)), np.zeros((count, width))
        fields[:AFFINE], combined[:AFFINE,
                                  : allowed.shape[1]] = _affine_fields(
                                      scene, space, self.parts), allowed
        bent = space.trace(space.side_by_side(modes, int(most)))
        for e in modes:
            fields[:, self.parts[e]] = 0.0
            fields[: len(bent), self.parts[e]] = bent[:, self.parts[e]]
        each = np.repeat(combined[None], len(self.parts), axis=0)
        each[list(modes)] = np.eye(count, width)
        return fields, each

    def _resultants(self, f: np.ndarray) -> np.ndarray:
        """(own bodies, T, n) Uᵀf."""
        return np.stack([f[:, part] @ self.response.U[:, part].T for part in self.parts])

    def _of_all(self, own: np.ndarray) -> np.ndarray:
        """(bodies, …) from what each rank knows of its own bodies."""
        return of_all(self.stage.space.team, self.bodies, self.stage.space.subdomains, own)


def _at_points(sides: Iterable[np.ndarray], kind: type = float) -> np.ndarray:
    """(P, 3, 2n) what fields of the first body and of the second do, (n, 3, P) each."""
    return np.concatenate([side.transpose(2, 1, 0).astype(kind, order="C") for side in sides],
                          axis=2)


def _affine_fields(scene: Scene, space: TraceSpace, parts: list[slice]) -> np.ndarray:
    """(12, D) fields of a rank's bodies, whose trace dofs are the ``parts``: translations, and
    gradients about the body's centre
    scaled by its size; field 3m + c is monomial m in component c.

    Held dofs are no exception: they do not move, but their force answers a change of s and has to
    agree with the laws as well.
    """
    fields = np.zeros((AFFINE, space.size))
    for part in parts:
        dof, rows = space.dof[part], np.arange(part.start, part.stop)
        if not len(dof):
            continue
        x = scene.mesh.nodes[dof // 3]
        x = x - (x.min(axis=0) + x.max(axis=0)) / 2
        x /= max(np.abs(x).max(), np.finfo(float).tiny)
        for m, monomial in enumerate([np.ones(len(x)), *x.T]):
            fields[3 * m + dof % 3, rows] = monomial
    return fields

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

A few steps with all pairs answering together where they share nodes do in nearly all iterations,
with springs ε in the matrix alone, of which nothing is left at the end. Where they do not bring ρ
to a tenth, and in the first iteration, bodies are on their way to places that no such steps find.
There pairs answer alone, and springs of stabilisation give every body a place, however far. U is
made orthonormal in k. It costs no back-substitution per iteration.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from orchestrator.method.coarse.load_step import Bodies, LoadStep
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.coarse.responses import Responses, per_body
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.point_traces import PointTraces
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.local_stage import LawStage
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
SPRINGS = 1e-3  # ε of steps together; ten times more or less makes two iterations of a hundred
# ‖ρ‖ left over that at the start, which need not be less than the iteration needs that it serves,
# and steps at most: together, and alone, where it pays to find a place
TOGETHER, ALONE = (0.1, 4), (1e-5, 60)


@dataclass
class Solves:
    """Solves of load steps so far.

    newton_steps : Newton steps of all bodies
    ends : how solves have ended → how many: "tolerance", or why not there: "steps" (as many as are
        allowed), "no direction" (whatever the shift)
    left : per load step, ‖ρ‖ that its last solve left, over that at its start
    """

    newton_steps: int = 0
    ends: dict[str, int] = field(default_factory=dict)
    left: dict[int, float] = field(default_factory=dict)

    def add(self, step: LoadStep, place: int, end: str) -> None:
        """Add one, of the load step at a place."""
        self.newton_steps += step.steps
        self.ends[end] = self.ends.get(end, 0) + 1
        self.left[place] = step.size / step.start if step.start > 0 else 0.0

    def state(self) -> dict[str, object]:
        """Return what a resumed run has to know."""
        return {"newton_steps": self.newton_steps, "ends": dict(self.ends)}

    def restore(self, state: Mapping[str, object]) -> None:
        """Take ``state`` back."""
        self.newton_steps, self.ends = state["newton_steps"], dict(state["ends"])


class CoarseCorrection:
    """The coarse contact problem of one decomposition.

    scene : for the coordinates
    stage : linear stage; solves the fields of every body once
    pairs : node pairs of all interfaces, perfect ones included
    kind : "affine", 12 fields per body, as "auto" is, or "rigid", 6
    modes : place among the rank's ``space.subdomains`` → (t, m) displacements of its boundary dofs,
        the fields of a body that has softer ones; see ``soft_bodies``
    solves : of all load steps so far
    """

    def __init__(self, scene: Scene, stage: LinearStage, pairs: Pairs, kind: str,
                 modes: Mapping[int, np.ndarray] | None = None):
        self.stage, self.solves, space = stage, Solves(), stage.space
        self.count, self.parts = len(scene.subdomains), space.parts
        response = Responses.of(stage, *self._fields(scene, FIELDS[kind], modes or {}))
        self.response, self.everywhere = response, space.extended(response.W, response.F)
        # ghosts come last: own parts need no room of their own
        response.W, response.F = (x[:, : space.size] for x in self.everywhere)
        K0, each = per_body(space, response.U, response.F), np.arange(len(response.U))
        dropped = np.array([~response.U[:, part].any(axis=1) for part in self.parts])
        K0[:, each, each] += dropped  # fields a body lacks stay at rest
        self.K0 = space.of_all(K0)
        self._paired(pairs)

    @property
    def sweeps(self) -> int:
        """Back-substitutions per subdomain at set-up."""
        return len(self.response.U)

    def paired(self, pairs: Pairs) -> CoarseCorrection:
        """The same for sides that have been paired anew: what the bodies answer stays."""
        result = copy(self)
        result._paired(pairs)
        return result

    def _paired(self, pairs: Pairs) -> None:
        everywhere, = self.stage.space.extended(self.response.U)
        T = _at_points([pairs.transfer.first(everywhere), -pairs.transfer.second(everywhere)])
        L = _at_points(map(pairs.masked, pairs.responses(*self.everywhere)), np.float32)
        self.pairs, space = pairs, self.stage.space
        self.bodies = Bodies.of(space.team, np.asarray(space.subdomains, int),
                                PairFields.of(pairs, T, L, self.count), self.K0)
        self._known = None

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
        (y, together), r, space = self._solved(fields), self.response, self.stage.space
        s, u = self._moved(fields.s, y, r.V, space.owner), self._moved(fields.u, y, r.u, r.body)
        # ghosts move with their own bodies, whose fields all ranks know
        w, f = (self._moved(x, y, response, space.owner)
                for x, response in zip(fields.extended, self.everywhere))
        # what bodies on their way load tells of those that have no place
        anchor = w if together else fields.extended[0]
        return Admissible.of_extended(s, u, fields.alpha, w, f, space,
                                      anchor if self.local.anew else None)

    @property
    def together(self) -> Bodies:
        """The bodies with pairs that answer in the local stage's groups; all ranks ask."""
        groups = self.local.groups
        if self._known is None or self._known[0] is not groups:
            self._known = groups, self.bodies.together(groups, self.response)
        return self._known[1]

    def _solved(self, fields: Admissible) -> tuple[np.ndarray, bool]:
        """(T, bodies, n) y, and whether pairs have answered together."""
        resultant = self.stage.space.of_all(self._resultants(fields.f)).swapaxes(0, 1)
        at = self.pairs.traces(*fields.extended)
        y = self._stepped(fields, at, resultant, True) if self.begun else None
        self.begun = True
        return (self._stepped(fields, at, resultant, False), False) if y is None else (y, True)

    def _stepped(self, fields: Admissible, at: PointTraces, resultant: np.ndarray,
                 together: bool) -> np.ndarray | None:
        """(T, bodies, n) y with pairs that answer together, or alone; None where the former do not
        do in some load step.
        """
        before, local, y, F0 = self.predict.before, self.local, np.zeros(resultant.shape), \
            at.predicted()
        pairs, bodies, nodes, done = self.pairs, self.bodies, None, []
        springs, (share, most) = pairs.stabilisation, TOGETHER if together else ALONE
        if together:
            nodes, _ = local.meeting(*fields.extended, at.jump[:, :, : len(local.pairs)]
                                     if local.anew else None)
            bodies, springs = self.together, SPRINGS
        for t, number in enumerate(self.predict.pairs.numbers):
            step = LoadStep(bodies, number, F0[t], resultant[t], before,
                            at.jump[t] if local.anew else before.jump,
                            0.0 if springs is None else springs, nodes and (nodes, t))
            done.append((step, t, step.solved(max(share * step.start, step.least), most)))
            if together and done[-1][2] != "tolerance":
                return None
            y[t], before = step.y, step.after
            if nodes is not None:
                nodes.before = nodes.after
        for each in done:
            self.solves.add(*each)
        return y

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
        return {"begun": self.begun, **self.solves.state()}

    def restore(self, state: Mapping[str, object]) -> None:
        """Take ``state`` back."""
        self.solves.restore(state)
        self.begun = state["begun"]

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

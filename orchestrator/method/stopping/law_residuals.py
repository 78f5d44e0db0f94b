"""How well equilibrium and the interface laws, eq. 6, hold together, each relative and
dimensionless.

The linear stage satisfies equilibrium, the local stage the laws; the run has converged when one
set of fields does both. Each measure is taken on the linear stage's fields, which are delivered.

- residual     ‖f − f̂‖ / ‖f‖ in the norm of (k⁺)⁻¹
- imbalance    ‖f₁ + f₂‖ / ‖f‖ in the same norm
- stabilisation ‖f̂ − law(F)‖ / A of the pair where it is largest, over the largest pressure, where
contacts are stabilised
- fixed_point  ‖F(s) − s‖ / ‖F(s)‖ in the same norm, on all interfaces, where matter is nonlinear:
  then nothing else tells whether what was extrapolated from the last true answers is true
- body_residual  the residual of the body where it is largest beside that body's own forces, see
  ``bodies.body_residual``, where laws alone are asked for (``tolerance: {law: …}``)
- the laws' own measures, over powers of the length scale ℓ and of the law's largest pressure

Forces and pressures are compared with the largest there are, or with a small share of k⁺ ℓ where
the interfaces carry next to nothing.

ℓ is how long displacements are that mean something. It comes from what is loaded and held, and from
how far bodies are deformed, never from where a loose body is: that is undetermined, as far away as
it likes, and whatever is measured relative to it is small. A body is what joining laws make one
without the grounds; its displacement is split in the rigid motion that its supports prescribe, a
rigid motion that they leave, and the deformation, the largest displacement of a boundary node that
is left. What the scene was told: per body its largest prescribed displacement and what its loads
alone move it on its soles, M⁻¹f_ext (with what its supports strain), per interface what its law
imposes (a press fit, a jump). The smallest counts, so that a body sent far away says nothing of the
others. It matters where next to nothing is deformed, as where all contacts are open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.laws.base import Stages
from orchestrator.laws.points import norm
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import peak
from orchestrator.method.local_stage import LocalState
from orchestrator.method.stopping.bodies import JoinedBodies, FREE, RIGID
from orchestrator.parallel.team import Team
from orchestrator.scene.conditions.rigid import DISPLACEMENT, ROTATION

ROUNDING = 1e-12  # of the largest length that a scene was told, what counts as none
# Forces are differences of k u: below this share of it they count as none, as where all contacts
# are open.
REST = 1e-4
STABILISATION, FIXED_POINT, OF_BODIES = "stabilisation", "fixed_point", "body_residual"
# residual over what springs carry, from which more iterations do not change what they do
SETTLED = 1e-2


@dataclass(frozen=True)
class Lengths:
    """Lengths that displacements are compared with.

    deformation : largest displacement beside rigid motions
    told : by the loads, supports and laws
    rigid : (bodies, T, 6) rigid motion of each body that its supports leave: of its centre, and its
        rotation times its size
    size : (bodies,) half the diagonal of the box around each
    """

    deformation: float
    told: float
    rigid: np.ndarray
    size: np.ndarray

    @property
    def shift(self) -> np.ndarray:
        """(bodies, T) how far centres have moved, over the diagonal."""
        return np.linalg.norm(self.rigid[..., :3], axis=2) / (2 * self.size[:, None])

    @property
    def turn(self) -> np.ndarray:
        """(bodies, T) by how much bodies have turned, in radians."""
        return np.linalg.norm(self.rigid[..., 3:], axis=2) / self.size[:, None]

    @property
    def excess(self) -> np.ndarray:
        """(bodies, T) both over the largest that count as small displacements."""
        return np.maximum(self.shift / DISPLACEMENT, self.turn / ROTATION)

    @property
    def of_displacements(self) -> float:
        """Return the length that others are divided by."""
        return max(self.deformation, REST * self.told) or 1.0

    @property
    def of_rest(self) -> float:
        """Return the length that makes of stiffnesses forces that count as none."""
        return REST * max(self.deformation, self.told)


class LengthScale(JoinedBodies):
    """The lengths of one decomposition, for some or all of its load steps, and its bodies.

    fit : (bodies, 6, 6) makes of products with all motions the free ones that fit best
    """

    def __init__(self, d: Decomposition):
        super().__init__(d, lambda i: i.law.joins and not i.ground, grounds=True)
        self.carried, self.strained = d.loading.carried, peak(d.loading.strained)
        self.fit = self.loose @ np.linalg.pinv(self.loose.swapaxes(1, 2) @ self.gram @ self.loose,
                                               rcond=FREE,
                                               hermitian=True) @ self.loose.swapaxes(1, 2)
        told = np.zeros((2, self.count))
        for body, part, lift in zip(self.own, self.boundary, d.loading.lift):
            # and what strains its supports: rigid motions are none
            for kind, values in enumerate((lift, d.loading.working[:, part])):
                told[kind, body] = max(told[kind, body], peak(values))
        told = np.concatenate([self.team.max(*told.ravel()),
                               [i.law.imposed for i in d.scene.interfaces]])
        told = told[told > ROUNDING * peak(told)]
        self.told = float(told.min(initial=np.inf)) if len(told) else 0.0

    def __call__(self, u: np.ndarray) -> Lengths:
        """The lengths for displacements (T, B) of the boundary dofs."""
        apart = u - self.carried
        apart = [apart[:, part] for part in self.boundary]
        products = np.zeros((len(self.fit), len(u), RIGID))
        for body, rows, left in zip(self.own, self.motions, apart):
            products[body] += left @ rows
        loose = self.team.sum(products)[0] @ self.fit
        largest = max((peak(left - loose[body] @ rows.T)
                       for body, rows, left in zip(self.own, self.motions, apart)), default=0.0)
        deformation, = self.team.max(np.maximum(largest, self.strained))  # nan stays
        return Lengths(deformation, self.told, loose, self.size)


@dataclass(frozen=True)
class LawResiduals:
    """Equilibrium, and the measures of the scene's laws by name; ``traction`` is what springs of
    stabilisation are compared with.
    """

    residual: float
    imbalance: float
    measures: dict[str, float] = field(default_factory=dict)
    traction: float = float("nan")

    @property
    def largest(self) -> float:
        """Return the largest residual, which the tolerance is compared with; nan if any is."""
        return float(np.max([self.residual, self.imbalance, *self.measures.values()]))

    def and_also(self, name: str, residual: float) -> LawResiduals:
        """The same with another measure: ``FIXED_POINT``, ``OF_BODIES``."""
        return replace(self, measures={**self.measures, name: residual})

    @property
    def springs(self) -> float:
        """Return the share that stabilisation carries; 0 where there is none."""
        return self.measures.get(STABILISATION, 0.0)

    @property
    def largest_other(self) -> float:
        """The largest measure but what stabilisation carries; nan if any is."""
        return replace(self, measures={name: value for name, value in self.measures.items()
                                       if name != STABILISATION}).largest

    def held_by_springs(self, tolerance: float) -> bool:
        """Whether all has settled but for springs that carry more than the tolerance: without them
        there is no balance.
        """
        return self.springs > tolerance and max(self.residual,
                                                self.imbalance) <= SETTLED * self.springs

    @property
    def named(self) -> dict[str, float]:
        """As summary.json has them."""
        return {"law_residual": self.largest, "interface_residual": self.residual,
                "imbalance": self.imbalance, **self.measures}


def law_residuals(parts: Sequence[tuple[Pairs, np.ndarray, np.ndarray, LocalState, History]],
                  lengths: Lengths, team: Team) -> LawResiduals:
    """How well laws hold in all load steps.

    parts : for some load steps each: the pairs, traces w and f (T, D + G) of the linear stage, the
        local stage, and what the step before the first one has left
    lengths : the length scale of these displacements
    team : the ranks over which to sum and to find the largest
    """
    sums, largest = zip(*(_measured(*part) for part in parts))
    sums, largest = team.both([np.sum(sums, axis=0)], np.max(largest, axis=0))
    top, bottom, unbalanced, stiff = sums[0].tolist()
    # the same stiffness in every part
    bottom = max(bottom, stiff / len(parts) * lengths.of_rest**2)
    pairs, ends, measures, traction = parts[0][0], iter(largest), {}, float("nan")
    for law in pairs.laws:  # of measures that laws share, the largest
        rest, pressure = next(ends) * lengths.of_rest, next(ends)
        pressure = max(pressure, rest) or 1.0
        for measure in law.measures:
            value = next(ends) / (lengths.of_displacements**measure.length
                                  * pressure**measure.pressure)
            measures[measure.name] = max(value, measures.get(measure.name, value))
    if pairs.stabilisation is not None:
        springs, carried, rest = ends
        traction = max(carried, rest * lengths.of_rest) or 1.0
        measures[STABILISATION] = springs / traction
    return LawResiduals(_root(top, bottom), _root(unbalanced, bottom), measures, traction)


def _measured(pairs: Pairs, w: np.ndarray, f: np.ndarray, local: LocalState,
              before: History) -> tuple[np.ndarray, list[float]]:
    """This rank's part: squares of residual, force and imbalance, and stiffness; largest values,
    per law its stiffness over area, its pressure and its measures, then of the springs."""
    at, local.at = local.at, None  # it is large
    if at is None or at.w is not w or at.f is not f:
        at = pairs.traces(w, f)
    points, largest = pairs.points, []
    top, bottom, unbalanced = at.squares(local.force)
    # of both sides, in the mean direction
    stiff = 2 * float((points.stiff_n + 2 * points.stiff_t) @ pairs.mine) / 3
    here = {run.law: run for run in pairs.runs}
    for law in pairs.laws:  # stiffness over area, pressure and measures of its pairs
        if law not in here:
            largest += [0.0] * (2 + len(law.measures))
            continue
        part, own = here[law].part, here[law].points
        stages = Stages(at.force[..., part], at.jump[..., part], local.jump[..., part],
                        before.jump[:, part], local.status[:, part],
                        {name: local.own[name][:, part] for name in law.variables})
        each = [(own, stages)] if not own.stepped else [(own.at(number), stages.at(t))
                                                        for t, number in enumerate(pairs.numbers)]
        told = [(pressure, *(values[measure.name] for measure in law.measures))
                for pressure, values in (law.residuals(*x) for x in each)]
        largest += [_largest(own.stiff_n / own.area),
                    *(np.max([_largest(x) for x in same]) for same in zip(*told))]
    if pairs.stabilisation is not None:
        tractions = (norm(x) / points.area for x in (local.force - local.lawful, local.lawful))
        largest += [*map(_largest, tractions), _largest(points.stiff_n / points.area)]
    return np.array([top, bottom, unbalanced, stiff]), largest


def _largest(values: np.ndarray) -> float:
    """At least 0; nan if any is."""
    return float(np.max(values, initial=0.0))


def _root(top: float, bottom: float) -> float:
    return float(np.sqrt(top / bottom)) if bottom > 0 else float(np.sqrt(top))

"""A scene, decomposed and factorised, for all of its load steps or some; ``setup`` makes it."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.coarse.correction import CoarseCorrection
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.loading import Carried, Loading, RimStiffness
from orchestrator.method.linear.stage import Admissible, LinearStage, Nonlinear
from orchestrator.method.local_stage import Exchange, LawStage
from orchestrator.method.stopping.bound import ErrorBound
from orchestrator.method.stopping.certificate import Certificate
from orchestrator.method.stopping.continuity import Continuity
from orchestrator.method.stopping.error_estimate import Judged
from orchestrator.scene.model import Scene, Subdomain


@dataclass(frozen=True)
class Made:
    """Lists of what set-up has made of a rank's subdomains.

    traces : (t,) boundary dofs in local numbering
    node_counts : nodes of the extended mesh
    rims : stiffness of the tets around interface and prescribed nodes
    modes : (3n_E, r) rigid motions that its prescribed dofs leave
    carried : the rigid motions of what is held together, of the whole scene
    sweeps : back-substitutions per subdomain and load step spent so far
    sole_scale : factor on the soles of contact that ``method`` asks for, see ``coarse.sole_scale``
    """

    traces: list[np.ndarray]
    node_counts: list[int]
    rims: list[RimStiffness]
    modes: list[np.ndarray]
    carried: Carried
    sweeps: float
    sole_scale: float = 1.0


@dataclass
class Decomposition:
    """A scene, decomposed and factorised.

    space : numbering, of this rank's part; all lists per subdomain are of its ``subdomains``
    bound : error bound, where all interfaces are perfect
    coarse : coarse contact problem, where some are not
    certificate : the energy error, where some are not and it is asked for
    nonlinear : the subdomains that are; None where none is
    """

    scene: Scene
    space: TraceSpace
    made: Made
    stage: LinearStage
    local: Exchange | LawStage
    bound: ErrorBound | None
    coarse: CoarseCorrection | None
    certificate: Certificate | None = None
    nonlinear: Nonlinear | None = None

    @property
    def loading(self) -> Loading:
        """Answers to the loads alone."""
        return self.stage.loading

    @property
    def blackbox(self) -> BlackBox:
        """The black box that gives all answers."""
        return self.stage.blackbox.inner

    @property
    def all_perfect(self) -> bool:
        """Whether there is no interface but perfect ones, and no subdomain but linear ones: the
        problem is linear.
        """
        return self.bound is not None

    @property
    def own(self) -> list[Subdomain]:
        """The subdomains of this rank."""
        return [self.scene.subdomains[e] for e in self.space.subdomains]

    @property
    def steps(self) -> int:
        """Number of load steps that are solved together."""
        return len(self.loading.boundary)

    @property
    def has_history(self) -> bool:
        """Whether there are laws for which the way to a load counts; all ranks ask."""
        here = any(i.has_history for i in self.scene.interfaces)
        return not self.all_perfect and bool(self.space.team.max(float(here))[0])

    @property
    def path_dependent(self) -> bool:
        """Whether there are several load steps, and their order counts; all ranks ask."""
        return self.steps > 1 and self.has_history

    def corrected(self, fields: Admissible) -> Admissible:
        """Fields of the linear stage with what the coarse contact problem adds to them."""
        return fields if self.coarse is None else self.coarse(fields)

    def bounded(self, fields: Admissible, known: Judged | None = None) -> Judged:
        """Energy, continuity and error bound of fields; where laws are not perfect and none is
        asked for no bound.

        known : what judging has found already, if anything: it costs no back-substitutions then
        """
        if known is not None and np.isfinite(known.relative):
            return known
        if self.all_perfect:
            return self.bound(fields, asked=np.inf)
        if self.certificate is not None and np.isfinite(
            (known := self.certificate(fields)).relative):
            return known
        space = self.space
        delta = Continuity(space, np.ones(len(space.global_dof)))(fields.u, self.loading.known)
        energy, = space.team.sum(self.loading.energy_of(space.loads(self.stage.robin_of(fields)),
                                                        fields.u, space.loads(fields.f)))
        still = np.zeros((len(fields.u), sum(m.shape[1] for m in self.made.modes)))
        if known is not None:  # there are no admissible fields: what is delivered is as it is
            return replace(known, energy=energy, repositioned=still, correction=delta)
        return Judged("", np.nan, np.nan, None, 1.0, np.nan, energy, still, delta)

    def point(self, s: np.ndarray, fields: Admissible) -> Admissible:
        """The point that the acceleration takes in: where matter is nonlinear the state that was
        asked, as what the coarse problem has
        changed is extrapolated."""
        return fields if self.nonlinear is None else replace(fields, s=s)

    def batch(self, steps: slice | np.ndarray, before: History | None = None,
              bound: Judged | None = None) -> Decomposition:
        """The decomposition for some of the load steps.

        before, bound : what the step before has left, and how those before ended; None at the start
        """
        loading = self.loading.batch(steps)
        one = None if self.nonlinear is None else partial(self.nonlinear.put,
                                                          range(self.steps)[steps][0])
        stage = self.stage.under(loading, one)
        local, coarse = copy(self.local), copy(self.coarse)
        if not self.all_perfect:
            local.pairs = local.pairs.batch(steps)
        if before is not None:
            local.before = before
        if coarse is not None:
            coarse.start_from(local)
        certificate = self.certificate and self.certificate.batch(steps, stage, bound)
        bound = self.bound and self.bound.of(stage, steps)
        return replace(self, stage=stage, local=local, coarse=coarse, bound=bound,
                       certificate=certificate)

    def foreseen(self, step: int) -> Decomposition:
        """The decomposition with pseudo-loads of the load step before at this one: as if nothing
        more would flow.
        """
        self.nonlinear.foresee(step)
        return self.reloaded()

    def reloaded(self) -> Decomposition:
        """The decomposition with the loads that the subdomains have by now: pseudo-loads are among
        them where matter is nonlinear.
        """
        if self.nonlinear is None:
            return self
        return replace(self, stage=self.stage.under(self.nonlinear.reload()))

    def meeting(self, pairs: Pairs, coarse: CoarseCorrection | None) -> Decomposition:
        """Return it with other pairs that laws answer for, and the coarse problem of these."""
        local = LawStage(self.stage.direction, pairs, self.local.before)
        if coarse is not None:
            coarse.start_from(local)
        return replace(self, local=local, coarse=coarse)

    def __repr__(self) -> str:
        macro = self.stage.macro
        return (
            f"Decomposition({len(self.scene.subdomains)} subdomains, {len(self.scene.interfaces)} "
            f"interfaces, {self.space.size} trace dofs, {macro.size if macro else 0} macro "
            "unknowns)")

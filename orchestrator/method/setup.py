"""Set-up: a scene in the black box, with everything the iterations need, built once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from orchestrator.blackbox.models import boundary_dofs, extended_model, sides_by_subdomain
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import assembled
from orchestrator.errors import Refusal
from orchestrator.method.coarse.correction import CoarseCorrection
from orchestrator.method.coarse.soft_bodies import soft_bodies
from orchestrator.method.coarse.sole_scale import fitted
from orchestrator.method.decomposition import Decomposition, Made
from orchestrator.method.interface.pairing import make_pairs
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.exchange_by_nodes import NodeExchange
from orchestrator.method.interface.search_direction import (placed_soles, SearchDirection,
                                                            sole_requests)
from orchestrator.method.interface.stabilisation import begin_anew, stabilisation
from orchestrator.method.interface.traces import TraceSpace, per_node
from orchestrator.method.linear.answers import GuardedTraces, check_own_matter, own_stiffness
from orchestrator.method.linear.loading import (
    Carried, apply_loads, assemble_rims, boundary_stiffness)
from orchestrator.method.linear.macro import Macro
from orchestrator.method.linear.macro_by_nodes import NodeMacro
from orchestrator.method.linear.macro_basis import interface_bases
from orchestrator.method.linear.soft_modes import enriched, soft_modes
from orchestrator.method.linear.stage import LinearStage, Nonlinear
from orchestrator.method.local_stage import Exchange, LawStage
from orchestrator.method.stopping.bound import ErrorBound, ROUNDING
from orchestrator.method.stopping.certificate import Certificate, pushed
from orchestrator.method.stopping.convexity import check_convex
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.conditions.rigid import rigid_modes
from orchestrator.scene.model import Scene
from orchestrator.scene.part import overview, part_of
from orchestrator.scene.soles.make import make_soles
from orchestrator.scene.soles.overlap import by_nodes, difficulty
from orchestrator.scene.soles.ring import make_rings
from orchestrator.timing import Stopwatch


@dataclass
class RankPart:
    """A rank's part of a scene; all of it where there is one.

    scene : own subdomains, their interfaces, and of their neighbours what meets these
    space : numbering of its traces
    carried : rigid motions that go with what is prescribed, of the whole scene
    """

    scene: Scene
    space: TraceSpace
    carried: Carried

    @classmethod
    def of(cls, scene: Scene, method, rank_of: np.ndarray | None = None,
           team: Team = ALONE) -> RankPart:
        """Part of a scene: all of it, or a rank's; all ranks ask together.

        method : ``method`` of the configuration
        rank_of : (subdomains,) int, the rank of each; None: all are this one's
        """
        rank_of = np.zeros(len(scene.subdomains), int) if rank_of is None else rank_of
        sides = sides_by_subdomain(scene)
        traces = [boundary_dofs(scene, scene.subdomains[e], sides[e])
                  for e in np.flatnonzero(rank_of == team.rank)]
        space = TraceSpace.of(scene, sides, traces, rank_of, team, by_nodes(scene, method))
        return cls(scene, space, Carried.of(scene, rank_of, team))

    @classmethod
    def handed_out(cls, scene: Scene | None, method, rank_of: np.ndarray, team: Team) -> RankPart:
        """The rank's own part.

        scene : the whole one, on rank 0
        method : ``method`` of the configuration
        rank_of : (subdomains,) int, the rank of each
        """
        if team.size == 1:
            return cls.of(scene, method)
        known = overview(scene) if team.rank == 0 else None
        part = team.hand_out(lambda rank: part_of(scene, np.flatnonzero(rank_of == rank), known))
        return cls.of(part, method, rank_of, team)


def make_soles_of(part: RankPart, method, wanted: Sequence[bool] | None = None) -> Sequence:
    """Soles of a part: per own subdomain its ring, or per interface both sides'.

    method : ``method`` of the configuration
    wanted : per interface, whether sides get soles; None: all do
    """
    if part.space.by_nodes:
        return make_rings(part.scene, part.space.subdomains, method.sole.modulus_ratio)
    return make_soles(part.scene, method.sole, wanted, method.skip.congruent)


def prepare(part: RankPart, soles: Sequence, method, blackbox: BlackBox,
            watch: Stopwatch) -> Decomposition:
    """Load the extended subdomains into the black box and build what the iterations need.

    part : a rank's part of the scene, or all of it: each rank prepares its own subdomains, and both
        sides of their interfaces
    soles : of ``make_soles_of``
    method : ``method`` of the configuration
    Raises BlackBoxError: from the code
    Raises Refusal: the macro problem is singular, or the parts do not go together
    """
    return _SetUp(part, soles, method, blackbox, watch).decomposed()


class _SetUp:
    """State shared by the steps of a set-up."""

    def __init__(self, part: RankPart, soles: Sequence, method, blackbox: BlackBox,
                 watch: Stopwatch):
        self.scene, self.space, self.carried = _own_copy(part.scene), part.space, part.carried
        self.soles, self.method, self.blackbox, self.watch = soles, method, blackbox, watch
        self.own = [self.scene.subdomains[e] for e in self.space.subdomains]
        self.sides = sides_by_subdomain(self.scene)
        rings = soles if self.space.by_nodes else [None] * len(self.own)
        self.models = [extended_model(self.scene, s, self.sides[s.index], soles, ring)
                       for s, ring in zip(self.own, rings)]
        self.traces = [m.trace for m in self.models]

    def decomposed(self) -> Decomposition:
        """The decomposition, step by step."""
        scene, space, method = self.scene, self.space, self.method
        blackbox, watch, own = self.blackbox, self.watch, self.own
        remembers = any(s.remembers for s in own)
        perfect = space.transfer.perfect.all() and not remembers
        certified = not (perfect or remembers or method.tolerance.error is None
                         or any(i.follows for i in scene.interfaces))
        with watch("search_direction"):
            direction, rims, stiffness, factorised = self._asked(perfect or certified)
        modes = [rigid_modes(scene.mesh.nodes[s.nodes], s.fixed) for s in own]
        if perfect:
            local, pairs = Exchange(direction, method.search_direction.kplus), None
            if space.by_nodes:
                local = NodeExchange(direction, per_node(stiffness.diagonal(), space))
            with watch("bound"):
                bound = ErrorBound(direction, stiffness, *self._freedom(modes))
        else:
            (pairs, local), bound = self._meeting(direction, 1.0), None
        guarded = GuardedTraces(blackbox, direction, [s.name for s in own])
        bases = self._bases(direction)
        with watch("load"):
            factorised.result()
        macro = self._macro(direction, guarded, bases)
        with watch("search_direction"):
            suited, scale, spent = fitted(scene, self.soles, self.sides, guarded, method, blackbox)
        if scale != 1:
            direction, (pairs, local) = suited, self._meeting(suited, scale)
            guarded = GuardedTraces(blackbox, direction, guarded.names)
            macro = self._macro(direction, guarded, bases)
        floor, counts = self._floor(), [len(m.nodes) for m in self.models]
        with watch("linear_stage"):
            load = partial(apply_loads, scene, direction, counts, self.traces, rims, blackbox,
                           self.carried)
            loading = load()
            nonlinear = Nonlinear(blackbox, space, own, self.traces,
                                  [m.fixed.size for m in self.models], load) if remembers else None
        with watch("macro"):
            spent += macro.solve(guarded) if macro is not None else 0
            stage = LinearStage(space, direction, macro, loading, guarded)
            coarse, sweeps = self._coarse(stage, pairs)
        spent += sweeps
        if coarse is not None:
            coarse.start_from(local)
        made = Made(self.traces, counts, rims, modes, self.carried,
                    loading.sweeps + spent / scene.steps, scale)
        if certified:
            check_convex(pairs, space.team)
        certificate = Certificate(make_pairs(scene, space, direction.whole), stiffness,
                                  *self._freedom(modes), stage,
                                  pushed(own, modes)) if certified else None
        for judge in filter(None, (bound, certificate)):
            judge.floor = floor
        return Decomposition(scene, space, made, stage, local, bound and bound.of(stage), coarse,
                             certificate, nonlinear)

    def _asked(self, whole: bool) -> tuple:
        """Search direction; stiffness of the rims, and of the boundary dofs; and when the codes
        have factorised: nothing else is asked of them until then.

        whole : stiffness on interfaces is needed, as for the error; reactions always need the
            supports'
        """
        scene, own, blackbox, traces = self.scene, self.own, self.blackbox, self.traces
        sides = self.sides if whole else [[] for _ in self.sides]
        share = self.method.skip.congruent
        requests = sole_requests(scene, self.space, self.soles)
        matrices, factorised = _meanwhile(
            lambda: (assembled([model for model, _, _ in requests], blackbox, share),
                     assemble_rims(scene, own, sides, blackbox, share),
                     own_stiffness(scene, own, blackbox, share)),
            lambda: blackbox.load(self.models))
        soles, rims, of_bodies = matrices.result()
        check_own_matter(scene, own, of_bodies, rims,
                         traces if whole else [trace[:0] for trace in traces])
        stiffness = boundary_stiffness(self.space, traces, rims) if whole else None
        return placed_soles(self.space, requests, soles), rims, stiffness, factorised

    def _meeting(self, direction: SearchDirection,
                 scale: float) -> tuple[Pairs, LawStage]:
        """The pairs, and their local stage."""
        pairs = make_pairs(self.scene, self.space, direction.whole,
                           stabilisation(self.scene, self.method, scale))
        return pairs, LawStage(direction, pairs.lawful)

    def _freedom(self, modes: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
        """Rigid motions and external forces (T, B) on the boundary dofs."""
        external = np.hstack([s.loads.reshape(self.scene.steps, -1)[:, t]
                              for s, t in zip(self.own, self.traces)])
        return [m[t] for m, t in zip(modes, self.traces)], external

    def _bases(self, direction: SearchDirection) -> Macro | list[np.ndarray] | None:
        """The macro problem itself where a scene is solved by nodes, else its basis per interface;
        None where there is no linear one."""
        macro, scene = self.method.macro, self.scene
        wanted = [i.law.perfect or macro.on == "all" for i in scene.interfaces]
        if macro.strategy == "none" or not any(wanted):
            return None
        with self.watch("macro"):
            if self.space.by_nodes:
                return NodeMacro(scene, direction)
            kind = "affine" if macro.basis in ("auto", "modes") else macro.basis
            return interface_bases(scene, self.space, kind, wanted, self.method.skip.congruent)

    def _macro(self, direction: SearchDirection, guarded: GuardedTraces,
               bases: Macro | list[np.ndarray] | None) -> Macro | None:
        """The linear macro problem, on perfect interfaces or on all; still to be solved."""
        if not isinstance(bases, list):
            return bases
        kind, spent = self.method.macro.basis, 0.0
        with self.watch("macro"):
            if kind in ("auto", "modes"):
                chosen = difficulty(self.scene).soft | (kind == "modes")
                modes, spent = soft_modes(direction, guarded, chosen)
                bases = enriched(self.space, direction.whole, bases, modes)
            return Macro(self.space, direction, bases, self.method.macro.strategy, spent)

    def _coarse(self, stage: LinearStage, pairs: Pairs
                | None) -> tuple[CoarseCorrection | None, float]:
        """The coarse contact problem, where laws are not perfect, and back-substitutions per
        subdomain.
        """
        asked = self.method.coarse
        if asked == "none" or self.space.transfer.perfect.all():
            return None, 0.0
        modes, spent = soft_bodies(self.scene, stage.blackbox) if asked == "auto" else ({}, 0.0)
        coarse = CoarseCorrection(self.scene, stage, pairs, asked, modes,
                                  begin_anew(self.scene, self.method))
        return coarse, spent + coarse.sweeps

    def _floor(self) -> float:
        """Relative energy error that the codes' own matrices leave.

        Raises Refusal: a tolerance below it; heat in matter of a code's own
        """
        traits = {s.code: self.blackbox.traits(s.code) for s in self.own}
        floor, = self.space.team.max(max((each.floor for each in traits.values()), default=0.0))
        wanted = self.method.tolerance.error
        if isinstance(wanted, float) and floor > 0 and floor + 2 * ROUNDING >= wanted:
            raise Refusal("too few digits", wanted=wanted, floor=floor, twice=2 * floor)
        for s in self.own:
            if s.heated and traits[s.code].own_matter:
                raise Refusal("heat in own matter", name=s.name)
        return float(floor)


def _own_copy(scene: Scene) -> Scene:
    """The scene, with what set-up or iterations change copied: it is its owner's."""
    remembers = scene.remembers
    if remembers and any(i.follows for i in scene.interfaces):
        raise Refusal("sliding beside nonlinear matter")
    if any(i.moving is not None for i in scene.interfaces):
        scene = replace(scene, interfaces=[copy(i) for i in scene.interfaces])
    if remembers:  # pseudo-loads are this run's
        scene = replace(scene,
                        subdomains=[replace(s, loads=s.loads.copy()) if s.remembers else s
                                    for s in scene.subdomains])
    return scene


def _meanwhile(*works: Callable[[], Any]) -> list[Future]:
    """Works that another thread does one after the other, while this one goes on: what is asked of
    the codes, mostly waiting. Once one fails, those after it are left: who waits for all of them in
    their order is told.

    They must not speak to other ranks. They end with the process, even where nobody waits for them:
    an interrupt is not held up.
    """
    done = [Future() for _ in works]

    def run() -> None:
        try:
            for each, work in zip(done, works):
                each.set_result(work())
        except BaseException as error:  # noqa: BLE001 - handed over to who waits
            each.set_exception(error)

    threading.Thread(target=run, name="meanwhile", daemon=True).start()
    return done

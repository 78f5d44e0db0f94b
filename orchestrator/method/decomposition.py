"""Set-up: a scene in the black box, with everything the iterations need, built once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.blackbox.models.extended import extended_model, sides_by_subdomain
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.method.following import Following
from orchestrator.method.history import History
from orchestrator.method.stopping.bound import ROUNDING, ErrorBound
from orchestrator.method.coarse.correction import CoarseCorrection, kind_of
from orchestrator.method.coarse.self_stress import SelfStress
from orchestrator.method.coarse.sole_scale import fitted
from orchestrator.method.local.stage import LawStage
from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.linear.loading import Loading, RimStiffness, apply_loads, assemble_rims, boundary_stiffness
from orchestrator.method.local.exchange import Exchange
from orchestrator.method.linear.macro import Macro
from orchestrator.method.linear.nonlinear import AtStep, Nonlinear
from orchestrator.method.linear.own_matter import check_own_matter, own_stiffness
from orchestrator.method.linear.macro_basis import interface_bases
from orchestrator.method.linear.meanwhile import Meanwhile
from orchestrator.method.interface.pairing import make_pairs
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.stabilisation import stabilisation
from orchestrator.method.interface.search_direction import SearchDirection, assemble_search_direction
from orchestrator.method.linear.soft_modes import enriched, soft_modes
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.part import Part
from orchestrator.savings import Savings
from orchestrator.scene.soles.difficulty import difficulty
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.conditions.rigid import rigid_modes
from orchestrator.scene.soles.sole import Sole
from orchestrator.timing import Stopwatch


@dataclass
class Decomposition:
    """A scene, decomposed and factorised.

    Parameters
    ----------
    space : numbering, of this rank's part; all lists per subdomain are of its ``subdomains``
    traces : per subdomain (t,) its boundary dofs in local numbering
    node_counts : per subdomain, nodes of its extended mesh
    modes : per subdomain (3n_E, r) rigid motions that its prescribed dofs leave
    bound : error bound, where all interfaces are perfect
    coarse : coarse contact problem, where some are not
    setup_sweeps : back-substitutions per subdomain and load step spent so far
    nonlinear : the subdomains that are; None where none is
    following : the interfaces that are paired anew as they slide, where there are some
    sole_scale : factor on the soles of contact that ``method`` asks for, see ``coarse.sole_scale``
    self_stress : beside the coarse contact problem, makes that at nodes where interfaces that open meet, or None where there is
        none; once, when it is first asked for, by all ranks: most runs end before
    resting : self-stress is corrected too
    yielded : traces (T, D) at which springs of stabilisation have given way, and what they carry at most, force per area
    """

    scene: Scene
    blackbox: BlackBox
    space: TraceSpace
    traces: list[np.ndarray]
    node_counts: list[int]
    rims: list[RimStiffness]
    loading: Loading
    stage: LinearStage
    local: Exchange | LawStage
    modes: list[np.ndarray]
    bound: ErrorBound | None
    coarse: CoarseCorrection | None
    setup_sweeps: float
    nonlinear: Nonlinear | None = None
    following: Following | None = None
    sole_scale: float = 1.0
    self_stress: Callable[[], SelfStress | None] | None = None
    resting: bool = False
    yielded: tuple[np.ndarray, float] | None = None

    @property
    def all_perfect(self) -> bool:
        """Whether there is no interface but perfect ones, and no subdomain but linear ones: the problem is linear."""
        return self.bound is not None

    @property
    def own(self) -> list[Subdomain]:
        """The subdomains of this rank."""
        return [self.scene.subdomains[e] for e in self.space.subdomains]

    @property
    def steps(self) -> int:
        """Number of load steps that are solved together."""
        return len(self.loading.boundary)

    def evaluated(self, s: np.ndarray) -> Admissible:
        """The linear stage at a state (T, D); its traces are under way to other ranks."""
        fields = self.stage(s)
        fields.send(None if self.bound is None else self.bound.continuity.weight)
        return fields

    def corrected(self, fields: Admissible) -> Admissible:
        """Fields of the linear stage with what the coarse contact problem adds to them."""
        if self.coarse is None:
            return fields
        fields = self.coarse(fields)
        at_nodes = self.self_stress() if self.resting else None
        return fields if at_nodes is None else at_nodes(fields, self.local)

    def point(self, s: np.ndarray, fields: Admissible) -> Admissible:
        """What the acceleration takes in: where matter is nonlinear the state that was asked, as what the coarse problem has
        changed is extrapolated."""
        return fields if self.nonlinear is None else replace(fields, s=s)

    @property
    def told(self) -> dict[str, object]:
        """What events say of the coarse contact problem, where there is one."""
        if self.coarse is None:
            return {}
        problem = self.coarse.problem
        return {"newton_steps": problem.newton_steps, "coarse_left": max(problem.left.values(), default=0.0),
                "coarse_ends": dict(problem.ends)}

    def batch(self, steps: slice | np.ndarray, before: History | None = None) -> "Decomposition":
        """The same decomposition for some of the load steps.

        Parameters
        ----------
        steps : slice or (r,) int
        before : what the step before has left; None at the start
        """
        loading = self.loading.batch(steps)
        one = None if self.nonlinear is None else AtStep(self.nonlinear, range(self.steps)[steps][0])
        stage = self.stage.under(loading.boundary, loading.known, one)
        local, coarse = copy(self.local), copy(self.coarse)
        if not self.all_perfect:
            local.pairs = local.pairs.batch(steps)
        if before is not None:
            local.before = before
        if coarse is not None:
            coarse.start_from(local)
        bound = self.bound and self.bound.batch(steps, stage, loading)
        return replace(self, loading=loading, stage=stage, local=local, coarse=coarse, bound=bound)

    def foreseen(self, step: int) -> Decomposition:
        """With pseudo-loads of the load step before at this one: as if nothing more would flow."""
        self.nonlinear.foresee(step)
        return self.reloaded()

    def reloaded(self) -> Decomposition:
        """With the loads that the subdomains have by now: pseudo-loads are among them where matter is nonlinear."""
        if self.nonlinear is None:
            return self
        loading = self.nonlinear.reload()
        return replace(self, loading=loading, stage=self.stage.under(loading.boundary, loading.known))

    def paired(self, place: np.ndarray) -> "Decomposition":
        """The same with sides paired where traces (1, D) have brought them."""
        pairs = replace(self.following.pair(place), targets=self.local.pairs.targets, numbers=self.local.pairs.numbers)
        local, coarse = LawStage(self.stage.direction, pairs.lawful, self.local.before), self.coarse
        if coarse is not None:
            coarse = coarse.paired(pairs)
            coarse.start_from(local)
        result = replace(self, local=local, coarse=coarse)
        return result if self.yielded is None else result.yielding(*self.yielded)

    def yielding(self, w: np.ndarray, most: float) -> "Decomposition":
        """The same with springs of stabilisation that have given way until they carry ``most``, force per area, where they would
        carry more with pairs where traces w (T, D) have brought them."""
        everywhere, = self.space.extended(w)
        coarse = None if self.coarse is None else self.coarse.yielding(everywhere, most)
        return replace(self, local=self.local.yielding(everywhere, most), coarse=coarse, yielded=(w, most))

    def paired_as(self, other: "Decomposition") -> "Decomposition":
        """The same with the pairs of another one, for fewer load steps, at the beginning of the next of which it ends."""
        local, coarse = copy(self.local), copy(other.coarse)
        local.pairs = replace(other.local.pairs, targets=self.local.pairs.targets, numbers=self.local.pairs.numbers)
        if coarse is not None:
            coarse.radius = None
        return replace(self, local=local, coarse=coarse)

    def __repr__(self) -> str:
        macro = self.stage.macro
        return (f"Decomposition({len(self.scene.subdomains)} subdomains, {len(self.scene.interfaces)} interfaces, "
                f"{self.space.size} trace dofs, {macro.size if macro else 0} macro unknowns)")


def prepare(scene: Scene, soles: Sequence[tuple[Sole, Sole]], method, blackbox: BlackBox, workers: int,
            watch: Stopwatch, savings: Savings | None = None, part: Part | None = None) -> Decomposition:
    """Load the extended subdomains into the black box and build what the iterations need.

    Parameters
    ----------
    soles : per interface, the soles of its two sides
    method : ``method`` of the configuration
    workers : number of packets small requests are joined in
    savings : where it is noted what need not be done
    part : what this rank has been given, whose scene this then is; each prepares its own subdomains, and both sides of
        their interfaces

    Raises
    ------
    BlackBoxError : from the code
    InputError : the macro problem is singular
    """
    savings, share = savings or Savings(), method.skip.congruent
    if any(i.law.follows for i in scene.interfaces) and any(s.remembers for s in scene.subdomains):
        raise InputError(Problem(("interfaces",), "pairing: follow beside parts whose matter is nonlinear",
                                 "one of the two: both go from load step to load step by themselves", "write pairing: fixed"))
    if any(i.moving is not None for i in scene.interfaces):  # they change, and the scene is its owner's
        scene = replace(scene, interfaces=[copy(i) for i in scene.interfaces])
    part = part or Part.of_all(scene)
    if any(s.remembers for s in scene.subdomains):  # pseudo-loads are this run's, not the scene's
        scene = replace(scene, subdomains=[replace(s, loads=s.loads.copy()) if s.remembers else s for s in scene.subdomains])
    space, sides = part.space, sides_by_subdomain(scene)
    own = [scene.subdomains[e] for e in space.subdomains]
    models = [extended_model(scene, s, sides[s.index], soles) for s in own]
    traces = [m.trace for m in models]
    remembers = any(s.remembers for s in own)
    all_perfect = all(space.perfect) and not remembers
    with watch("search_direction"):
        direction = assemble_search_direction(scene, space, soles, blackbox, workers, share, savings)
        # stiffness on interfaces is needed for the error bound and for ties; reactions always need the supports'
        whole = all_perfect or space.ties is not None
        rims = assemble_rims(scene, own, sides if whole else [[] for _ in sides], blackbox, workers, share,
                             savings)
        of_bodies = own_stiffness(scene, own, blackbox, workers, share, savings)
    # the codes factorise meanwhile: until ``loaded``, nothing is asked of them
    factorised = Meanwhile(lambda: blackbox.load(models))

    def loaded() -> None:
        with watch("load"):
            factorised.result()

    with watch("search_direction"):
        check_own_matter(scene, own, of_bodies, rims, traces if whole else [trace[:0] for trace in traces])
        stiffness = boundary_stiffness(space, traces, rims) if whole else None
        if space.ties is not None:
            space.ties.stiffen(space.gathered(stiffness.diagonal()[None])[0])
    modes = [rigid_modes(scene.mesh.nodes[s.nodes], s.fixed) for s in own]
    bound = coarse = judge = self_stress = None

    def meeting(direction: SearchDirection, scale: float) -> tuple[Pairs, LawStage, np.ndarray]:
        """The pairs, their local stage, and how they are stabilised."""
        springs = stabilisation(scene, method, scale)
        pairs = make_pairs(scene, space, direction.whole, springs)
        return pairs, LawStage(direction, pairs.lawful), springs

    if all_perfect:
        local = Exchange(direction, method.search_direction.kplus)
        def make_bound() -> ErrorBound:
            external = np.hstack([s.loads.reshape(scene.steps, -1)[:, t] for s, t in zip(own, traces)])
            return ErrorBound(direction, stiffness, [m[t] for m, t in zip(modes, traces)], external)

        if space.team.size == 1:  # it is asked for nothing before the codes have answered, and its arithmetic leaves a core free
            for matrix in (direction.whole, direction.k):
                matrix.sum_duplicates()  # so that no thread puts them in order while another one reads
            judge = Meanwhile(make_bound)
        else:
            with watch("bound"):
                bound = make_bound()
    else:
        pairs, local, springs = meeting(direction, 1.0)
    guarded = GuardedTraces(blackbox, direction, [s.name for s in own])
    macro = _macro(scene, space, direction, method, guarded, watch, loaded)
    loaded()
    with watch("search_direction"):
        suited, scale, spent = fitted(scene, soles, sides, guarded, method, blackbox)
    if scale != 1:
        direction, (pairs, local, springs) = suited, meeting(suited, scale)
        guarded = GuardedTraces(blackbox, direction, guarded.names)
        macro = _macro(scene, space, direction, method, guarded, watch, loaded)
    floor = _floor(blackbox, own, method, space.team)
    for s in own:
        if s.heated and blackbox.traits(s.code).own_matter:
            raise InputError(Problem(("loads",), f"a temperature on {s.name}, whose code has matter of its own",
                                     "temperatures on bodies of the YAML's young, poisson and expansion",
                                     "heat it in that model, or name other volumes under on:"))
    with watch("linear_stage"):
        load = partial(apply_loads, scene, direction, models, traces, rims, blackbox, part.carried)
        loading = load()
        nonlinear = Nonlinear(blackbox, space, own, traces, [m.fixed.size for m in models], load) if remembers else None
    sweeps = loading.sweeps + spent / scene.steps
    with watch("macro"):
        if macro is not None:
            sweeps += macro.solve(guarded) / scene.steps
        stage = LinearStage(space, direction, macro, loading.boundary, loading.known, guarded)
        if method.coarse != "none" and not all(space.perfect):
            coarse = CoarseCorrection(scene, stage, pairs, kind_of(method.coarse, scene, pairs, space.team))
            sweeps += coarse.sweeps / scene.steps
            self_stress = cache(partial(SelfStress.of, space, local))
    if judge is not None:
        with watch("bound"):
            bound = judge.result()
    if bound is not None:
        bound = bound.of(stage, loading, floor)
    following = Following(scene, space, direction, springs) if any(i.law.follows for i in scene.interfaces) else None
    return Decomposition(scene, blackbox, space, traces, [len(m.nodes) for m in models], rims, loading,
                         stage, local, modes, bound, coarse, sweeps, nonlinear, following, scale, self_stress)


def _floor(blackbox: BlackBox, own: Sequence[Subdomain], method, team) -> float:
    """Relative energy error that the codes' own matrices leave.

    Raises
    ------
    InputError : a tolerance below it
    """
    floor = max((blackbox.traits(code).floor for code in {s.code for s in own}), default=0.0)
    floor, = team.max(floor)
    wanted = method.tolerance.error
    if isinstance(wanted, float) and floor > 0 and floor + 2 * ROUNDING >= wanted:
        raise InputError(Problem(("method", "tolerance", "error"), f"{wanted:.1e} beside a matrix whose entries have too few digits for it",
                                 f"an error above {floor:.1e}, which its rounding alone may cause",
                                 f"write error: {2 * floor:.0e}, or the matrix with more digits (17 are all of a double's)"))
    return float(floor)


def _macro(scene: Scene, space: TraceSpace, direction: SearchDirection, method, blackbox: BlackBox, watch: Stopwatch,
           loaded: Callable[[], None]) -> Macro | None:
    """The linear macro problem, on perfect interfaces or on all; still to be solved.

    Parameters
    ----------
    loaded : waits until the black box answers
    """
    wanted = [i.law.perfect or method.macro.on == "all" for i in scene.interfaces]
    if method.macro.strategy == "none" or not any(wanted):
        return None
    kind, spent = method.macro.basis, 0.0
    with watch("macro"):
        bases = interface_bases(scene, space, "affine" if kind in ("auto", "modes") else kind, wanted, method.skip.congruent)
        if kind in ("auto", "modes"):
            chosen = difficulty(scene).soft if kind == "auto" else np.ones(len(scene.subdomains), dtype=bool)
    if kind in ("auto", "modes"):
        if chosen.any():
            loaded()
        with watch("macro"):
            modes, spent = soft_modes(direction, blackbox, chosen)
            bases = enriched(space, direction.whole, bases, modes)
    with watch("macro"):
        return Macro(space, direction, bases, method.macro.strategy, spent)

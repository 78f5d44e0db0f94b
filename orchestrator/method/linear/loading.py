"""Answers to the loads and prescribed displacements before any interface force acts.

Prescribed displacements are lifted: u = u_free + u_lift, the black box clamps, and the load becomes
f_d = f_ext − K u_lift. K u_lift needs the tets around the prescribed nodes only: the rims. Soles on
prescribed nodes are lifted with them: f_d − NᵀkN u_lift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models import Rim, rim_model
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import assembled
from orchestrator.method.interface.rows import Blocks, dots, peak
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.parallel.team import Team
from orchestrator.scene.conditions.rigid import HELD, motions_about
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.interface import ends_of, Interface
from orchestrator.scene.model import Scene, Subdomain

# of what loads and supports would do alone in energy norm: what rounding leaves of an answer that
# is zero
ZERO = 1e-11
NOTHING = 1e-5  # of the same, but for rigid motions of bodies: less is not known to six digits
ROUNDING = 1e-12  # of what is prescribed, what is left beside a rigid motion and counts as none


@dataclass
class RimStiffness:
    """Stiffness of a subdomain's rim, in the rim's own numbering."""

    stiffness: sp.csr_array  # (3r, 3r); rows of interface and prescribed dofs are complete
    nodes: np.ndarray  # (r,) int, local node of the subdomain for each node of the rim

    @property
    def dofs(self) -> np.ndarray:
        """(3r,) dofs of the subdomain."""
        return (3 * self.nodes[:, None] + np.arange(3)).ravel()


def partway(values: np.ndarray, step: int, share: float) -> np.ndarray:
    """(…) of values (T, …) at load steps: a share of the way from the one before, or from nothing,
    to ``step``.
    """
    return share * values[step] + ((1 - share) * values[step - 1] if step else 0.0)


def assemble_rims(scene: Scene, own: list[Subdomain], sides, blackbox: BlackBox,
                  share: bool) -> list[RimStiffness]:
    """Rim stiffness of a rank's own subdomains, assembled by the black box; congruent rims once if
    they ``share``.
    """
    rims: list[Rim] = [rim_model(scene, s, sides[s.index]) for s in own]
    filled = [r for r in rims if len(r.model.cells)]
    found = iter(assembled([r.model for r in filled], blackbox, share))
    return [RimStiffness(next(found) if len(r.model.cells)
                         else sp.csr_array((3 * len(r.nodes),) * 2), r.nodes) for r in rims]


def boundary_stiffness(space: TraceSpace, traces: list[np.ndarray],
                       rims: list[RimStiffness]) -> Blocks:
    """(B, B) the subdomains' stiffness on their boundary dofs: energy of fields that vanish
    inside.
    """
    different, numbers, starts = {}, [], []
    for trace, rim, part in zip(traces, rims, space.boundary):
        if not len(trace):
            continue
        position = np.searchsorted(rim.dofs, trace)
        key = id(rim.stiffness), position.tobytes()  # congruent rims share their stiffness
        numbers.append(different.setdefault(key, (len(different), rim.stiffness, position))[0])
        starts.append(part.start)
    blocks = [found[position][:, position] for _, found, position in different.values()]
    return Blocks.symmetric(blocks, numbers, starts, len(space.global_dof))


@dataclass
class Loading:
    """The part of the solution that loads give on their own, a row per load step."""

    forces: list[np.ndarray]  # per subdomain (T, 3n_E) f_d on the free dofs, zero elsewhere
    lift: list[np.ndarray]  # per subdomain (T, 3n_E) prescribed displacements
    known: np.ndarray | None  # (T, D) their traces on interfaces, None where there are none
    boundary: np.ndarray  # (T, B) boundary values of M⁻¹f_d
    # (T, B) the rigid motions r that come closest to what is prescribed on each body, on boundary
    # dofs
    carried: np.ndarray
    # (T, B) boundary values of M⁻¹(f_ext + K (u_lift − r)): gives energies by duality
    working: np.ndarray
    energy: np.ndarray  # (T,) the loads' own part of the energy ‖u‖²_K, see ``energy_of``
    # (2, T) energy that loads and supports would store in the extended subdomains alone, of all
    # ranks; the same without the rigid motions r
    alone: np.ndarray
    strained: np.ndarray  # (T,) the largest prescribed displacement of this rank beside r
    sweeps: float  # back-substitutions per subdomain and step

    def batch(self, steps: slice) -> "Loading":
        """The part that belongs to some of the load steps."""
        return Loading([f[steps] for f in self.forces], [u[steps] for u in self.lift],
                       None if self.known is None else self.known[steps],
                       *(x[steps]
                         for x in (self.boundary, self.carried, self.working, self.energy)),
                       self.alone[:, steps], self.strained[steps], self.sweeps)

    def size(self, energy: np.ndarray) -> float:
        """‖u‖_K that errors are relative to, from ‖u‖²_K (T,): that of the largest load step.

        Next to nothing, as of a body that is heated and held all around, is compared with a small
        share of what loads would do alone. What supports carry away far without straining it does
        not count there, lest its error be compared with its way: only what is all rounding, as of a
        body moved as a whole, is compared with that too.
        """
        own, whole, strained = (float(np.sqrt(x.max(initial=0.0))) for x in (energy, *self.alone))
        return max(own,
                   NOTHING * strained) if own > ZERO * whole else NOTHING * max(whole, strained)

    def energy_of(self, robin: np.ndarray, u: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """(T,) ‖u‖²_K of the subdomains' fields, both boundary-borne and inner.

        robin : (T, B) Nᵀ(s − Gα), the interface load of the extended subdomains
        u : (T, B) boundary displacement
        forces : (T, B) Nᵀf, interface forces on the subdomains proper

        u = u_free + u_lift with K u = f_ext + Nᵀf on free dofs. A rigid motion r has no energy:
        with d = u_lift − r on prescribed dofs, ‖u‖² = ‖u − r‖² = (u_free − r)ᵀ(f_ext + Nᵀf + K d) +
        ‖d‖², and u_free = M⁻¹(f_d + robin); on boundary dofs u is u_free. Of a body that is moved
        far, r leaves nothing to cancel.
        """
        return self.energy + dots(self.working, robin) + dots(u - self.carried, forces)


def apply_loads(scene: Scene, direction: SearchDirection, node_counts: list[int],
                traces: list[np.ndarray],
                rims: list[RimStiffness], blackbox: BlackBox, bodies: Carried) -> Loading:
    """Solve the extended subdomains under the loads alone, all load steps at once: M⁻¹f_d of
    eq. 30.

    node_counts : of the extended subdomains
    bodies : the rigid motions of what is held together, of the whole scene
    """
    space, steps = direction.space, scene.steps
    own = [scene.subdomains[e] for e in space.subdomains]
    known = space.known(scene.subdomains)
    soles = None if known is None else space.loads(direction.times(known))
    forces, lifts, requests, energy = [], [], {}, np.zeros(steps)
    lifted_any = bool(space.team.max(any(s.prescribed.any() for s in own))[0])
    working_forces, carried, apart = [], np.zeros((steps, len(space.global_dof))), np.zeros(steps)
    for e, (s, rim, count) in enumerate(zip(own, rims, node_counts)):
        external = np.where(s.fixed, 0.0, s.loads).reshape(steps, -1)
        lift = np.where(s.fixed, s.prescribed, 0.0).reshape(steps, -1)
        reaction, strained = np.zeros((2, *lift.shape))
        parts = bodies.split(s, scene.mesh.nodes[s.nodes], lift)
        if parts is not None:
            rigid, left = parts
            apart = np.maximum(apart, np.abs(left).max(axis=1))
            carried[:, space.boundary[e]] = rigid[:, traces[e]]
            for force, moved in ((reaction, lift), (strained, left)) if len(rim.nodes) else ():
                force[:, rim.dofs] = (rim.stiffness @ moved[:, rim.dofs].T).T
            energy += np.sum(left * strained, axis=1)
            reaction[:, s.fixed.ravel()] = strained[:, s.fixed.ravel()] = 0.0
            energy -= np.sum(rigid * (external + strained), axis=1)
        forces.append(external - reaction)
        if soles is not None:
            forces[-1][:, traces[e]] -= soles[:, space.boundary[e]]
        working_forces.append(external + strained)
        lifts.append(lift)
        columns = np.vstack([forces[-1], working_forces[-1]]) if lifted_any else forces[-1]
        if columns.any():
            padded = np.zeros((len(columns), 3 * count))
            padded[:, : columns.shape[1]] = columns
            requests[e] = padded
    answers = blackbox.fields(requests)
    boundary = np.zeros((steps, len(space.global_dof)))
    working, alone = np.zeros_like(boundary), np.zeros((2, steps))
    for e, answer in answers.items():
        part, trace = space.boundary[e], traces[e]
        boundary[:, part] = answer[:steps, trace]
        working[:, part] = answer[-steps:, trace]
        size = working_forces[e].shape[1]
        energy += np.sum(working_forces[e] * answer[:steps, :size], axis=1)
        alone += [np.sum(f * a[:, :size], axis=1)
                  for f, a in ((forces[e], answer[:steps]), (working_forces[e], answer[-steps:]))]
    alone, = space.team.sum(alone)
    return Loading(forces, lifts, known, boundary, carried, working, energy, alone, apart,
                   2.0 if lifted_any else 1.0)


def bodies_of(scene: Scene, joins: Callable[[Interface], bool]) -> tuple[int, np.ndarray]:
    """Return how many bodies the subdomains are that interfaces join, and (subdomains,) int, the
    body of each."""
    joined = ends_of(i for i in scene.interfaces if joins(i))
    return components(*joined.T, len(scene.subdomains))


@dataclass(frozen=True)
class Carried:
    """The rigid motion that comes closest to what is prescribed on each body, of all that joining
    laws hold together.
    """

    body: np.ndarray  # (subdomains,) int, the body of each
    # body that is moved → centre, size, and (6, T) coefficients of its motions
    frames: dict[int, tuple[np.ndarray, float, np.ndarray]]

    @classmethod
    def of(cls, scene: Scene, rank_of: np.ndarray, team: Team) -> Carried:
        """Of a scene; of a rank's part of one, whose ``rank_of`` its subdomains are, together with
        all others.
        """
        _, body = bodies_of(scene, lambda i: i.law.joins)
        own, moved = [s for s in scene.subdomains if rank_of[s.index]
                      == team.rank], np.zeros(body.max() + 1)
        for s in own:
            moved[body[s.index]] += s.prescribed.any()
        bodies = np.flatnonzero(team.sum(moved)[0])
        return cls(body,
                   dict(
                       zip(bodies.tolist(),
                           _fits(scene, [[s for s in own if body[s.index] == b] for b in bodies],
                                 team))))

    def between(self, step: int, share: float) -> Carried:
        """At one load step alone, a share of the way from the one before to ``step``."""
        return Carried(self.body, {b: (centre, size, partway(values.T, step, share)[:, None])
                                   for b, (centre, size, values) in self.frames.items()})

    def split(self, s: Subdomain, points: np.ndarray,
              lift: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """The motion (T, 3n) of a subdomain, zero on prescribed dofs, and what it leaves there of
        the lift (T, 3n); None
        where nothing moves: neither do parts whose mesh is not ours and that are held inside. Rigid
        motions cost energy there, on joints too, and nothing is prescribed but rest.

        points : (n, 3) where its nodes are
        """
        if self.body[s.index] not in self.frames or s.foreign and s.fixed.any():
            return None
        centre, size, coefficients = self.frames[self.body[s.index]]
        rigid = (motions_about(points, centre, size).reshape(-1, 6) @ coefficients).T
        fixed = s.fixed.ravel()
        left = np.where(fixed, lift - rigid, 0.0)
        left[np.abs(left) <= ROUNDING * peak(rigid)] = 0.0
        return np.where(fixed, 0.0, rigid), left


def _fits(scene: Scene, bodies: list[list[Subdomain]],
          team: Team) -> list[tuple[np.ndarray, float, np.ndarray]]:
    """Centre, size, and (6, T) coefficients of the motions of some bodies, of each this rank's
    pieces.

    Each rank's rows are reduced to a triangle, whose least squares are the same (Demmel et al.,
    SIAM J. Sci. Comput. 34, 2012).
    """
    held = [[s for s in pieces if s.fixed.any()] for pieces in bodies]
    points = [
        np.concatenate(
            [np.empty((0, 3)), *(scene.mesh.nodes[s.nodes[s.fixed.any(axis=1)]] for s in pieces)])
        for pieces in held]
    sums, counts = team.sum(np.array([p.sum(axis=0) for p in points]).reshape(-1, 3),
                            [len(p) for p in points])
    centres = sums / counts[:, None]
    far = team.max(*(peak(((p - c) ** 2).sum(axis=1))
                     for p, c in zip(points, centres))) if bodies else []
    sizes, rows = [float(np.sqrt(x)) or 1.0 for x in far], []
    for pieces, centre, size in zip(held, centres, sizes):
        each = [
            np.column_stack([motions_about(scene.mesh.nodes[s.nodes], centre, size)[s.fixed],
                             s.prescribed[:, s.fixed].T]) for s in pieces]
        own = np.concatenate([np.empty((0, 6 + scene.steps)), *each])
        rows.append(own if team.size == 1 else np.linalg.qr(own, mode="r"))
    rows = [np.concatenate(same) for same in zip(*team.all_gather(rows))]
    return [(c, size, np.linalg.lstsq(r[:, :6], r[:, 6:], rcond=HELD)[0])
            for c, size, r in zip(centres, sizes, rows)]

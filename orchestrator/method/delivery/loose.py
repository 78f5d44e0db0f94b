"""Loose bodies at the end of a run: which interfaces hold, what stabilisation carries, how far
places are determined.

A body is what joining laws make one. A *detached* body has no way to a prescribed one over node
pairs that hold; a *weakly held* one has, but could still move as a rigid body without opening a
pair that is kept closed or sliding where the sides are kept from it. Where both are, the laws do
not say: stabilisation does, if there is any. What a status holds, it declares: contact holds
nothing where the sides touch without pressing.

At a pair the springs carry f̂ − law(F). Relative to the largest force per area that a contact
carries, and their work Σ (f̂ − law(F)) · Δd over the largest strain energy, they tell how far the
solution is from that of the laws alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.points import Hold, Status, dot, norm, table
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.delivery.reach import reach
from orchestrator.method.delivery.recovery import Parts
from orchestrator.method.interface.rows import peak, ratio
from orchestrator.method.iterated import Iterated
from orchestrator.method.linear.loading import bodies_of
from orchestrator.method.stopping.law_residuals import LawResiduals, LengthScale
from orchestrator.scene.conditions.supports import loose_bodies, Supports, supports_of
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.interface import ends_of
from orchestrator.scene.model import Scene

MOST_BODIES = 300  # beyond, the search for weakly held ones costs more than it tells
PRESSING = 1e-6  # pressure or tension relative to the largest of all steps, from which it counts
FREE = 1e-10  # stiffness of a motion, relative to the largest, that counts as none
UNTOLD = 10.0  # relative energy error over law residual, where the former is not known
# share of the forces on a body, in magnitude, that springs carry, from which it lives by them
LIVES = 0.1


def held_bodies(scene: Scene,
                interfaces: InterfaceFields) -> tuple[list[list[str]], list[list[str]]]:
    """Names of the detached and of the weakly held bodies (of all that are joined to one), per load
    step.
    """
    bodies, body = bodies_of(scene, lambda i: i.law.joins)
    fixed, supports = np.zeros(bodies, bool), supports_of(scene)
    fixed[body[supports.count > 0]] = True
    ends = body[interfaces.subdomains]
    motion = _Motions(supports, body, bodies) if bodies <= MOST_BODIES else None
    detached, weak = [], []
    for normal, tangential in zip(*_holding(interfaces, table(i.law for i in scene.interfaces))):
        touching = np.logical_or.reduceat(normal | tangential, interfaces.offsets[:-1])
        met = ends[touching]
        group = components(*met.T, bodies)[1]
        lost, loose = ~np.isin(group, group[fixed]), np.zeros(bodies, bool)
        if motion:
            forbidden = motion.forbidden(interfaces, ends, normal, tangential)[touching]
            loose = motion.free(met, forbidden) & ~lost
        for result, chosen in ((detached, lost), (weak, loose)):
            result.append(
                list(dict.fromkeys(s.body for s, b in zip(scene.subdomains, body) if chosen[b])))
    return detached, weak


def _holding(interfaces: InterfaceFields,
             statuses: list[Status]) -> tuple[np.ndarray, np.ndarray]:
    """(T, N) bool twice: where the sides are kept from moving along the normal, and across it."""
    pressure = interfaces.pressure
    least = PRESSING * peak(pressure)
    when = {Hold.NEVER: np.zeros(pressure.shape, bool), Hold.ALWAYS: np.ones(pressure.shape, bool),
            Hold.PRESSED: pressure > least, Hold.PULLED: pressure < -least}
    which = np.searchsorted(statuses, interfaces.status)
    return tuple(np.choose(which, [when[getattr(s, way)] for s in statuses])
                 for way in ("normal", "tangential"))


class _Motions:
    """Rigid motions of all bodies, six each, and what supports and closed pairs make of them; body
    (subdomains,) int of each.
    """

    def __init__(self, supports: Supports, body: np.ndarray, bodies: int):
        known = [supports.of_body(np.flatnonzero(body == b)) for b in range(bodies)]
        self.about, self.support = [about for about, _ in known], np.array(
            [rows.T @ rows for _, rows in known])

    def forbidden(self, interfaces: InterfaceFields, ends: np.ndarray, normal: np.ndarray,
                  tangential: np.ndarray) -> np.ndarray:
        """(I, 2, 6, 2, 6) Gram matrices of how the motions of an interface's two bodies part its
        sides where pairs hold along and
        across the normal, (N,) bool each; ends : (I, 2) int, the bodies."""
        result = np.zeros((len(ends), 12, 12))
        for k, own in interfaces.each():
            n, apart = interfaces.normal[own], []
            for points, b in zip(interfaces.points[:, own], ends[k]):
                columns = motions_about(points, *self.about[b])
                opening = n[:, :, None] * np.einsum("ni,nij->nj", n, columns)[:, None, :]
                apart.append(
                    (normal[own, None, None] * opening + tangential[own, None, None]
                     * (columns - opening)).reshape(-1, 6))
            both = np.concatenate([apart[0], -apart[1]], axis=1)
            result[k] = both.T @ both
        return result.reshape(-1, 2, 6, 2, 6)

    def free(self, ends: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """(bodies,) bool, whether each can move rigidly beside what is ``forbidden`` (k, 2, 6, 2,
        6) to pairs of them (k, 2) int.
        """
        bodies = len(self.support)
        gram = np.zeros((bodies, 6, bodies, 6))
        gram[range(bodies), :, range(bodies), :] = self.support
        for one, two in ((0, 0), (1, 1), (0, 1), (1, 0)):
            np.add.at(gram, (ends[:, one], slice(None), ends[:, two]), blocks[:, one, :, two])
        values, vectors = np.linalg.eigh(gram.reshape(6 * bodies, -1))
        loose = vectors[:, values <= FREE * max(values[-1], 1e-300)].reshape(bodies, 6, -1)
        return np.linalg.norm(loose, axis=(1, 2)) > 1e-3


@dataclass(frozen=True)
class Stabilised:
    """Forces of the stabilising springs."""

    epsilon: float  # largest ε of a pair
    force: float  # largest traction of the springs over the largest that contacts carry
    work: float  # of the springs, all load steps together, over the largest strain energy
    bodies: list[list[str]]  # (T,) names of loose ones that live by them, per load step
    most: str  # name of the loose one whose forces they carry the largest share of
    weakened: list[int]  # iterations after which they became weaker


def stabilised(d: Decomposition, iterated: Iterated) -> Stabilised | None:
    """Forces of the stabilising springs; None where nothing is stabilised."""
    if d.all_perfect or d.local.pairs.stabilisation is None:
        return None
    pairs, local, team = d.local.pairs, iterated.local, d.space.team
    springs, law = local.force - local.lawful, local.lawful
    own, whole = norm(springs), norm(law)
    epsilon, largest, carried = team.max(*(peak(x) for x in (
        pairs.stabilisation, own / pairs.points.area, whole / pairs.points.area)))
    moved = np.concatenate([np.diff(local.jump[t], axis=0, prepend=before.jump[None])
                            for t, _, before in iterated.by_pairing()])
    ends = np.repeat(ends_of(pairs.interfaces), np.diff(pairs.bounds), axis=0)
    sums = np.zeros((2, d.steps, len(d.scene.subdomains)))
    for magnitudes, result in zip((own, whole), sums):
        for side in ends.T:
            np.add.at(result, (slice(None), side), np.where(pairs.mine, magnitudes, 0.0))
    work, (held, pressed) = team.sum(float((np.abs(dot(springs, moved)) * pairs.mine).sum()), sums)
    loose, total = loose_bodies(d.scene), held + pressed
    share = ratio(held, total, loose | ~loose.any())
    names = [s.body for s in d.scene.subdomains]
    energy, weakened = 0.5 * iterated.bound.energy.max(initial=0.0), iterated.found.get(
        "weakening", [])
    epsilon *= max((case["springs"] for case in weakened), default=1.0)
    return Stabilised(float(epsilon), _ratio(largest, carried), _ratio(work, energy),
                      [list(dict.fromkeys(name for name, lives in zip(names, step) if lives))
                       for step in share > LIVES],
                      names[int(share.max(axis=0).argmax())],
                      [after for case in weakened for after in case["after"]])


def _ratio(part: float, whole: float) -> float:
    """Infinite where springs carry something and contacts nothing."""
    return float(part / whole) if whole > 0 else float("inf") if part > 0 else 0.0


@dataclass(frozen=True)
class OpenPlaces:
    """How far off bodies may be, over the largest displacement of all bodies and load steps;
    infinite: not determined.
    """

    open: float  # of the body whose place is determined least
    bodies: dict[str, float]  # each → the same, at its worst load step, the largest first


def open_places(d: Decomposition, iterated: Iterated, lengths: LengthScale, laws: LawResiduals,
                parts: Parts) -> OpenPlaces | None:
    """Open places of the bodies; None where supports and joints hold all.

    Where no energy error is known it is taken to be ``UNTOLD`` law residuals.
    """
    if not lengths.loose.any():
        return None
    bound = iterated.bound
    if bound.pair is not None and np.isfinite(bound.steps).all():
        error = np.maximum.accumulate(bound.steps)
    else:
        error = np.full(d.steps, UNTOLD * laws.largest
                        * float(np.sqrt(bound.energy.max(initial=0.0))))
    largest, = d.space.team.max(max((peak(u) for u in parts if u is not None), default=0.0))
    each = reach(d, lengths, iterated, error).max(axis=1) / (largest or 1.0)
    each[~(each <= 1)] = np.inf
    bodies: dict[str, float] = {}
    for b in np.argsort(-each, kind="stable"):
        bodies.setdefault(lengths.names[b], float(each[b]))
    return OpenPlaces(peak(each), bodies)

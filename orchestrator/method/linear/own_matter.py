"""Matter of a code's own: what all else relies on is shown for each subdomain, since nothing is known of it beforehand.

- K ≥ 0 on the body alone. With its soles it may be positive even where it is not, and then converge, to an answer whose
  error no bound holds.
- K is a sum over tets: its rows on supports and interfaces, which energies, bound and reactions use, are those of the tets
  there alone.

Symmetry and rigid motions are tested where stiffness arrives, see ``blackbox.guarded``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.blackbox.shared import assembled
from orchestrator.blackbox.models.extended import body_model
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.errors import BlackBoxError
from orchestrator.method.linear.loading import RimStiffness
from orchestrator.method.stopping.semidefinite import is_semidefinite
from orchestrator.timing import Savings
from orchestrator.scene.conditions.rigid import motions
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.model import Scene, Subdomain

# Relative: below any mode that a slender body has, above what assembling leaves. Missing digits show in rigid motions, and
# may make an eigenvalue negative by some of what they cost.
ROUNDING, DIGITS = 1e-12, 10.0
LOCAL = 1e-8  # of a row's diagonal entry: what two assemblies of the same tets may differ by


def own_stiffness(scene: Scene, own: Sequence[Subdomain], blackbox: BlackBox, share: bool, savings: Savings) -> dict[int, sp.csr_array]:
    """Index in ``own`` → stiffness of the body, for this rank's subdomains whose matter is their code's own; others as for
    ``assembled``. Parts whose mesh is not ours have been judged when they were read."""
    chosen = [e for e, s in enumerate(own) if not s.foreign and blackbox.traits(s.code).own_matter]
    return dict(zip(chosen, assembled([body_model(scene, own[e]) for e in chosen], blackbox, share, savings)))


def check_own_matter(scene: Scene, own: Sequence[Subdomain], found: Mapping[int, sp.csr_array], rims: Sequence[RimStiffness],
                     traces: Sequence[np.ndarray]) -> None:
    """Judge the stiffness of bodies whose matter is their code's own.

    own : this rank's subdomains, with their rims
    found : of ``own_stiffness``
    traces : per subdomain (t,) boundary dofs whose rows are complete in its rim; those of prescribed dofs always are
    Raises BlackBoxError: a stiffness that is not ≥ 0, or none that is a sum over tets
    """
    seen: set[int] = set()
    for e, one in found.items():
        rows = np.union1d(np.flatnonzero(own[e].fixed), traces[e])
        points = scene.mesh.nodes[own[e].nodes]
        if wrong := _not_local(one, rims[e], rows, points) or (id(one) not in seen and _not_positive(one, points)):
            raise BlackBoxError(f"guard: {wrong}", own[e].name)
        seen.add(id(one))


def _not_positive(K: sp.csr_array, points: np.ndarray) -> str:
    """What a stiffness (3n, 3n) that is not ≥ 0 does, in words; empty where it is."""
    rigid, scale = motions(points - points.mean(axis=0)).reshape(-1, 6), np.abs(K.diagonal())
    rigid = rigid / np.abs(rigid).max(axis=0)
    cost = np.abs(K @ rigid).max(axis=1) / np.where(scale > 0, scale, scale.max(initial=0.0) or 1.0)
    if is_semidefinite(K, ROUNDING + DIGITS * float(cost.max(initial=0.0))):
        return ""
    value, node = _least(K)
    return (f"a stiffness that is not positive: displacements near {format_point(points[node])} give energy away (least eigenvalue "
            f"{value:.3g}, largest diagonal entry {K.diagonal().max():.3g}); no error bound holds there. Look for a modulus "
            "or a shear modulus below zero, a Poisson's ratio out of range, a pre-stress")


def _least(K: sp.csr_array) -> tuple[float, int]:
    """About the least eigenvalue, and the node that moves most in its mode."""
    if K.shape[0] <= 600:
        values, vectors = np.linalg.eigh(K.toarray())
    else:
        try:
            values, vectors = sla.eigsh(K, k=1, which="SA", tol=1e-3)
        except sla.ArpackNoConvergence:
            least = int(np.argmin(K.diagonal()))
            return float("nan"), least // 3
    return float(values[0]), int(np.argmax(np.abs(vectors[:, 0]))) // 3


def _not_local(K: sp.csr_array, rim: RimStiffness, rows: np.ndarray, points: np.ndarray) -> str:
    """How rows of a body's stiffness differ from those of its rim, in words; empty where they do not."""
    if not len(rows):
        return ""
    place = np.zeros(K.shape[0], dtype=int)
    place[rim.dofs] = np.arange(len(rim.dofs))
    part = sp.coo_array(rim.stiffness[place[rows]])
    same = sp.csr_array((part.data, (part.row, rim.dofs[part.col])), shape=(len(rows), K.shape[0]))
    apart = np.abs(K[rows] - same).max(axis=1).toarray().ravel() / np.maximum(np.abs(K.diagonal()[rows]), np.finfo(float).tiny)
    worst = int(np.argmax(apart))
    if apart[worst] <= LOCAL:
        return ""
    return (f"a stiffness that is no sum over tets: near {format_point(points[rows[worst] // 3])} it is another one, by {apart[worst]:.1e}, where "
            "the tets there are asked for alone; what it is made of has to be known of each tet by itself (not the mesh's size, its "
            "volume, its name, or averages over neighbours). Or it varies from place to place and says that it does not: leave uniform: true "
            "out, or translation_invariant = True in the solver's class")

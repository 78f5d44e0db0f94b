"""The same scene in one piece: displacements of a solver that has nothing of the method, see ``benchmarks.monolithic``.

It takes the scene as it was built; what goes wrong before, in meshing, pairing and loading, the relations have to tell.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from benchmarks.metamorphic.answers import Answer
from benchmarks.metamorphic.compare import LAWFUL, ROUNDING, size_of
from benchmarks.kit.elasticity import stiffness
from benchmarks.monolithic import KNOWN, Monolithic
from orchestrator import Solution
from orchestrator.method.delivery.interface_fields import geometry_shown

MOST = 4000  # unknowns of a scene that is solved in one piece


def in_one_piece(first: Answer) -> tuple[str, str]:
    """What the scene in one piece says of an answer: agree, disagree, not sayable; and how far they are apart."""
    solution = first.solution
    scene = solution.scene
    if sum(s.fixed.size for s in scene.subdomains) > MOST or any(i.law.name not in KNOWN or i.moving for i in scene.interfaces) \
            or not scene.interfaces:
        return "not sayable", ""
    whole = Monolithic(scene)
    steps = whole.solve(started(whole, solution))
    if not all(step.converged for step in steps):
        return "not sayable", f"in one piece stopped at {max(step.residual for step in steps):.1e}"
    apart = np.zeros(scene.steps)
    for s, found in zip(scene.subdomains, solution.parts):
        moduli = np.array([[m.young, m.poisson] for m in scene.materials])[s.material]
        K = stiffness(scene.mesh.nodes[s.nodes], s.connectivity, *moduli.T)
        for t, step in enumerate(steps):
            d = (found[t] - step.parts[s.index]).ravel()
            apart[t] += max(d @ (K @ d), 0.0)
    error = float(np.sqrt(apart.max()) / size_of(first))
    bound = solution.error_bound
    allowed = 2 * bound + ROUNDING if np.isfinite(bound) else LAWFUL
    return "agree" if error <= allowed else "disagree", f"displacements {error:.1e}, allowed {allowed:.1e}"


def started(whole: Monolithic, solution: Solution) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """Displacements and pair forces to start from at every load step: those told, of bonds the rest.

    Friction leaves several solutions: Newton's method stays at one that balances and obeys the laws.
    """
    scene, fields, parts = whole.scene, solution.interfaces, solution.parts
    told = np.zeros((scene.steps, *whole.pairs.normal.shape))
    known = np.zeros(told.shape[1:], dtype=bool)
    opening = [(i, at) for i, at in zip(scene.interfaces, whole.pairs.bounds) if not i.law.perfect]
    if opening:
        at = geometry_shown(scene, [i for i, _ in opening])
        forces = (fields.friction_traction * fields.areas[:, :, None]
                  - (fields.pressure * at.length * fields.areas)[:, :, None] * at.acting)
        for (i, pairs), (_, own) in zip(opening, fields.each()):
            points = i.mortar.points if i.mortar is not None else np.arange(pairs.stop - pairs.start)
            here = np.isin(points, i.shown)
            rows = pairs.start + np.flatnonzero(here)
            told[:, rows] = forces[:, own][:, np.searchsorted(i.shown, points[here])]
            known[pairs] = True
    bonds, result = sp.diags_array((~known).ravel().astype(float)), []
    scale = np.sqrt(np.maximum(whole.pairs.stiffness, whole.pairs.stiffness.max() * 1e-12)).repeat(3)
    for t, force in enumerate(told):
        u = np.concatenate([p[t].ravel() for p in parts])
        left = (whole._loads(t) - whole.K @ u)[whole.free] - whole.D.T @ force.ravel()
        spread = whole.D.T @ bonds @ sp.diags_array(scale)
        found = sla.lsqr(spread, left, atol=1e-14, btol=1e-14, iter_lim=4 * len(left))[0] * scale
        result.append(([p[t] for p in parts], force + (bonds @ found).reshape(-1, 3)))
    return result

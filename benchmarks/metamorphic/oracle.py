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

MOST = 4000  # unknowns of a scene that is solved in one piece


def in_one_piece(first: Answer) -> tuple[str, str]:
    """What the scene in one piece says of an answer: agree, disagree, not sayable; and how far they are apart."""
    solution = first.solution
    scene = solution.scene
    if sum(s.fixed.size for s in scene.subdomains) > MOST or any(i.law.name not in KNOWN or i.moving for i in scene.interfaces) \
            or not scene.interfaces:
        return "not sayable", ""
    whole = Monolithic(scene)
    steps = whole.solve(_started(whole, solution.parts))
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


def _started(whole: Monolithic, parts: list[np.ndarray]) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """Displacements and pair forces to start from at every load step: near an answer that is right there is a solution.

    Friction leaves several, and bodies that nothing holds have many places: those found elsewhere prove nothing wrong.
    """
    result = []
    scale = np.sqrt(np.maximum(whole.pairs.stiffness, whole.pairs.stiffness.max() * 1e-12)).repeat(3)
    for t in range(whole.scene.steps):
        u = np.concatenate([p[t].ravel() for p in parts])
        left = (whole._loads(t) - whole.K @ u)[whole.free]
        found = sla.lsqr(whole.D.T @ sp.diags_array(scale), left, atol=1e-14, btol=1e-14, iter_lim=4 * len(left))[0] * scale
        result.append(([p[t] for p in parts], found.reshape(-1, 3)))
    return result

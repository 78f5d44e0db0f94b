"""Bodies that bend: the coarse contact problem moves them in their own softest modes, not in affine fields.

A body's fields serve the coarse problem where its soles hold them and the body itself does not, S x = σ k x with σ small beside
one: a stage damps what else there is by |1 − σ|/(1 + σ). Rigid motions and mean strains are the softest fields of compact bodies.
A slender body, an open ring, a thin wall has many more, and where supports hold it none of them is affine: a clamped beam's
translations have a large part of stiff fields. Two clamped beams of L/h = 20 take 130 iterations to a law residual of 1e-4 with
affine fields, 50 to 90 with their soft modes beside these, 18 with the modes alone.

Which bodies these are is measured (``BesideAffine``): fields found there are no softer than the softest there is. Their modes come
from ``soft_modes``, which the macro problem has as well.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.coarse.beside_affine import BesideAffine
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.method.linear.soft_modes import Wanted, soft_modes
from orchestrator.scene.model import Scene

STEPS = 4  # of Lanczos' method from a bent field, each a back-substitution per body
# σ found so, from above, below which a body is worth its modes, for about a hundred back-substitutions. It tells how many iterations
# to 1e-4 two clamped beams take with affine fields, whatever their L/h and mesh: .145 19, .094 24, .07 30, .064 41, .05 46, .044 57, .038 68.
FOUND = 0.07
# No fewer fields than affine ones are. What is left of stiffer fields in a mode costs iterations: with residuals of .02 and of .005, beams
# of L/h = 20 and 40 take 24 and 18, 27 and 18, for 8 to 24 back-substitutions more. Beams of ten-node tets with L/h = 40 need 370.
MODES = Wanted(least=12, accurate=0.005, largest=640)


def soft_bodies(scene: Scene, blackbox: GuardedTraces) -> tuple[dict[int, np.ndarray], float]:
    """Soft modes of bodies that have softer fields than affine ones.

    blackbox : solver and search direction

    modes : place among the rank's ``space.subdomains`` → (t, m) displacements of its boundary dofs, orthonormal in k
    sweeps : back-substitutions per subdomain, the mean
    Raises BlackBoxError: from the code
    """
    space, of = blackbox.direction.space, blackbox.owned
    bodies = BesideAffine(scene, blackbox, np.ones(space.size))
    known, ends = bodies.ends(bodies.bent(), STEPS)
    parts = np.array([e for i in scene.interfaces if not i.law.joins for e in i.subdomains], dtype=int)
    wanted = np.zeros(len(scene.subdomains), dtype=bool)
    wanted[np.array(space.subdomains, dtype=int)[of.subdomains[known][ends[:, 0] < FOUND]]] = True
    wanted &= np.isin(np.arange(len(wanted)), parts) & ~scene.stand_ins  # a tool's layer has a back that does not bend
    modes, sweeps = soft_modes(blackbox.direction, blackbox, wanted, MODES)
    return modes, STEPS + sweeps

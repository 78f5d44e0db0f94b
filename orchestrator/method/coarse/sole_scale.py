"""How stiff contact's soles have to be: what the bodies themselves say, asked of the black box
before anything is solved.

With S a body's Schur complement on its interfaces and k its soles', an iteration damps an error of
the shape x, S x = σ k x, by |1 − σ|/(1 + σ): best are soles that have the softest of what is left
to the iterations as far below them as the stiffest is above. Bodies' affine fields are not: the
coarse contact problem moves them. ``facets_of`` guesses the rest from moduli and lengths; here it
is measured. The black box applies

    C k = N M⁻¹ Nᵀ k = (S + k)⁻¹ k,    whose eigenvalues are θ = 1/(1 + σ),

and a few steps of Lanczos' method in the inner product of k, all bodies side by side, find the ends
of most of what there is. Where √(σ_min σ_max) is so far above the best that it is worth another
factorisation, all soles are made stiffer by one factor, and looked at again. They are never made
softer: that slows iterations, whatever the ends are.

A factor for each interface gained nothing over the one for all, and lost an assembly whose bodies
are hard to measure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.blackbox.models import extended_model
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.coarse.soft_bodies import BesideAffine
from orchestrator.method.coarse.problem import of_all
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.facets import between
from orchestrator.scene.soles import Sole, stiffened

# Each costs a back-substitution per body, a load step's share of an iteration. One sees no ends;
# three and more find single
# bodies' softest bending, which slows no contact.
STEPS = 2
# √(σ_min σ_max), as so few steps find it, where soles are best. Measured, iterations there over the
# least of all scales: cubes
# 1.15, 15 grains 1.0, 27 grains 1.0, flange 1.18, stack 1.05, bolted assembly 1.0, punch 1.2.
BEST = 2.5
FLAT = 4 / 3  # off by less is not worth a factorisation: it stands for about 3/2 in k
NEAR = 1.15  # soles that are changed are brought this near to the best
LOADS = 3  # times that soles are changed at most: after the first each follows from a secant
# factors are powers of it, so that rounding, as of ranks or units, leaves them as they are
NOTCH = 2 ** (1 / 8)
# Of log √(σ_min σ_max) over log k: at first, and what secants may say. −1 if all ends were found;
# −0.3 … −0.9 measured
SLOPE, STEEPEST, FLATTEST = -0.75, -1.0, -0.3


def fitted(scene: Scene, soles: Sequence[tuple[Sole, Sole]],
           sides: Sequence[Sequence[tuple[int, int]]], guarded: GuardedTraces,
           method, blackbox: BlackBox) -> tuple[SearchDirection, float, int]:
    """Springs as stiff as suits the bodies where these may part, if ``method`` wants that.

    soles : per interface, as they are loaded
    sides : per subdomain, its (interface, side) pairs
    guarded : what answers for them
    blackbox : what bodies with other soles are loaded into
    Returns direction of the soles that are loaded in the end; their factor; back-substitutions per
    subdomain
    Raises BlackBoxError: from the code
    """
    direction = guarded.direction
    own, team = [scene.subdomains[e] for e in direction.space.subdomains], direction.space.team
    opens = np.array([not i.law.joins for i in scene.interfaces], dtype=bool)
    anywhere, = team.max(opens.any())
    if (
        not anywhere
        or not method.sole.fit
        or method.coarse == "none"
        or method.sole.contact != "springs"
    ):
        return direction, 1.0, 0
    # not worth it to look again where every answer costs a factorisation
    again = not team.max(any(not blackbox.traits(s.code).keeps_models for s in own))[0]

    def loaded(scale: float) -> GuardedTraces:
        factors = np.where(opens, scale, 1.0)
        changed = stiffened(soles, factors)
        blackbox.load([extended_model(scene, s, sides[s.index], changed) for s in own])
        return GuardedTraces(blackbox, direction.scaled(factors), guarded.names)

    scale, known, found, sweeps = 1.0, {1.0: guarded}, {}, 0  # by factor, the latest last
    while True:
        found[scale] = np.log(_off(scene, known[scale], opens))
        sweeps += STEPS
        best = min(found, key=lambda one: abs(found[one]))
        if best != scale:  # what is measured does not follow the soles: it is no guide
            return loaded(best).direction, best, sweeps
        if abs(found[scale]) <= np.log(FLAT if len(found) == 1 else NEAR) or len(found) > LOADS:
            break
        slope = SLOPE
        if len(found) > 1:
            before = [*found][-2]
            slope = np.clip((found[scale] - found[before]) / np.log(scale / before), STEEPEST,
                            FLATTEST)
        following = max(1.0, NOTCH ** round((np.log(scale) - found[scale] / slope)
                                            / np.log(NOTCH)))
        if following in known:
            break
        scale, known[following] = following, loaded(following)
        if not again:
            break
    return known[scale].direction, scale, sweeps


def _off(scene: Scene, blackbox: GuardedTraces, wanted: np.ndarray) -> float:
    """√(σ_min σ_max) over the best: the mean of the wanted interfaces, 1 where nothing can be
    said.
    """
    space = blackbox.direction.space
    known, middle = of_all(space.team, space.link.subdomain_count, space.subdomains,
                           _middles(scene, blackbox, wanted)).T
    mine = [i.subdomains for i in scene.interfaces
            if wanted[i.index] and i.subdomains[0] in space.subdomains
            and known[list(i.subdomains)].all()]
    one, two = middle[np.array(mine, dtype=int).reshape(-1, 2)].T
    total, count = space.team.sum(float(np.log(between(one, two)).sum()), len(mine))
    return float(np.exp(total / count) / BEST) if count else 1.0


def _middles(scene: Scene, blackbox: GuardedTraces, wanted: np.ndarray) -> np.ndarray:
    """(own bodies, 2) of each whether anything is left to the iterations on the wanted interfaces,
    and √(σ_min σ_max) of that.

    On its other interfaces a body rests on their soles, as it does in the iterations.
    """
    space = blackbox.direction.space
    on = np.zeros(len(space.owner))
    for i in np.flatnonzero(wanted):
        for dofs in space.sides[i]:
            on[dofs] = 1.0
    bodies = BesideAffine(scene, blackbox, on[: space.size])
    known, ends = bodies.ends(bodies.rough(), STEPS)
    result = np.zeros((len(space.subdomains), 2))
    result[blackbox.owned.subdomains[known]] = np.column_stack(
        [np.ones(len(ends)), np.sqrt(ends.prod(axis=1))])
    return result

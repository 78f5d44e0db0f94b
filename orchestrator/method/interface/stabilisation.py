"""Contact stabilisation: how much of what holds bodies that nothing else holds is added to which
interface.

Where contact alone holds a body it may have no position: nothing balances a wedge that is squeezed
out between its neighbours. Laws that do not join their sides are blended with "stay where you were
at the end of the load step before",

    f̂ = (1 − ε) law(F) + ε (F − keq d_before),    ∂f̂/∂F = (1 − ε) A + ε 1

which is a weak viscous spring of the rate ε keq between facing nodes, open ones included. Every
body then has one position, and ε → 0 selects it. On true laws the blend leaves a residual of about
2 ε, more where bodies go far.

Springs of ``auto`` begin anew in every iteration, "stay where you are": in the place of d_before
stands the jump of the linear stage, and where the coarse contact problem has moved bodies since
(``coarse.problem``). What does not move any more loads no spring, whatever ε: these are proximal
points of the true laws, and end on them. Without a coarse problem they stay where they are, with a
share of what the tolerance allows.
"""

from __future__ import annotations

import math

import numpy as np

from orchestrator.config.method import STABLEST, SoleSettings
from orchestrator.scene.conditions.supports import loose_bodies
from orchestrator.scene.model import Scene

# ε of springs that begin anew, the weakest in an iteration: see ``coarse.problem`` for those before
ANEW = 1e-6
SHARE = 0.25  # of the law residual that the tolerance allows, with which auto begins
FLOOR = 2.0  # what is left of the law residual, over ε
NOTICED = 0.1  # ε over the law residual allowed, from which its floor is worth a warning
# discretisation error of a mesh finer than most: what ``error: auto`` may come to ask for a
# fraction of
FINE = 1e-2


def allowed_residual(tolerance) -> float:
    """The law residual that ``method.tolerance`` stands for; the paper's indicator is a squared
    ratio.
    """
    if tolerance.error == "auto":
        return tolerance.fraction * FINE
    return (
        math.sqrt(tolerance.indicator)
        if tolerance.indicator is not None
        else tolerance.law or tolerance.error
    )


def stabilisation(scene: Scene, method, scale: float = 1.0) -> np.ndarray:
    """(interfaces,) ε with which the iterations begin; zero where the law joins its sides.

    method : ``method`` of the configuration. With ``contact: {stabilisation: auto}`` interfaces
        alone that touch a loose body have one, so that a scene that holds together is left as it
        is; a number is that of all
    scale : factor on the soles that ``method`` asks for
    """
    opens = np.array([not i.law.joins for i in scene.interfaces], dtype=bool)
    asked = method.contact.stabilisation
    if not opens.any():
        return np.zeros(len(opens))
    if asked != "auto":
        return _on_usual_soles(float(asked), method, scale) * opens
    loose = loose_bodies(scene)
    touching = np.array([loose[list(i.subdomains)].any() for i in scene.interfaces], dtype=bool)
    share = ANEW if begin_anew(scene, method) else SHARE * allowed_residual(method.tolerance)
    return _on_usual_soles(share, method, scale) * (opens & touching)


def begin_anew(scene: Scene, method) -> bool:
    """Whether springs begin anew in every iteration: those of auto, where bodies are loose that the
    coarse problem moves.
    """
    return method.contact.stabilisation == "auto" and method.coarse != "none" and bool(
        loose_bodies(scene).any())


def _on_usual_soles(share: float, method, scale: float) -> float:
    """ε that makes the springs' rate ε keq what it is on the default soles: soles are how a scene
    is solved, not what it is.
    """
    return min(share * SoleSettings().contact_ratio / (scale * method.sole.contact_ratio), STABLEST)


def cautions(method) -> list[str]:
    """Return what a number costs that is not far below the tolerance."""
    asked, allowed = method.contact.stabilisation, allowed_residual(method.tolerance)
    if asked == "auto" or asked <= NOTICED * allowed:
        return []
    floor = FLOOR * asked
    says = (
        f"method.contact.stabilisation {asked:g} leaves a law residual of about {floor:.0e}, more "
        "where bodies go far: ")
    if floor >= allowed:
        return [says
                + f"the tolerance, {allowed:.0e}, is probably out of reach; take auto, or at most "
                f"{allowed * NOTICED:.0e}"]
    return [says
            + f"{floor / allowed:.0%} of the tolerance, {allowed:.0e}; {allowed * NOTICED:.0e} "
            "would hardly be felt"]

"""From the last iteration to what is delivered: fields of all load steps, forces, and guards on them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.guards import failed_guards, with_noise
from orchestrator.method.delivery.interior import interior
from orchestrator.method.delivery.interface_fields import InterfaceFields, all_interfaces, interface_fields, mean_of_sides
from orchestrator.method.delivery.loose import OpenPlaces, Stabilised, open_places, stabilised
from orchestrator.method.delivery.recovery import delivered, of_all, on_mesh, reactions, recover
from orchestrator.method.delivery.resultants import Resultants, interface_resultants
from orchestrator.method.iterated import Iterated
from orchestrator.method.load_cases import LoadCases, expanded
from orchestrator.method.stopping.discretisation import Estimate
from orchestrator.method.stopping.law_residuals import FIXED_POINT, LawResiduals, law_residuals
from orchestrator.method.stopping.lengths import LengthScale
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


@dataclass(frozen=True)
class Delivered:
    """What the method hands over: complete on rank 0, elsewhere that rank's part.

    Parameters
    ----------
    iterated : what the iterations ended with, for all load steps, with the noise of the answers in its bound; not
        converged where a guard is broken
    parts : per subdomain (T, n_E, 3), in equilibrium with its interface forces
    continuous : per subdomain (T, n_E, 3), continuous over perfect interfaces
    all_perfect : whether no interface opens
    interfaces : what happens on the interfaces that are not perfect; None where there are none
    laws : how well the laws hold there
    stabilised : what stabilisation carried; None where there is none
    places : how far those of loose bodies are determined; None where there are none
    reactions : per boundary entry, per load step, its resultant force
    reaction_moments : (entries, T, 3) their moments about the origin
    resultants : what all interfaces carry
    sole_scale : factor that contact's soles were given; None where there is no contact
    displacement : (T, n, 3) u_D, the field that the error bound speaks of; where interfaces open, the mean of the sides
    discretisation : its estimated error, if asked for
    joints : per subdomain (T, n_E, 3), what its interfaces' forces add up to at the nodes of a part whose mesh is not ours;
        None elsewhere
    """

    iterated: Iterated
    parts: list[np.ndarray | None]
    continuous: list[np.ndarray | None]
    all_perfect: bool
    interfaces: InterfaceFields | None
    laws: LawResiduals | None
    stabilised: Stabilised | None
    places: OpenPlaces | None
    reactions: list[list[list[float]]]
    reaction_moments: np.ndarray
    resultants: Resultants
    sole_scale: float | None
    displacement: np.ndarray | None = None
    discretisation: Estimate | None = None
    joints: list[np.ndarray | None] = field(default_factory=list)

    @property
    def sides(self) -> list[np.ndarray | None] | None:
        """As ``continuous``; None where no interface opens."""
        return None if self.all_perfect else self.continuous


def deliver(d: Decomposition, chosen: Decomposition, cases: LoadCases, iterated: Iterated, watch: Stopwatch) -> Delivered:
    """Recover what is delivered, and judge it; ``on_whole`` completes it.

    Parameters
    ----------
    d, chosen : the decomposition for all load steps, and for those of ``cases``, which have been iterated
    """
    with watch("linear_stage"):
        continuous, parts = ([part if part is None else cases.all_steps(part) for part in each]
                             for each in recover(chosen, iterated.fields, iterated.bound))
        iterated = expanded(d, iterated, cases)
    own = laws = lengths = places = None
    interfaces, inside = interface_fields(d, iterated), interior(d, iterated, parts)
    if d.all_perfect:
        iterated = with_noise(d, iterated, parts, inside)
    else:
        own = delivered(d, iterated.bound, parts)
        scale = LengthScale(d)
        lengths, places = scale(iterated.fields.u), open_places(iterated, scale, parts, d.space.team)
        laws = law_residuals([(pairs, *(x[t] for x in iterated.fields.extended), iterated.local.steps(t), before)
                              for t, pairs, before in iterated.by_pairing(d)], lengths, d.space.team)
        if d.nonlinear is not None:
            laws = laws.with_fixed_point(iterated.last.laws[FIXED_POINT])
    broken = failed_guards(d, iterated, parts, interfaces, lengths, inside)
    if broken:
        iterated = replace(iterated, converged=False, stop_reason=f"guard: {'; '.join(broken)}")
    carried, acting = stabilised(d, iterated), reactions(d, parts, iterated.fields.f, np.zeros(3))
    resultants = interface_resultants(d, iterated.fields.f)
    return Delivered(iterated, of_all(d, parts), of_all(d, continuous if own is None else own), d.all_perfect,
                     all_interfaces(d, interfaces), laws, carried, places,
                     acting[:, :, :3].tolist(), acting[:, :, 3:], resultants,
                     None if d.all_perfect else d.made.sole_scale,
                     joints=of_all(d, _on_joints(d, iterated.fields.f)) if any(s.foreign for s in d.scene.subdomains) else [])


def _on_joints(d: Decomposition, f: np.ndarray) -> list[np.ndarray | None]:
    """Per subdomain of the scene, what interface forces f (T, D) add up to at its nodes; None where its mesh is ours."""
    found, forces = [None] * len(d.scene.subdomains), d.space.loads(f)
    for s, trace, part in zip(d.own, d.made.traces, d.space.boundary):
        if s.foreign:
            own = np.zeros((len(f), 3 * len(s.nodes)))
            own[:, trace] = forces[:, part]
            found[s.index] = own.reshape(len(f), -1, 3)
    return found


def on_whole(delivered: Delivered, whole: Scene) -> Delivered:
    """With displacements on the nodes of the whole mesh, on rank 0."""
    return replace(delivered, displacement=(on_mesh if delivered.all_perfect else mean_of_sides)(whole, delivered.continuous))

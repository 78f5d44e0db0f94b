"""Delivery of the last iteration: fields of all load steps, forces, and guards on them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.errors import some
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.balance import Resultants, carried, interface_resultants
from orchestrator.method.delivery.checks import checked
from orchestrator.method.delivery.flux import ForceProbes
from orchestrator.method.delivery.guards import failed_guards, told_error, with_noise
from orchestrator.method.delivery.interface_fields import InterfaceFields, interface_fields
from orchestrator.method.delivery.lawful import Lawful, Shares, shares
from orchestrator.method.delivery.loose import OpenPlaces, Stabilised, open_places, stabilised
from orchestrator.method.delivery.met import Met
from orchestrator.method.delivery.recovery import (Parts, continuous, interior, joint_forces,
                                                   of_all, on_boundary, on_mesh,
                                                   reactions, recover, repositioned,
                                                   stored_energy)
from orchestrator.method.delivery.tools import PlacedTool, placed
from orchestrator.method.iterated import Iterated, LoadCases, expanded
from orchestrator.method.stopping.backward import Backward, Solved, backward_error
from orchestrator.method.stopping.bodies import body_residual, judged_together
from orchestrator.method.stopping.error_estimate import ErrorEstimate
from orchestrator.method.stopping.law_residuals import (
    FIXED_POINT, OF_BODIES, LawResiduals, Lengths, LengthScale, law_residuals)
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


@dataclass(frozen=True)
class ContactFound:
    """Results where interfaces are not perfect."""

    laws: LawResiduals  # how well the laws hold there
    stabilised: Stabilised | None  # what stabilisation carried; None where there is none
    # how far those of loose bodies are determined; None where there are none
    places: OpenPlaces | None
    sole_scale: float  # factor that contact's soles were given
    # for which surfaces the result is exact; None where that is not known
    backward: Backward | None
    shares: Shares | None  # where the energy error comes from; None where that is not known


@dataclass(frozen=True)
class Delivered:
    """The method's results: complete on rank 0, elsewhere that rank's part; per subdomain (T, n_E,
    3).
    """

    # for all load steps, with the noise of the answers in its bound; not converged where a guard is
    # broken
    iterated: Iterated
    # in equilibrium with its interface forces: with lawful ones where an energy error is known, see
    # ``lawful``
    parts: Parts
    continuous: Parts  # continuous over perfect interfaces
    # of the interfaces that are not perfect; None where all are
    interfaces: InterfaceFields | None
    contact: ContactFound | None  # None where no interface opens
    # (entries, T, 6) per boundary entry its resultant force, and its moment about the origin
    reactions: np.ndarray
    resultants: Resultants  # what all interfaces carry
    energy: np.ndarray  # (T,) stored
    # interfaces' forces at the nodes of a part whose mesh is not ours; None elsewhere
    joints: Parts
    # name of a probe of forces → (T, c) what these are
    carried: Mapping[str, np.ndarray]
    felt: float  # all forces that soles feel
    # what rank 0 finds, see ``told``: where sides meet, where rigid tools are
    met: Met | None = None
    tools: Sequence[PlacedTool] = ()
    # (T, n, 3) u_D, that of the error bound; where interfaces open, the mean of the sides
    displacement: np.ndarray | None = None
    discretisation: ErrorEstimate | None = None  # its estimated error, if asked for

    def told(self, scene: Scene, interfaces: InterfaceFields | None,
             unsound: Collection[int], within: Mapping[str, np.ndarray]) -> Delivered:
        """Return it with what rank 0 finds, and checks, of all ranks' fields.

        scene : the whole one
        interfaces : of all ranks
        unsound : subdomains of whose matter stresses are not known, and so no forces in it
        within : name of a probe of forces → subdomains that carry them
        """
        found, carried, iterated = [], dict(self.carried), self.iterated
        if interfaces is not None and iterated.converged:
            found = checked(scene, interfaces, self.resultants, told_error(iterated), self.felt)
        if found:
            iterated = replace(iterated, converged=False, stop_reason=f"check: {'; '.join(found)}")
        for name, those in within.items():
            if np.isin(those, list(unsound)).any():
                carried[name] = np.full_like(carried[name], np.nan)
        return replace(self, iterated=iterated, carried=carried, interfaces=interfaces,
                       met=Met.of(scene, interfaces, self.resultants),
                       tools=placed(scene, self.continuous, interfaces),
                       displacement=on_mesh(scene, self.continuous))

    @property
    def sides(self) -> Parts | None:
        """Displacements as ``continuous``; None where no interface opens."""
        return self.contact and self.continuous


def deliver(d: Decomposition, cases: LoadCases, iterated: Iterated, watch: Stopwatch,
            wanted: ForceProbes = ForceProbes()) -> Delivered:
    """Recover what is delivered, and judge it; what rank 0 finds of it is its to add.

    d : the decomposition for all load steps
    cases : those that have been iterated
    wanted : forces that probes ask for
    """
    if d.nonlinear is not None:  # under the pseudo-loads that matter has by now
        d = d.reloaded()
        iterated = replace(iterated, bound=d.bounded(iterated.fields))
    with watch("linear_stage"):
        ours, parts = ([part if part is None else cases.all_steps(part) for part in each]
                       for each in recover(iterated.problem if cases.left_out else d,
                                           iterated.fields, iterated.bound))
        iterated = expanded(d, iterated, cases)
    contact = lengths = None
    with watch("bound"):
        lawful = Lawful.of(d, iterated, parts)
        backward = _backward(d, iterated, parts, lawful)
    interfaces = interface_fields(d, iterated, lawful and iterated.bound.pair,
                                  backward and backward.shift)
    inside = interior(d, iterated, parts)
    if d.all_perfect:
        iterated = with_noise(d, iterated, parts, inside)
    else:
        ours, scale = continuous(d, iterated.bound, parts), LengthScale(d)
        lengths = scale(iterated.fields.u)
        laws = _laws(d, iterated, lengths, scale)
        contact = ContactFound(laws, stabilised(d, iterated),
                               open_places(d, iterated, scale, laws, parts), d.made.sole_scale,
                               backward,
                               lawful and shares(d, iterated.bound, lawful, inside.energy))
        iterated = replace(iterated, found={**iterated.found, "unsolved": unsolved(d, iterated)})
    # what has stopped by itself says why: far from an answer, or far away, rounding breaks guards
    broken = failed_guards(d, iterated, parts, interfaces, lengths, inside,
                           lawful) if iterated.converged else []
    if broken:
        iterated = replace(iterated, converged=False, stop_reason=f"guard: {'; '.join(broken)}")
    f, taken = iterated.fields.f, None
    if lawful is not None:
        parts, f, taken = lawful.parts, lawful.f, lawful.taken
    resultants, through = interface_resultants(d, f), carried(d, parts, f, wanted)
    felt, = d.space.team.sum(np.abs(d.stage.direction.times(iterated.fields.w)).sum(axis=1))
    # with it the codes' models would stay, and all that was set up
    iterated = replace(iterated, problem=None, between={}, met=())
    energy, joints = stored_energy(d, ours,
                                   iterated.bound.energy), any(
                                       s.foreign for s in d.scene.subdomains)
    return Delivered(iterated, of_all(d, parts), of_all(d, ours),
                     interfaces and interfaces.numbered(d.scene.number), contact,
                     reactions(d, parts, f, taken), resultants, energy,
                     of_all(d, joint_forces(d, f)) if joints else [], through, felt.max())


def _laws(d: Decomposition, iterated: Iterated, lengths: Lengths,
          bodies: LengthScale) -> LawResiduals:
    """Residuals of the laws in all load steps, by the measures that the run was judged with."""
    measured = [(pairs, *(x[t] for x in iterated.fields.extended), iterated.local.steps(t), before)
                for t, pairs, before in iterated.by_pairing()]
    laws = law_residuals(measured, lengths, d.space.team)
    if d.nonlinear is not None:
        laws = laws.and_also(FIXED_POINT, iterated.last.laws[FIXED_POINT])
    if OF_BODIES in iterated.last.laws:
        laws = laws.and_also(OF_BODIES,
                             body_residual(measured, lengths.of_rest, d.space,
                                           judged_together(d.scene, bodies)))
    return laws


def unsolved(d: Decomposition, iterated: Iterated) -> list[str]:
    """A sentence where groups are left without forces that their laws allow, and what helps."""
    found, count = iterated.local.unsolved, np.zeros(len(d.scene.interfaces))
    for i, at in d.local.pairs.each():  # at which they begin
        count[i.index] = found[:, at].any(axis=0).sum()
    count, = d.space.team.sum(count)
    names, total = [i.name for i, n in zip(d.scene.interfaces, count) if n], int(count.sum())
    return [
        f"{total} group{'s' * (total > 1)} of node pairs, where several bodies meet at one place, "
        f"on {some(names)}: no forces were found that all their laws allow together; less friction "
        "there, smaller load steps (method.increment=1), or a law that joins two of these bodies"
    ] if total else []


def _backward(d: Decomposition, iterated: Iterated, parts: Parts,
              lawful: Lawful | None) -> Backward | None:
    """The shifts for which the result is exact, where an energy error is known."""
    if d.certificate is None:
        return None
    u = on_boundary(d, [parts[s.index] for s in d.own], d.steps)
    between = {step: [Solved(x.problem.certificate, x.bound, x.fields, x.fields.u + on_boundary(
        d, repositioned(d, x.bound), len(x.bound.repositioned))) for x in parts]
               for step, parts in iterated.between.items()}
    return backward_error(
        Solved(d.certificate, iterated.bound, iterated.fields, u, lawful and lawful.x), between)

"""Guards on the delivered fields: what holds in every sound result, so that one that breaks it is
not believed.

- external work: ‖u‖²_K from interface data by duality, against loads, interface forces and
reactions times
  the displacements of all nodes, which another back-substitution has given; both are ≥ 0;
- repetition: the last back-substitution gives the interface displacements that the iterations have
combined from
  all earlier ones; no error below what both, and the forces they stand for, differ by in energy
  norm can be claimed;
- the interior: the energy of the recovered field, summed over its tets, is that of the iterations,
and every free node
  is in equilibrium, see ``recovery``; what is left over is part of the error, too;
- interface laws, node by node on the written fields: what each law itself says is broken;
- balance of every body: its loads, its supports' reactions and what its interfaces carry, forces
and moments.

The answers on the way are guarded where they arrive: finite numbers and the residual of a probe
solve after each factorisation in ``blackbox.messages``, reciprocity and strain energies in
``answers``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.laws.base import Written
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.balance import balance
from orchestrator.method.delivery.interface_fields import (
    InterfaceFields, geometry_shown, own_interfaces)
from orchestrator.method.delivery.lawful import Lawful
from orchestrator.method.delivery.recovery import Interior, Parts, interior, repositioned
from orchestrator.method.interface.pairing import lawful_nodes
from orchestrator.method.interface.rows import dots, peak, times
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.law_residuals import Lengths

NOISE = 5.0  # errors inside the subdomains, and of both, over the difference seen on the interfaces
NOTICED = 0.2  # share of the bound from which on noise is part of it
WORK = 1e-5  # relative difference of the two external works
# a node's violation, or that of bonded bodies' balance, over the law residual or error that the run
# claims
LAWS = 100.0
BEYOND = 10.0  # noise of answers over the tolerance, with contact
ROUNDING = 1e-9  # of all forces that soles feel, what counts as none


def failed_guards(d: Decomposition, iterated: Iterated, parts: Parts,
                  interfaces: InterfaceFields | None,
                  lengths: Lengths | None = None, inside: Interior | None = None,
                  lawful: Lawful | None = None) -> list[str]:
    """Say what the delivered fields of a run that has converged break, a sentence each.

    interfaces, lengths : fields of this rank's interfaces that are not perfect, if the scene has
        any, and what they are compared with
    inside : of these parts; None: it is found here
    lawful : forces and fields that are delivered in their place, if there are
    """
    inside = inside or interior(d, iterated, parts)
    found = _works(d, iterated, parts, inside)
    length = None if interfaces is None else geometry_shown(d.scene, own_interfaces(d)).length
    allowed = LAWS * max(iterated.bound.relative if d.all_perfect else iterated.last.law_residual,
                         ROUNDING)
    off = allowed if d.all_perfect else max(told_error(iterated), ROUNDING)
    unbalanced = _balances(d, iterated, parts, (interfaces, lengths), off, lawful)
    share = NOISE * float(np.hypot(*inside.shares(d.loading.size(iterated.bound.energy))))
    # where all are, it is part of the bound
    if not d.all_perfect and share > BEYOND * max(iterated.last.target[1], ROUNDING):
        found.append(
            "repeated answers of the code differ, most in "
            f"{d.scene.subdomains[inside.worst()].name}: no error below {share:.1e} can be claimed")
    if interfaces is not None:
        found += _laws(d, interfaces, length, lengths, allowed)
    return found + unbalanced


def told_error(iterated: Iterated) -> float:
    """Return the relative error that a run with contact tells: of energy where that is known, and
    of its laws.
    """
    known = [x for x in (iterated.bound.relative, iterated.last.law_residual) if np.isfinite(x)]
    return max(known, default=0.0)


def works(d: Decomposition, iterated: Iterated,
          parts: Parts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two external works and the size of the terms that they sum, each (T,) force × length."""
    fields, steps = iterated.fields, d.scene.steps
    forces = d.space.loads(fields.f)
    inner = d.loading.energy_of(d.space.loads(d.stage.robin_of(fields)), fields.u, forces)
    outer, size = np.zeros((2, steps))
    for s, rim, part, trace in zip(d.own, d.made.rims, d.space.boundary, d.made.traces):
        u = parts[s.index].reshape(steps, -1)
        load = np.where(s.fixed, 0.0, s.loads).reshape(steps, -1)
        load[:, trace] += forces[:, part]
        if s.fixed.any() and len(rim.nodes):
            held = np.flatnonzero(s.fixed[rim.nodes])
            rows, moved = rim.stiffness[held], u[:, rim.dofs]
            load[:, rim.dofs[held]] += (rows @ moved.T).T
            # prescribed rigid motions do no work, but leave rounding
            size += ROUNDING * np.sum(np.abs(moved[:, held]) * (abs(rows) @ np.abs(moved).T).T,
                                      axis=1)
        outer += np.sum(u * load, axis=1)
        size += np.sum(np.abs(u * load), axis=1)
    return tuple(d.space.team.sum(inner, outer, size))


def with_noise(d: Decomposition, iterated: Iterated, parts: Parts,
               inside: Interior | None = None) -> Iterated:
    """Add the noise of the answers to the bound; not converged any more if that is too much."""
    inside = inside or interior(d, iterated, parts)
    unbalanced, _ = inside.shares(d.loading.size(iterated.bound.energy))
    bound, floor = iterated.bound.relative, NOISE * float(
        np.hypot(noise(d, iterated, parts), unbalanced))
    if not floor > NOTICED * bound:
        return iterated
    iterated = replace(iterated,
                       bound=replace(iterated.bound, relative=float(np.hypot(bound, floor))))
    name, wanted = iterated.last.target
    if not iterated.converged or name != "error_bound" or iterated.bound.relative <= wanted:
        return iterated
    return replace(iterated, converged=False, stop_reason=(
        f"guard: repeated answers of the code differ: no error below {floor:.1e} can be claimed"))


def noise(d: Decomposition, iterated: Iterated, parts: Parts) -> float:
    """Energy norm of what recovered and iterated interface displacements differ by, and of the
    forces that go with it,
    relative to the solution's."""
    apart = np.zeros_like(iterated.fields.u)
    for s, rigid, part, trace in zip(d.own, repositioned(d, iterated.bound), d.space.boundary,
                                     d.made.traces):
        apart[:, part] = parts[s.index].reshape(d.scene.steps,
                                                -1)[:,
                                                    trace] - iterated.fields.u[:, part] - rigid[
                                                        :, trace]
    # forces are what k w leaves of s: stiff soles turn a small difference of w into a large one of
    # f
    forces = d.stage.direction.robin(apart)
    strain = dots(apart, times(d.bound.stiffness, apart))
    stress = np.sum(forces**2 / d.bound.continuity.weight, axis=1)
    energy, = d.space.team.sum(strain + stress)
    size = d.loading.size(iterated.bound.energy)
    return float(np.sqrt(energy.max(initial=0.0)) / size) if size > 0 else 0.0


def _works(d: Decomposition, iterated: Iterated, parts: Parts, inside: Interior) -> list[str]:
    inner, outer, size = works(d, iterated, parts)
    # where nothing is strained, what rounding leaves of the soles' energy, and of what loads would
    # do alone, is no work
    soles, = d.space.team.sum(dots(iterated.fields.w, d.stage.direction.times(iterated.fields.w)))
    noise = peak(soles) + peak(d.loading.alone)
    scale = max(peak(size), ROUNDING * noise, np.finfo(float).tiny)
    found = []
    if not np.isfinite([inner, outer]).all():
        return ["energies are not finite"]
    apart = peak(inner - outer) / scale
    if apart > WORK:
        found.append(
            f"the external work differs by {apart:.1e} between forces times displacements and "
            "interface data")
    apart = peak(inner - inside.energy.sum(axis=1)) / scale if inside.complete else 0.0
    if apart > WORK:
        found.append(
            "the energy of the recovered field, tet by tet, is not that of the iterations: it "
            f"differs by {apart:.1e}, most in {d.scene.subdomains[inside.worst()].name}")
    least = min(inner.min(initial=0.0), outer.min(initial=0.0),
                iterated.bound.energy.min(initial=0.0))
    if least < -WORK * scale:
        found.append(f"a strain energy is negative ({least:.2g})")
    return found


def _balances(d: Decomposition, iterated: Iterated, parts: Parts,
              met: tuple[InterfaceFields | None, Lengths | None], allowed: float,
              lawful: Lawful | None) -> list[str]:
    """The body that is farthest from balance, if one is; on rank 0. ``met``: interfaces,
    lengths."""
    (interfaces, lengths), f, taken = met, iterated.fields.f, None
    if lawful is not None:
        parts, f, taken = lawful.parts, lawful.f, lawful.taken
    found = balance(d, parts, f, interfaces, iterated, taken)
    # where next to nothing acts, forces are what rounding leaves of k w and of K u, or what laws
    # take for rest
    resting, noise = 0.0, np.abs(d.stage.direction.times(iterated.fields.w)).sum(axis=1)
    if lengths is not None:
        pairs = d.local.pairs
        resting = lengths.of_rest * pairs.points.stiff_n[pairs.mine].sum()
    for s, rim in zip(d.own, d.made.rims):
        if s.fixed.any():
            moved = np.abs(parts[s.index][:, rim.nodes].reshape(d.scene.steps, -1))
            noise += moved @ np.abs(rim.stiffness).sum(axis=0)
    resting, noise = d.space.team.sum(resting, noise)
    scale = max(peak(found.size), float(resting), ROUNDING * peak(noise), np.finfo(float).tiny)
    apart = np.abs(found.left).max(axis=(0, 2)) / scale
    worst = int(np.argmax(apart))  # nan stays
    if d.space.team.rank or apart[worst] <= allowed:
        return []
    return [
        f"forces on {found.names[worst]} are out of balance by {apart[worst]:.1e}, {allowed:.1e} "
        "allowed"]


def _laws(d: Decomposition, interfaces: InterfaceFields, length: np.ndarray, lengths: Lengths,
          allowed: float) -> list[str]:
    worst: dict[str, float] = {}
    points = d.local.pairs.points
    stiff = d.space.team.max(peak(points.stiff_n / points.area))[0]
    size = np.maximum(np.abs(interfaces.pressure),
                      np.linalg.norm(interfaces.friction_traction, axis=2)).max(axis=0)
    largest = {str(law): peak(size[(interfaces.laws == law)[interfaces.interface_of_node]])
               for law in set(interfaces.laws)}
    pressures = {law: max(value, lengths.of_rest * stiff) or 1.0
                 for law, value in _largest(d, largest).items()}
    for i, (_, own) in zip(own_interfaces(d), interfaces.each()):
        nodes = lawful_nodes(i)
        nodes = nodes[np.isin(nodes, i.shown)]
        at = own.start + np.searchsorted(i.shown, nodes)
        fields = (interfaces.gap[:, at] - i.distances(interfaces.steps)[:, nodes],
                  interfaces.slip[:, at],
                  interfaces.pressure[:, at], interfaces.friction_traction[:, at])
        variables = {name: interfaces.own[name][:, at] for name in i.law.variables}
        for law, steps in [(law, slice(t, t + 1)) for t, law in enumerate(i.law_at_steps)] or [
            (i.law, slice(None))]:
            written = Written(*(x[steps] for x in fields), nodes, length[at],
                              {name: x[steps] for name, x in variables.items()})
            # where next to nothing moves and much is pressed, gaps are as small as forces are
            # accurate
            moved = max(lengths.of_displacements, pressures[law.name] / stiff if stiff else 0.0)
            for what, value in law.violations(written, moved, pressures[law.name]).items():
                worst[what] = np.maximum(worst.get(what, 0.0), value)  # nan stays
    return [f"{what} violated at a node by {value:.1e}, {allowed:.1e} allowed"
            for what, value in _largest(d, worst).items() if not value <= allowed]


def _largest(d: Decomposition, own: dict[str, float]) -> dict[str, float]:
    """The largest value of all ranks; nan stays."""
    result: dict[str, float] = {}
    for found in d.space.team.all_gather(own):
        for name, value in found.items():
            result[name] = np.maximum(result.get(name, 0.0), value)
    return result

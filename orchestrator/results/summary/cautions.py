"""Sentences on what a run has done outside the theory it rests on (small perturbations, moderate
friction, parts that end up
inside each other where no interface keeps them apart, sides that slide far, tools that roll), and
on meshes that are too coarse.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from orchestrator.errors import LITTLE, some
from orchestrator.method.delivery.met import Met
from orchestrator.method.delivery.moved import Moved, Passed, passing
from orchestrator.method.delivery.tools import PlacedTool
from orchestrator.scene.cautions import LOCKING, scene_cautions
from orchestrator.scene.conditions.rigid import DISPLACEMENT, ROTATION
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.model import Scene

# from which it is told: the estimated discretisation error, relative, energy norm, by whose square
# the energy itself is off; the share of pressures by which curved sides that slide may have them
# wrong, or gaps of tools' be off
TOLD = 0.1
# of an element, slips beyond which are told; beyond the whole of it pairs no longer face each other
FIFTH = 0.2


def cautions(scene: Scene, sides: list[np.ndarray], met: Met | None = None,
             detached: Iterable[list[str]] = (),
             discretisation_error: float | None = None) -> list[str]:
    """Sentences that a reader of the results must know.

    sides : per subdomain (steps, n_E, 3) displacement
    met : the interfaces that are not perfect; None where all are
    detached : names per load step; where such bodies are means nothing, so that they are left out
    discretisation_error : estimated, relative, energy norm; None: not known
    """
    lost = {name for step in detached for name in step}
    # which may go anywhere
    tools = {i.subdomains[1] for i in scene.interfaces if i.tool is not None}
    moved = Moved.of(scene, sides)
    kept = [s for s in scene.subdomains if s.body not in lost and s.index not in tools]
    result = [*scene_cautions(scene)]
    if (error := discretisation_error) is not None and error > TOLD:
        finer, linear = (
            "halve the element size where fields/ show large discretisation_error",
            scene.mesh.cells.shape[1] == 4)
        locks = any(scene.materials[m].poisson > LOCKING for m in scene.used)
        cure = finer if not linear else "take blackbox: {element: P2}" + (
            "" if locks else f", or {finer}")
        result.append(
            f"the mesh's own error is about {error:.0%} (estimated, relative, energy norm), far "
            f"above that of the iterations: {cure}")
    far = list(
        dict.fromkeys(s.body for s in kept if moved.displacement[s.index] > DISPLACEMENT
                      * moved.size[s.index]))
    if far:
        result.append(f"{some(far)} displaced by more than {DISPLACEMENT:.0%} of the body's size: "
                      "outside small perturbations, which the results rest on")
    angle: dict[str, float] = {}
    for s in kept:
        angle[s.body] = max(angle.get(s.body, 0.0), float(moved.rotation[s.index]))
    turned = [name for name, a in angle.items() if a > ROTATION]
    if turned:
        result.append(
            f"{some(turned)} rotated by up to {max(angle.values()):.2g} rad: outside small "
            f"perturbations (up to about {ROTATION} rad), which the results rest on")
    result += passing_through(scene, passing(scene, sides), lost)
    return result if met is None else [*result, *_of_interfaces(scene, met)]


def _of_interfaces(scene: Scene, met: Met) -> list[str]:
    said: dict[str, list[str]] = {}
    for i in scene.interfaces:
        said.setdefault(i.law.caution, []).append(i.name)
    result = [*(f"{some(names)} {caution}" for caution, names in said.items() if caution),
              *_sliding(met), *_unresolved(met.unresolved)]
    laws = [i.law for i in scene.opening]
    cut = [k for k, (part, law) in enumerate(zip(met.within, laws)) if part >= 0 and not law.joins]
    if cut:
        parts = sorted({scene.mesh.volumes[v] for v in met.within[cut]})
        names = " and ".join(sorted({laws[k].name for k in cut}))
        result.append(
            f"{names} on {len(cut)} interface{'s' * (len(cut) > 1)} inside one part "
            f"({some(parts)}): it can open and slip along cuts that the real part does not have")
    return result


def passing_through(scene: Scene, passed: Iterable[Passed], lost: Iterable[str] = ()) -> list[str]:
    """A sentence per pair of parts; ``lost``: names of bodies whose place means nothing."""
    volumes, lost = scene.mesh.volumes, set(lost)
    return [
        f"{volumes[one]!r} and {volumes[two]!r} pass through each other by about {found.depth:.3g} "
        f"at load step {step + 1}, at {format_point(found.where)}, where they have no interface: "
        "mesh both sides alike there, let the law read the gap (contact: gap: geometry), or have "
        "pairs found from farther apart (between: auto with tolerance: 1, or within: a length)"
            for (one, two), bodies, step, found in passed if not bodies & lost]


def _unresolved(found: Mapping[str, tuple[int, int]]) -> Iterator[str]:
    """A sentence for pairs of bodies whose place of contact is not resolved at some load step."""
    if found:
        places = [f"{name} ({points} points carry it at load step {step})"
                  for name, (points, step) in found.items()]
        yield (
            f"the place of contact is hardly wider than a face: {some(places)}; neither its "
            "pressures nor the estimated error of the mesh are to be believed there: make elements "
            "smaller")


def _sliding(met: Met) -> Iterator[str]:
    """A sentence for those that slid by more than an element, by more than a fifth, and on curved
    faces by too much for these.
    """
    far, bent = met.slides, dict(zip(met.names, met.amiss.tolist()))
    if much := [name for name, share in far.items() if share > 1]:
        yield (f"{some(much)} slid by more than an element: node pairs do not follow, "
               "large sliding is outside small perturbations; between parts meshed each on its "
               "own contact has pairing: follow")
    if more := {name: share for name, share in far.items() if FIFTH < share <= 1}:
        yield (
            f"{some(sorted(more, key=more.get, reverse=True))} slid by up to "
            f"{max(more.values()):.2g} of an element: node pairs do not follow, and forces act "
            "where they did before loading; between parts meshed each on its own contact has "
            "pairing: follow")
    if wrong := {name: share for name, far_ in far.items() if far_ <= 1
                 and (share := bent[name]) > TOLD}:
        yield (
            f"{some(sorted(wrong, key=wrong.get, reverse=True))} slid on curved faces that do not "
            f"conform: pressures may be off by {min(max(wrong.values()), 1.0):.0%} of the largest, "
            "as node pairs do not follow; between parts meshed each on its own contact has "
            "pairing: follow")


def tool_cautions(placed: Sequence[PlacedTool]) -> Iterator[str]:
    """A sentence on each tool whose contact is not that with its surface, or that faces without
    contact have passed through.
    """
    for one in placed:
        told = [f"gaps are off by up to {one.apart:.0%} of what presses"] * (one.apart > TOLD) + \
            [f"forces point {one.turned:.1%} of their size elsewhere"] * (one.turned > LITTLE)
        if told:
            yield (
                f"{one.tool.name} has moved along its curved surface: {' and '.join(told)}; "
                "smaller motions are told right")
        if one.passed is not None:
            depth, step, where = one.passed
            yield (
                f"{some(one.parts)} passes through {one.tool.name} by {depth:.3g} at load step "
                f"{step + 1}, at {format_point(where)}, where no faces were sought that it may "
                "touch: write within: with a larger length, or angle: for faces that look aside")


def of_unheld(scene: Scene, detached: Sequence[list[str]]) -> Iterator[str]:
    """A sentence on each probe of displacements of bodies that nothing holds at some load step:
    they may be anywhere.

    detached : names of these bodies, per load step
    """
    for probe in scene.probes:
        if probe.of != "displacement":
            continue
        bodies = {scene.subdomains[e].body for e in probe.subdomains}
        steps = [str(step) for step, names in enumerate(detached, 1) if bodies & set(names)]
        if steps:
            yield (f"probe {probe.name!r} tells displacements of {some(sorted(bodies))}, which "
                   f"nothing holds at load step{'s' * (len(steps) > 1)} {some(steps)}: they mean "
                   "nothing there")

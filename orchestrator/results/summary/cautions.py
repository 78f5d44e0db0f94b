"""Sentences on what a run has done outside the theory it rests on (small perturbations, moderate friction, parts that end up
inside each other where no interface keeps them apart), and on meshes that are too coarse.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from orchestrator.errors import some
from orchestrator.method.delivery.met import Met
from orchestrator.method.delivery.moved import Moved
from orchestrator.method.delivery.passing import Passed, passing
from orchestrator.results.summary.resolution import sliding, unresolved
from orchestrator.scene.cautions import LOCKING, scene_cautions
from orchestrator.scene.conditions.rigid import DISPLACEMENT, ROTATION
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.model import Scene

COARSE = 0.1  # estimated discretisation error, relative, energy norm: the energy itself is off by its square


def cautions(scene: Scene, sides: list[np.ndarray], met: Met | None = None,
             detached: Iterable[list[str]] = (), discretisation_error: float | None = None, moved: Moved | None = None,
             passed: Sequence[Passed] | None = None) -> list[str]:
    """Sentences that a reader of the results must know.

    sides : per subdomain (steps, n_E, 3) displacement; not asked for where the scene is known by its outline alone
    met : the interfaces that are not perfect; None where all are
    detached : names per load step; where such bodies are means nothing, so that they are left out
    discretisation_error : estimated, relative, energy norm; None: not known
    moved : how subdomains have moved, passed : which parts are inside each other; None: it is found from ``sides``
    """
    lost = {name for step in detached for name in step}
    tools = {i.subdomains[1] for i in scene.interfaces if i.tool is not None}  # which may go anywhere
    moved = Moved.of(scene, scene.subdomains, sides) if moved is None else moved
    kept = [s for s in scene.subdomains if s.body not in lost and s.index not in tools]
    result = [*scene_cautions(scene)]
    if (error := discretisation_error) is not None and error > COARSE:
        finer, linear = "halve the element size where fields/ show large discretisation_error", scene.mesh.cells.shape[1] == 4
        locks = any(scene.materials[m].poisson > LOCKING for m in scene.used)
        cure = finer if not linear else "take blackbox: {element: P2}" + ("" if locks else f", or {finer}")
        result.append(f"the mesh's own error is about {error:.0%} (estimated, relative, energy norm), far above that of the iterations: {cure}")
    far = list(dict.fromkeys(s.body for s in kept if moved.displacement[s.index] > DISPLACEMENT * moved.size[s.index]))
    if far:
        result.append(f"{some(far)} displaced by more than {DISPLACEMENT:.0%} of the body's size: "
                      "outside small perturbations, which the results rest on")
    angle: dict[str, float] = {}
    for s in kept:
        angle[s.body] = max(angle.get(s.body, 0.0), float(moved.rotation[s.index]))
    turned = [name for name, a in angle.items() if a > ROTATION]
    if turned:
        result.append(f"{some(turned)} rotated by up to {max(angle.values()):.2g} rad: outside small perturbations "
                      f"(up to about {ROTATION} rad), which the results rest on")
    result += passing_through(scene, passing(scene, sides) if passed is None else passed, lost)
    return result if met is None else [*result, *_of_interfaces(scene, met)]


def _of_interfaces(scene: Scene, met: Met) -> list[str]:
    said: dict[str, list[str]] = {}
    for i in scene.interfaces:
        if i.law.caution:
            said.setdefault(i.law.caution, []).append(i.name)
    result = [*(f"{some(names)} {caution}" for caution, names in said.items()), *sliding(met), *unresolved(met.unresolved)]
    laws = [i.law for i in scene.opening]
    cut = [k for k, (part, law) in enumerate(zip(met.within, laws)) if part >= 0 and not law.joins]
    if cut:
        parts = sorted({scene.mesh.volumes[v] for v in met.within[cut]})
        names = " and ".join(sorted({laws[k].name for k in cut}))
        result.append(f"{names} on {len(cut)} interface{'s' * (len(cut) > 1)} inside one part ({some(parts)}): "
                      "it can open and slip along cuts that the real part does not have")
    return result


def passing_through(scene: Scene, passed: Iterable[Passed], lost: Iterable[str] = ()) -> list[str]:
    """A sentence per pair of parts; ``lost``: names of bodies whose place means nothing."""
    volumes, lost = scene.mesh.volumes, set(lost)
    return [f"{volumes[one]!r} and {volumes[two]!r} pass through each other by about {found.depth:.3g} at load "
            f"step {step + 1}, at {format_point(found.where)}, where they have no interface: mesh both sides "
            "alike there, let the law read the gap (contact: gap: geometry), or have pairs found from farther "
            "apart (between: auto with tolerance: 1, or within: a length)"
            for (one, two), bodies, step, found in passed if not bodies & lost]

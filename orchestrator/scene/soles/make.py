"""The soles of all interfaces: which kind each gets, and what is made once for all that are alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.scene.congruence import first_congruent
from orchestrator.scene.model import Difficulty, Interface, Scene
from orchestrator.scene.soles.difficulty import difficulty
from orchestrator.scene.soles.facets import Facets, facets_of
from orchestrator.scene.soles.prisms import prisms
from orchestrator.scene.soles.overlap import overlap
from orchestrator.scene.soles.sole import Sole, merge


def make_soles(scene: Scene, settings, share: bool = True, wanted: Sequence[bool] | None = None) -> list[tuple[Sole, Sole] | None]:
    """The soles of every interface, first and second side, after ``method.sole`` of the configuration.

    share : layers on interfaces that differ by a translation alone are made once, then moved
    wanted : per interface; the others get none
    """
    hard = difficulty(scene) if settings.kind == "auto" else None
    soles: list[tuple[Sole, Sole] | None] = [None] * len(scene.interfaces)
    layered, kinds, facets = [], [], []  # facets of both sides, or of one for both where they lie upon each other
    for index, interface in enumerate(scene.interfaces):
        if wanted is not None and not wanted[index]:
            continue
        kind = settings.contact if not interface.law.perfect else kind_for(hard, interface) if hard else settings.kind
        kind = kind if len(interface.triangles) else "overlap"  # of nodes alone, where there are no facets to put a layer on
        paired = interface.mortar is None
        together = paired and np.array_equal(*(scene.side_nodes(interface, side) for side in (0, 1)))
        if kind == "overlap" and together:
            soles[index] = (overlap(scene, interface, settings.modulus_ratio),) * 2
            continue
        layered.append(index)
        kinds.append("symmetric" if kind == "overlap" else kind)
        upon = together or paired and np.array_equal(*(scene.side_points(interface, side) for side in (0, 1)))
        facets.append([facets_of(scene, interface, settings, kinds[-1], side) for side in ((0,) if upon else (0, 1))])
    for index, layer in zip(layered, _layers(kinds, facets, share)):
        soles[index] = layer
    return soles


def kind_for(hard: Difficulty, interface: Interface) -> str:
    """The kind that ``auto`` stands for on a perfect interface."""
    soft = hard.incompressible_or_slender[list(interface.subdomains)].any()
    return "overlap" if soft or hard.mixed_moduli[interface.index] else "symmetric"


def soles_of(facets: Facets, kind: str, second: Facets | None = None) -> tuple[Sole, Sole]:
    """The soles of the first and the second side; one and the same object when ``symmetric``.

    kind : layer, springs or symmetric
    second : the facets where the second side is, if not on the first
    """
    if kind in ("layer", "springs"):
        return prisms(facets, +1), prisms(second or facets, -1)
    both = []
    for f in [facets] if second is None else [facets, second]:
        one, two = (prisms(f, direction) for direction in (+1, -1))
        both.append(merge(replace(one, young=one.young / 2), replace(two, young=two.young / 2), len(f.points)))
    return both[0], both[-1]


def _layers(kinds: list[str], facets: list[list[Facets]], share: bool) -> list[tuple[Sole, Sole]]:
    """The soles of facets, those that differ by a translation alone from others as their copies."""
    keys = [(kind, *(f.triangles.tobytes() for f in own)) if share else number for number, (kind, own) in enumerate(zip(kinds, facets))]
    first = first_congruent(keys, [np.vstack([f.points for f in own]) for own in facets],
                            lambda i, j: all(a.same_matter(b) for a, b in zip(facets[i], facets[j])))
    soles: list[tuple[Sole, Sole]] = []
    for number, (kind, own) in enumerate(zip(kinds, facets)):
        if first[number] == number:
            soles.append(soles_of(own[0], kind, own[1] if len(own) > 1 else None))
            continue
        shift = own[0].points[0] - facets[first[number]][0].points[0]
        one, two = soles[first[number]]
        moved = replace(one, points=one.points + shift)
        soles.append((moved, moved if two is one else replace(two, points=two.points + shift)))
    return soles

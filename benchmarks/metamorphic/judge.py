"""Run a scene and one of its relations; say how they agree."""

from __future__ import annotations

import copy
import zlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.metamorphic.answers import BROKEN, CODE_FAILED, CONVERGED, REFUSED, SINGULAR, STOPPED, Answer, answer
from benchmarks.metamorphic.claims import claims_hold
from benchmarks.metamorphic.compare import distance, in_order_of
from benchmarks.metamorphic.oracle import in_one_piece
from benchmarks.metamorphic.relations import RELATIONS
from benchmarks.metamorphic.tools import tools
from benchmarks.metamorphic.variant import Variant

FINDINGS = ("disagree", "refused otherwise", "traceback", "code failed", "hang")
NO_CUT = ("disconnected subdomain", "without any tet", "coupling of a surface that",
          "pieces of one body", "cut lengthwise", "separate bodies", "subdomains for a mesh of", "a cut of")
LOOSE = 1e-2  # where a body has no place of its own, its friction, and with it what others carry, hangs on where it stands
ANEW = "paired anew"  # what a run says of sides that have slid by more than a fifth of an element
LOSSY = "they carry nothing"  # what a run says of cuts that leave corners of both bodies in which no node carries


@dataclass(frozen=True)
class Verdict:
    """Of one scene under some relations.

    Parameters
    ----------
    outcome : of the scene itself
    said : what it said
    tried : relation → agree, disagree, refused otherwise, stopped, traceback, code failed, not sayable
    details : relation → a sentence
    variants : relation → the other scene, of what is a finding
    """

    outcome: str
    said: str
    seconds: float
    tried: dict[str, str] = field(default_factory=dict)
    details: dict[str, str] = field(default_factory=dict)
    variants: dict[str, dict[str, Any]] = field(default_factory=dict)
    warnings: str = ""

    @property
    def findings(self) -> dict[str, str]:
        """Relation → what is wrong; the scene's own under the name 'itself'."""
        found = {k: v for k, v in self.tried.items() if v in FINDINGS}
        return ({"itself": self.outcome} if self.outcome in (BROKEN, CODE_FAILED) else {}) | found


def judge(data: dict[str, Any], relations: list[str], number: int = 0) -> Verdict:
    """Solves the scene and its variants.

    Parameters
    ----------
    number : what relations draw their turns, factors, names … with
    """
    first = answer(data)
    if first.outcome != CONVERGED:
        return Verdict(first.outcome, first.said, first.seconds)
    tried: dict[str, str] = {}
    details: dict[str, str] = {}
    variants: dict[str, dict] = {}
    seconds = first.seconds
    tried["in one piece"], details["in one piece"] = in_one_piece(first)
    for name in relations:
        variant = RELATIONS[name](copy.deepcopy(data), np.random.default_rng([number, zlib.crc32(name.encode())]))
        if variant is None:
            tried[name] = "not sayable"
            continue
        second = answer(variant.data)
        seconds += second.seconds
        tried[name], details[name] = _verdict(first, second, variant)
        if tried[name] != "agree":
            variants[name] = variant.data
    return Verdict(first.outcome, "", seconds, tried, details, variants, first.said)


def _verdict(first: Answer, second: Answer, variant: Variant) -> tuple[str, str]:
    blocks = isinstance(variant.data["subdomains"], dict)  # planes that run through the midst of tets cut others when these are turned
    if second.outcome == REFUSED and (variant.cuts or blocks) and any(text in second.said for text in NO_CUT):
        return "not sayable", second.said
    if second.outcome == CONVERGED:
        if slaves(first, variant.names) != slaves(second, {}):
            return "another slave", ""
        if variant.rough:
            return claims_hold(first, second)
        seen = variant.seen(second)
        if (ANEW in first.said) != (ANEW in second.said):  # one has slid so far that it is another discrete problem
            return "warned", ""
        walls = tools(variant.data)  # a node between two of them, or a pushed one on what is held, may lean on either
        pushed = len(walls) > 1 or any("force" in tool for tool in walls)
        apart = distance(first, in_order_of(first, seen) if variant.shuffled else seen, variant.joint or pushed)
        if any(loose(x) for x in (first, second)):  # pieces of a body too, which would strain it where they stand elsewhere
            apart = replace(apart, displacement=0.0, probe=0.0, allowed=max(apart.allowed, LOOSE))
        if variant.cuts and slaves(first, {}):  # operators on other pieces are other ones
            if LOSSY in first.said + second.said:
                return "warned", str(apart)
            apart = replace(apart, allowed=max(0.02, *(x.solution.summary["discretisation_error"] or 0.0 for x in (first, second))))
        return "agree" if apart.within else "disagree", str(apart)
    return {REFUSED: "refused otherwise", STOPPED: "stopped", BROKEN: "traceback", CODE_FAILED: "code failed",
            SINGULAR: SINGULAR}[second.outcome], second.said


def loose(answer: Answer) -> bool:
    """Whether the run names bodies that only its springs of stabilisation hold."""
    return any((answer.solution.summary["stabilised"] or {"bodies": []})["bodies"])


def slaves(answer: Answer, names: dict[str, str]) -> set[tuple[str, str]]:
    """Names of (slave, master) of the interfaces whose meshes do not match; ``names``: other → this one's."""
    scene, new = answer.solution.scene, {a: b for b, a in names.items()}
    found = {tuple(scene.subdomains[e].body for e in i.subdomains) for i in scene.interfaces if i.mortar is not None}
    return {(new.get(a, a), new.get(b, b)) for a, b in found}

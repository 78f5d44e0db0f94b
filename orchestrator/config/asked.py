"""Rules for what is asked of the solution: accuracies, certified values, probes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from orchestrator.config.mesh import KINDS
from orchestrator.config.paths import accuracies, all_perfect, called_twice, codes, entries, follows, get, is_number, is_vectors, shown
from orchestrator.errors import Problem, dotted


def accuracy_possible(data: Any) -> Iterator[Problem]:
    """The iterations' error is a part of what is asked for; what has no mesh of ours has no error that is known."""
    if not (asked := accuracies(data)):
        if get(data, "method", "accuracy") is not None:
            yield Problem(("method", "accuracy"), "limits without an accuracy", "error: a number, or accuracy: at a probe", "write one")
        return
    (where, least), tolerance = min(asked, key=lambda one: one[1] if is_number(one[1]) else math.inf), get(data, "method", "tolerance")
    error = get(tolerance, "error")
    if isinstance(tolerance, dict) and not (is_number(error) and is_number(least) and error < least):
        yield Problem(("method", "tolerance"), f"{shown(tolerance)} beside accuracy", "error: a number below the accuracy, or nothing: "
                      "a tenth of the accuracy", "remove tolerance")
    for path, part in entries(data, "parts", "*"):
        if kind := next((kind for kind in KINDS if part.get(kind) is not None), None):
            yield Problem((*path, kind), f"{kind} beside {dotted(where)}", "parts with meshes of this program's: the error of others "
                          "is not known, nor can they be meshed anew", f"remove {dotted(where)}")
    for path, entry in codes(data):
        if entry.get("form") is not None:
            yield Problem((*path, "form"), f"a form beside {dotted(where)}", "matter of the YAML's young and poisson: of other matter "
                          "stresses are not known", f"remove {dotted(where)}")
    if isinstance(get(data, "parts"), list) and len(data["parts"]) > 1 and not get(data, "interfaces"):
        yield Problem(("parts",), f"{len(data['parts'])} parts and no interfaces, beside {dotted(where)}", "an entry for what joins them: "
                      "finer meshes of parts do not match any more", "add interfaces: [{between: auto, law: perfect}], or law: contact")
    for path, probe in entries(data, "output", "probes", "*"):
        quantity, of = probe.get("quantity") or ("mean" if "on" in probe else ""), probe.get("of")
        if probe.get("accuracy") is None:
            continue
        if quantity in ("max", "min") or "stress" in (quantity, of):
            yield Problem((*path, "accuracy"), f"accuracy beside {quantity}{f' of {of}' if of else ''}", "a displacement at a point, its "
                          "mean over faces, a resultant or a section", "remove accuracy; method.accuracy has the field's stresses refined")
    if follows(data) and where[0] == "output":
        yield Problem(where, "accuracy beside pairing: follow", "sides that stay paired: what a small load does is asked of them as they "
                      "are", "write pairing: fixed")


def certified_fits(data: Any) -> Iterator[Problem]:
    """Intervals are of what is linear in displacements and forces, and need an energy error."""
    asked = [((*path, "certified"), probe) for path, probe in entries(data, "output", "probes", "*") if probe.get("certified") is True]
    for path, probe in asked:
        quantity, of = probe.get("quantity") or ("mean" if "on" in probe else "displacement"), probe.get("of") or "displacement"
        if quantity in ("max", "min"):
            yield Problem(path, f"certified beside {quantity} of {of}", "a displacement or a stress at a point, the mean of one over "
                          "faces, a resultant or a section: the energy error bounds no extreme", "remove certified, or ask for a mean")
    where = [path for path, _ in asked] + [("output", "certified")] * bool(get(data, "output", "certified"))
    if not where:  # laws are looked up for those who ask alone
        return
    perfect = all_perfect(data)
    other = [key for key in ("law", "indicator") if get(data, "method", "tolerance", key) is not None and not perfect]
    flowing = any(entry.get("nonlinear") is True for _, entry in entries(data, "blackbox", "*"))
    for why, there, cure in ((f"tolerance: {{{''.join(other[:1])}: …}}", other, "write tolerance: {error: 1e-4}"),
                             ("pairing: follow", follows(data), "write pairing: fixed"), ("nonlinear matter", flowing, "remove certified")):
        if there:
            yield Problem(where[0], f"certified beside {why}", "a run that knows its energy error", cure)


def probes_fit(data: Any) -> Iterator[Problem]:
    """Probes have names of their own, and keys that their quantity heeds."""
    yield from called_twice(data, ("output", "probes", "*"), "probe", "probe_{}")
    for path, probe in entries(data, "output", "probes", "*"):
        ends = probe.get("along")
        if is_vectors(ends) and len(ends) == 2 and ends[0] == ends[1]:
            yield Problem((*path, "along"), shown(ends), "two ends apart", "give another end, or at: for a point")
        resultant = probe.get("quantity") == "resultant"
        for key, fits, where in (("of", not resultant, "a mean or an extreme"), ("about", resultant, "a resultant")):
            if "on" in probe and probe.get(key) is not None and not fits:
                yield Problem((*path, key), f"{key} beside quantity: {shown(probe.get('quantity', 'mean'))}",
                              f"{key} beside {where} only", f"remove {key}")


def planes_have_points(data: Any) -> Iterator[Problem]:
    """One coordinate says where a plane is along x, y or z alone."""
    for keys in (("output", "probes", "*", "section"), ("bolts", "*", "cut")):
        for path, cut in entries(data, *keys):
            if isinstance(cut.get("plane"), list) and is_number(cut.get("at")):
                yield Problem((*path, "at"), shown(cut["at"]), "a point on the plane, beside a direction", "write at: [x, y, z]")

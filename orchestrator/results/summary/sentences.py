"""Sentences of a summary that take more than a format: what carries, is held, and how far numbers
are off.

Every function takes a summary as it is written to summary.json; nothing comes back where nothing is
known.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import hypot, inf, isfinite

import numpy as np

from orchestrator.errors import some
from orchestrator.method.events import COUNTED
from orchestrator.results.summary.summary import blackbox_seconds, stage_seconds, units_of

Summary = Mapping[str, object]

NAMES = 6  # bodies in a sentence
OWN = 10.0  # errors asked, told of a body's own beside its own energy from which it is named
# tolerances, told of a body's place from which it is named: what is off by ten has been told to be
# off by four at least
FAR = 3.0
SURE = 1e-6  # of the largest number of its kind: an error that is not told
ROUNDED = 1e-10  # of the largest of them: shown as zero


def vector(values: Sequence[float | None], largest: float | None = None) -> str:
    """Return components as text, as zero what rounding leaves of them beside the ``largest``, by
    default theirs.
    """
    known = [abs(x) for x in values if x is not None]
    least = ROUNDED * (max(known, default=0.0) if largest is None else largest)
    return "(" + ", ".join("–" if x is None else f"{x if abs(x) > least else 0.0:.5g}"
                           for x in values) + ")"


def largest(values: object) -> float:
    """Return the magnitude of the largest of numbers in lists of lists."""
    if isinstance(values, (list, tuple)):
        return max(map(largest, values), default=0.0)
    return 0.0 if values is None else abs(float(values))


def forces(summary: Summary, which: str) -> list[str]:
    """Return the forces of supports, or the sums of loads (``which``: support, or load), at the
    last load step; of a couple the moment.
    """
    names, reactions, count = summary.get("reaction_names") or [], summary.get(
        "reactions") or [], summary.get("load_steps") or 1
    kinds, most, unit = summary.get("reaction_kinds") or ["support"] * len(names), largest(
        reactions), units_of(summary)
    texts = []
    for name, steps, kind, (moment, alone) in zip(names, reactions, kinds,
                                                  _couples(summary)
                                                  or [(None, False)] * len(names)):
        if steps and (kind == "load") == (which == "load"):
            turn = [f"moment {vector(moment)}{unit['moment']}"] if moment else []
            texts.append(f"{name}: "
                         + ", ".join([f"{vector(steps[-1], most)}{unit['force']}"] * (not alone)
                                     + turn))
    return [text + f"  (load step {count} of {count})" * (count > 1 and not k)
            for k, text in enumerate(texts)]


def _couples(summary: Summary) -> list[tuple[list[float] | None, bool]]:
    """Of each entry of ``boundary`` the moment at the last load step, where it is more than any
    force within the box has, and whether
    beside it the force is nothing."""
    found, least = summary.get("reaction_moments") or {}, max(
        ROUNDED, summary.get("tolerance") or 0.0)
    if not found.get("size") or not all(summary["reactions"]):
        return []
    pairs = [(np.array(steps[-1], float), np.array(moments[-1], float))
             for steps, moments in zip(summary["reactions"], found["moments"])]
    # about the middle
    turned = [moment + np.cross(np.subtract(found["about"], found["middle"]), force)
              for force, moment in pairs]
    known = least * max(largest(summary["reactions"]) * found["size"], largest(found["moments"]))
    return [(moment.tolist(), bool(push <= least * turn))
            if (turn := np.linalg.norm(moment)) > max(push, known) else (None, False)
            for moment, (force, _) in zip(turned, pairs)
            for push in [np.linalg.norm(force) * found["size"]]]


def shown_statuses(counts: Mapping[str, list[int]] | None) -> list[str]:
    """Return the names of the statuses that say something: open, stick and slip only where there
    are such.
    """
    usual = [name for name in COUNTED if (counts or {}).get(name)]
    return (usual if any(any(counts[name]) for name in usual)
            else []) + [name for name in counts or () if name not in COUNTED]


def statuses(summary: Summary) -> str:
    """Return how many node pairs are open, stick, slip … at the last load step."""
    counts, steps = summary.get("status_counts"), summary.get("load_steps") or 1
    when = f"  (node pairs, load step {steps} of {steps})" if steps > 1 else "  (node pairs)"
    told = ", ".join(f"{counts[name][-1]:,} {name}" for name in shown_statuses(counts)
                     if any(counts[name]))
    return told and told + when


def probes(summary: Summary) -> list[str]:
    """Return the values of probes at the last load step."""
    units, texts = units_of(summary), []
    for probe in summary.get("probes") or ():
        kind = "" if probe["quantity"] in ("point", "resultant",
                                           "section") else f"{probe['quantity']} "
        unit = {"displacement": units["length"], "stress": units["stress"],
                "force": ""}[probe["of"]]
        least = ROUNDED * max((abs(values[-1]) for values in probe["values"].values() if values),
                              default=0.0)
        texts.append(f"{probe['name']}: " + (probe.get("why") or kind + ", ".join(
            f"{name} {values[-1] if abs(values[-1]) > least else 0.0:.5g}"
            for name, values in probe["values"].items()) + unit))
    return texts


def own_errors(summary: Summary) -> str:
    """Return the bodies whose own error, beside their own energy, is far beyond the one that is
    told of all together.
    """
    found, asked = summary.get("error_shares"), summary.get("tolerance")
    known = {name: inf if own is None else own
             for name, own in (found or {"own": {}})["own"].items()}
    beyond = [f"{name} {own:.1e}" if isfinite(own) else f"{name} all of it"
              for name, own in known.items() if asked and own > OWN * asked]
    return f"{some(beyond, NAMES)}, beside their own energy; where that matters, a smaller tolerance.error" if beyond else ""


def unbalanced(summary: Summary) -> list[str]:
    """Return the bodies of which no energy error is known for want of balanced forces near the
    run's; a limit load says more.
    """
    return [] if summary.get("limit_load") else [
        f"{some(names, NAMES)}: no forces were found at load step {steps} that the laws allow and "
        "that balance: no error is known"
        for steps, names in _alike(summary.get("unbalanced") or ())]


def not_held(summary: Summary) -> list[str]:
    """Return the bodies that are detached or weakly held, and at which load steps."""
    place = "where stabilisation leaves it" if summary.get("stabilised") else "undetermined"
    return [f"{some(names, NAMES)}: {what} at load step {steps}; the rigid position is {place}"
            for key, what in (("detached", "pressed on by no held body"),
                              ("weakly_held", "held, but free to move as a whole"))
            for steps, names in _alike(summary.get(key) or ())]


def stabilised(summary: Summary) -> list[str]:
    """Return what stabilisation carried, and the bodies that live by it at which load steps."""
    if not (found := summary.get("stabilised")):
        return []
    force, work = ("any number of times" if found[key] is None else f"{found[key]:.1e}"
                   for key in ("force", "work"))
    return [
        f"springs of ε = {found['epsilon']:.1e} carry at most {force} of the largest contact force "
        f"per area, and do {work} of the largest strain energy in work",
        *(f"{some(names, NAMES)}: more than a tenth of the forces at load step {steps}"
                                               for steps, names in _alike(found["bodies"]))]


def places(summary: Summary) -> list[str]:
    """Return how far places of bodies are determined: which are beyond a few tolerances, and which
    not at all.
    """
    found, tolerance = (summary.get("places") or {}).get("bodies", {}), summary.get("tolerance")
    known = {name: far for name, far in found.items() if far is not None and isfinite(far)}
    beyond = [f"{name} {far:.1e}" for name, far in known.items() if tolerance is None
              or far > FAR * tolerance]
    told = [
        f"{some(sorted(found.keys() - known), NAMES)}: not determined, as next to nothing holds "
        "them"] * (len(known) < len(found))
    return told + [
        f"{'all others' if told else 'bodies'} stand within {max(known.values(), default=0.0):.1e} "
        "of the largest displacement of their "
        f"places{': ' * bool(beyond)}{some(beyond, NAMES)}"] * bool(known)


def off_by(summary: Summary) -> list[str]:
    """Return what numbers are off by, where an accuracy was asked for; components of a vector
    together, what is rounding left out.
    """
    if not (found := (summary.get("accuracy") or {}).get("numbers")):
        return []
    values, together, kinds = summary["accuracy"]["meshes"][-1]["numbers"], {}, {}
    for name, error in found.items():
        head, _, axis = name.rpartition(".")
        together.setdefault(head if axis in ("x", "y", "z") and head.startswith("reaction.")
                            else name, []).append((values[name], error))
    for name, each in together.items():
        kind = name.partition(".")[0]
        kinds[kind] = max(kinds.get(kind, 0.0), hypot(*(value for value, _ in each)))
    return [
        f"{name.replace('_', ' ').replace('reaction.', '')} ± {error:.1e}  (estimated, by what "
        "the last meshes have changed)"
            for name, each in together.items()
        if (error := hypot(*(error for _, error in each))) > SURE * kinds[name.partition(".")[0]]]


def size(summary: Summary) -> str:
    """Return iterations, dofs, subdomains, interfaces and load steps."""
    words = {"iterations": "iteration", "dofs": "dof", "subdomains": "subdomain",
             "interfaces": "interface", "load_steps": "load step"}
    return ", ".join(f"{summary[key]:,} {word}{'s' * (summary[key] != 1)}"
                     for key, word in words.items() if summary.get(key) is not None)


def stages(summary: Summary) -> list[str]:
    """Return the seconds of each stage, and of the black box on its own clock."""
    timing = summary.get("timing") or {}
    told = [
        ", ".join(f"{label} {seconds:.2f}"
                  for label, seconds in sorted(stage_seconds(timing), key=lambda stage: -stage[1])
                  if seconds >= 0.005)]
    if own := blackbox_seconds(timing):
        share = f" ({own / (workers * timing['total']):.0%} of {workers} × {timing['total']:.2f} s)" \
            if (workers := summary.get("workers")) and timing.get("total") else ""
        told.append(f"black box {own:.2f} s, summed over its workers{share}")
    return told


def _alike(named: Iterable[list[str]]) -> list[tuple[str, list[str]]]:
    """Load steps, and the names that are told at these and no others, from the names per load
    step.
    """
    when: dict[str, list[str]] = {}
    for step, names in enumerate(named, 1):
        for name in names:
            when.setdefault(name, []).append(str(step))
    alike: dict[str, list[str]] = {}
    for name, steps in when.items():
        alike.setdefault(", ".join(steps), []).append(name)
    return [(steps, names) for steps, names in alike.items()]

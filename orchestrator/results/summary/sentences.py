"""Sentences of a summary that take more than a format: what carries, is held, and how far numbers
are off.

Every function takes a summary as ``View``; nothing comes back where nothing is known.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import hypot

import numpy as np

from orchestrator.errors import some
from orchestrator.linalg import PLACED, WRITTEN
from orchestrator.method.events import COUNTED
from orchestrator.results.summary.summary import View

OWN = 10.0  # errors asked, told of a body's own beside its own energy from which it is named
# tolerances, told of a body's place from which it is named: what is off by ten has been told to be
# off by four at least
FAR = 3.0


def vector(values: Sequence[float | None], most: float | None = None) -> str:
    """Return components as text, as zero what rounding leaves of them beside the largest, by
    default theirs.
    """
    least = PLACED * (largest(values) if most is None else most)
    return "(" + ", ".join("–" if x is None else f"{x if abs(x) > least else 0.0:.5g}"
                           for x in values) + ")"


def largest(values: object) -> float:
    """Return the magnitude of the largest of numbers in lists of lists."""
    if isinstance(values, (list, tuple)):
        return max(map(largest, values), default=0.0)
    return 0.0 if values is None else abs(float(values))


def forces(s: View, which: str) -> list[str]:
    """Return the forces of supports, or the sums of loads (``which``: support, or load), at the
    last load step; of a couple the moment.
    """
    most, texts = largest(s.reactions), []
    for name, steps, kind, (moment, alone) in zip(s.reaction_names, s.reactions, s.reaction_kinds,
                                                  _couples(s)
                                                  or [(None, False)] * len(s.reactions)):
        if steps and kind == which:
            told = [] if alone else [f"{vector(steps[-1], most)}{s.unit['force']}"]
            told += [f"moment {vector(moment)}{s.unit['moment']}"] if moment else []
            texts.append(f"{name}: {', '.join(told)}")
    if texts and s.many:
        texts[0] += f"  (load step {s.many} of {s.many})"
    return texts


def _couples(s: View) -> list[tuple[list[float] | None, bool]]:
    """Of each entry of ``boundary`` the moment at the last load step, where it is more than any
    force within the box has, and whether beside it the force is nothing.
    """
    found, least = s.reaction_moments, max(PLACED, s.tolerance or 0.0)
    if not found.get("size") or not all(s.reactions):
        return []
    force, moment = (np.array([steps[-1] for steps in all_], float)
                     for all_ in (s.reactions, found["moments"]))
    # about the middle
    moment = moment + np.cross(np.subtract(found["about"], found["middle"]), force)
    push, turn = found["size"] * np.linalg.norm(force, axis=1), np.linalg.norm(moment, axis=1)
    noise = least * max(largest(s.reactions) * found["size"], largest(found["moments"]))
    return [(one.tolist(), bool(p <= least * t)) if t > max(p, noise) else (None, False)
            for one, p, t in zip(moment, push, turn)]


def shown_statuses(counts: Mapping[str, list[int]]) -> list[str]:
    """Return the names of the statuses that say something: open, stick and slip only where there
    are such.
    """
    usual = [name for name in COUNTED if counts.get(name)]
    return usual * any(any(counts[name]) for name in usual) + [
        name for name in counts if name not in COUNTED]


def statuses(s: View) -> str:
    """Return how many node pairs are open, stick, slip … at the last load step."""
    when = f", load step {s.many} of {s.many}" if s.many else ""
    told = ", ".join(f"{s.status_counts[name][-1]:,} {name}"
                     for name in shown_statuses(s.status_counts) if any(s.status_counts[name]))
    return told and f"{told}  (node pairs{when})"


def probes(s: View) -> list[str]:
    """Return the values of probes at the last load step."""
    texts, units = [], {"displacement": "length", "stress": "stress"}
    for probe in s.probes:
        kind = "" if probe["quantity"] in ("point", "resultant", "section") \
            else f"{probe['quantity']} "
        last = {name: values[-1] for name, values in probe["values"].items() if values}
        least = PLACED * largest([*last.values()])
        told = ", ".join(f"{name} {x if abs(x) > least else 0.0:.5g}" for name, x in last.items())
        unit = s.unit.get(units.get(probe["of"]), "")
        texts.append(f"{probe['name']}: {probe.get('why') or kind + told + unit}")
    return texts


def own_errors(s: View) -> str:
    """Return the bodies whose own error, beside their own energy, is far beyond the one that is
    told of all together.
    """
    beyond = [f"{name} " + ("all of it" if own is None else f"{own:.1e}")
              for name, own in s.error_shares.get("own", {}).items()
              if s.tolerance and (own is None or own > OWN * s.tolerance)]
    return f"{some(beyond)}, beside their own energy; where that matters, a smaller " \
        "tolerance.error" if beyond else ""


def unbalanced(s: View) -> list[str]:
    """Return the bodies of which no energy error is known for want of balanced forces near the
    run's; a limit load says more.
    """
    return [f"{some(names)}: no forces were found at load step {steps} that the laws allow "
            "and that balance: no error is known"
            for steps, names in _alike(s.unbalanced) if not s.limit_load]


def not_held(s: View) -> list[str]:
    """Return the bodies that are detached or weakly held, and at which load steps."""
    place = "where stabilisation leaves it" if s.stabilised else "undetermined"
    return [f"{some(names)}: {what} at load step {steps}; the rigid position is {place}"
            for found, what in ((s.detached, "pressed on by no held body"),
                                (s.weakly_held, "held, but not in every direction"))
            for steps, names in _alike(found)]


def stabilised(s: View) -> list[str]:
    """Return what stabilisation carried, and the bodies that live by it at which load steps."""
    if not (found := s.stabilised):
        return []
    force, work = ("any number of times" if found[key] is None else f"{found[key]:.1e}"
                   for key in ("force", "work"))
    return [
        f"springs of ε = {found['epsilon']:.1e} carry at most {force} of the largest contact force "
        f"per area, and do {work} of the largest strain energy in work",
        *(f"{some(names)}: more than a tenth of the forces at load step {steps}"
          for steps, names in _alike(found["bodies"]))]


def places(s: View) -> list[str]:
    """Return how far places of bodies are determined: which are beyond a few tolerances, and which
    not at all.
    """
    found = s.places.get("bodies", {})
    known = {name: far for name, far in found.items() if far is not None}
    beyond = [f"{name} {far:.1e}" for name, far in known.items() if s.tolerance is None
              or far > FAR * s.tolerance]
    told = [
        f"{some(sorted(found.keys() - known))}: not determined, as next to nothing holds "
        "them"] * (len(known) < len(found))
    return told + [
        f"{'all others' if told else 'bodies'} stand within {max(known.values(), default=0.0):.1e} "
        "of the largest displacement of their "
        f"places{': ' * bool(beyond)}{some(beyond)}"] * bool(known)


def off_by(s: View) -> list[str]:
    """Return what numbers are off by, where an accuracy was asked for; components of a vector
    together, what is rounding left out.
    """
    if not (found := s.accuracy.get("numbers")):
        return []
    values, together, kinds = s.accuracy["meshes"][-1]["numbers"], {}, {}
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
        if (error := hypot(*(error for _, error in each))) > WRITTEN * kinds[
            name.partition(".")[0]]]


def size(s: View) -> str:
    """Return iterations, dofs, subdomains, interfaces and load steps."""
    words = {"iterations": "iteration", "dofs": "dof", "subdomains": "subdomain",
             "interfaces": "interface", "load_steps": "load step"}
    return ", ".join(f"{count:,} {word}{'s' * (count != 1)}" for key, word in words.items()
                     if isinstance(count := getattr(s, key), int))


def stages(s: View) -> list[str]:
    """Return the seconds of each stage, and of the black box on its own clock."""
    told = [", ".join(f"{label} {seconds:.2f}"
                      for label, seconds in sorted(s.stages, key=lambda stage: -stage[1])
                      if seconds >= 0.005)]
    if own := s.blackbox_seconds:
        total = s.timing.get("total")
        share = f" ({own / (s.workers * total):.0%} of {s.workers} × {total:.2f} s)" \
            if s.workers and total else ""
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

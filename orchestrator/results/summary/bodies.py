"""Sentences on bodies: those that nothing holds or balances, that springs hold, whose place or error is their own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf, isfinite

from orchestrator.errors import some

OWN = 10.0  # errors asked, told of a body's own beside its own energy from which it is named
NAMES = 6  # bodies in a sentence
FAR = 3.0  # tolerances, told of a body's place from which it is named: what is off by ten has been told to be off by four at least


def balance_sentences(summary: Mapping[str, object]) -> list[str]:
    """Sentences where no energy error is known for want of balanced forces near the run's; a limit load says more."""
    return [f"{some(names, NAMES)}: near the forces of load step {steps} none were found that the laws allow and that balance "
            f"{'it' if len(names) == 1 else 'them'}: no error is known"
            for steps, names in _alike(summary.get("unbalanced") or ()) if not summary.get("limit_load")]


def hold_sentences(summary: Mapping[str, object], brief: bool = False) -> list[str]:
    """Sentences on bodies that are detached or weakly held, and at which load steps; ``brief``: one sentence of each kind."""
    place = "where stabilisation leaves it" if summary.get("stabilised") else "undetermined"
    return [f"{some(names, NAMES)}: {what} at load step {steps}; {'its' if len(names) == 1 else 'their'} rigid position is {place}"
            for key, what in (("detached", "pressed on by no held body"), ("weakly_held", "held, but free to move as a whole"))
            for steps, names in _alike(summary.get(key) or (), brief)]


def stabilised_sentences(summary: Mapping[str, object], brief: bool = False) -> list[str]:
    """Sentences on what stabilisation carried, and the bodies that live by it at which load steps; ``brief``: one sentence of these."""
    if not (found := summary.get("stabilised")):
        return []
    force, work = map(_times, (found["force"], found["work"]))
    text = (f"springs of ε = {found['epsilon']:.1e} carry at most {force} of the largest contact force per area, and do "
            f"{work} of the largest strain energy in work")
    weakened = ", ".join(str(after + 1) for after in found.get("weakened") or ())
    text += f"; weaker from iteration {weakened} on" if weakened else ""
    lived = [f"{some(names, NAMES)}: {'lives' if len(names) == 1 else 'live'} by them at load step {steps} (more than a tenth of the "
             "forces there)" for steps, names in _alike(found["bodies"], brief)]
    return [text, *lived] if lived else [f"{text}; no body lives by them"]


def place_sentences(summary: Mapping[str, object]) -> list[str]:
    """Sentence on how far places of bodies are determined: which are beyond a few tolerances, and which not at all."""
    found, tolerance = summary.get("places"), summary.get("tolerance")
    if not found:
        return []
    known = {name: far for name, far in found["bodies"].items() if far is not None and isfinite(far)}
    beyond = [f"{name} {far:.1e}" for name, far in known.items() if tolerance is None or far > FAR * tolerance]
    text = [f"{some(sorted(found['bodies'].keys() - known), NAMES)}: not determined, as next to nothing holds "
            f"{'it' if len(found['bodies']) == len(known) + 1 else 'them'}"] * (len(known) < len(found["bodies"]))
    rest = "all others" if text else "bodies"
    return ["; ".join(text + ([f"{rest} stand within {max(known.values()):.1e} of the largest displacement of their places"
                               + (": " + some(beyond, NAMES) if beyond else "")] if known else []))]


def own_errors(summary: Mapping[str, object]) -> str:
    """Bodies whose own error, beside their own energy, is far beyond the one that is told of all together; empty without any."""
    found, asked = summary.get("error_shares"), summary.get("tolerance")
    known = {name: inf if own is None else own for name, own in (found or {"own": {}})["own"].items()}
    beyond = [f"{name} {own:.1e}" if isfinite(own) else f"{name} all of it" for name, own in known.items() if asked and own > OWN * asked]
    return (f"{some(beyond, NAMES)}, beside their own energy, which is little of all bodies'; where that matters, a smaller tolerance.error"
            if beyond else "")


def _times(share: float | None) -> str:
    return "any number of times" if share is None else f"{share:.1e}"


def _alike(named: Iterable[list[str]], brief: bool = False) -> list[tuple[str, list[str]]]:
    """Load steps, and the names that are told at these and no others, from the names per load step; ``brief``: all in one."""
    when: dict[str, list[str]] = {}
    for step, names in enumerate(named, 1):
        for name in names:
            when.setdefault(name, []).append(str(step))
    alike: dict[str, list[str]] = {}
    for name, steps in when.items():
        alike.setdefault(", ".join(steps), []).append(name)
    if brief and len(alike) > 1:
        steps = sorted({step for each in when.values() for step in each}, key=int)
        return [(f"{', '.join(steps)}, or some of these", list(when))]
    return list(alike.items())

"""The verdict on a bolted or clamped structure: what slips and from which load on, what bears, what bolts lose."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from orchestrator.results.summary.summary import units_of

Face = Mapping[str, object]

MOST = 4  # faces, or shanks, that a sentence is spent on
LOST = 0.01  # share of a pretension whose loss is told


def verdict(summary: Mapping[str, object]) -> list[str]:
    """Return sentences, those that matter most first; none where nothing can slip and there are no
    bolts, or the run has not converged. ``summary`` : as it is written to summary.json."""
    if not summary.get("converged"):
        return []
    unit, faces = units_of(summary), summary.get("contact_faces") or ()
    return [*_slipping(faces, unit), *_bearing(faces, unit["force"], summary.get("tolerance") or 0.0),
            *_loosened(summary.get("bolts") or (), unit["force"])]


def _slipping(faces: Sequence[Face], units: Mapping[str, str]) -> list[str]:
    """The faces that slip, the first ones first; else the one that is nearest to it."""
    rubbing = [face for face in faces
               if max(face["capacity"], default=0.0) > 0 and face["kind"] not in ("bore", "face")]
    told = _first(sorted((face for face in rubbing if face["slips"]), key=lambda face: face["slips"]["step"]),
                  lambda face: _slips(face, units), "faces slip")
    if told or not rubbing:
        return told
    face = max(rubbing, key=lambda face: max(face["used"]))
    most = max(face["used"])
    return [f"nothing slips: of what friction can hold at most {most:.0%} is used, by {face['name']} "
            f"at load step {face['used'].index(most) + 1}"]


def _bearing(faces: Sequence[Face], unit: str, tolerance: float) -> list[str]:
    """Shanks that have come to bear; what is within the tolerance of the largest force is nothing."""
    bores = [face for face in faces if face["kind"] == "bore"]
    least = tolerance * max((max(face["normal"]) for face in faces), default=0.0)

    def bears(face: Face) -> str:
        first = next(step for step, force in enumerate(face["bears"], 1) if force > least)
        return f"{face['name']} bears from load step {first}, with up to {_rounded(max(face['bears']))}{unit}"

    told = _first([face for face in bores if max(face["bears"], default=0.0) > least], bears, "shanks bear")
    return told or ["no shank bears in its hole"] * bool(bores)


def _loosened(bolts: Sequence[Mapping[str, object]], unit: str) -> list[str]:
    """The bolt that loses most of the force that it was tightened with last."""
    lost = []
    for bolt in bolts:
        last = max((step for step, state in enumerate(bolt["state"]) if state == "tightened"),
                   default=len(bolt["force"]))
        if after := bolt["force"][last + 1:]:
            lost.append((1 - min(after) / bolt["force"][last], bolt["name"], bolt["force"][last], min(after)))
    share, name, given, left = max(lost, default=(0.0, "", 0.0, 0.0))
    told = f"{name} loses most of its pretension, {share:.1%}: {_rounded(left)} of {_rounded(given)}{unit}"
    return [told] * (share > LOST)


def _slips(face: Face, units: Mapping[str, str]) -> str:
    """From which load on a face slips, and what it could hold beyond: all of it has slipped then."""
    slips, used = face["slips"], round(100 * face["used"][face["slips"]["step"] - 1])
    unit, load = units[slips.get("of") or "force"], ""
    if slips["load"] is not None:
        about = "" if slips["at"] is None else f"at about {_rounded(slips['at'])}{unit} "
        between = f"between {_rounded(slips['before'])} and {_rounded(slips['load'])}{unit}"
        load = f", {about}on {slips['on']}, {between}"
    rest = f", with {used}% of what friction can hold" * (used < 100)
    return f"{face['name']} slips from load step {slips['step']}{load}{rest}"


def _first(found: Sequence[Face], sentence: Callable[[Face], str], more: str) -> list[str]:
    """A sentence on each of the first ones, and how many more there are."""
    return [*map(sentence, found[:MOST]), *[f"… and {len(found) - MOST} more {more}"] * (len(found) > MOST)]


def _rounded(number: float) -> str:
    """Four digits, without an exponent where that is shorter."""
    return f"{float(f'{number:.4g}'):,.10g}"

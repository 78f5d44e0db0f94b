"""Verdict on a bolted or clamped structure, in a few sentences: what slips and from which load on, what bears, what bolts lose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from orchestrator.results.summary.summary import units_of

MOST = 4  # faces that a sentence is spent on
LOST = 0.01  # share of a pretension whose loss is told


def verdict(summary: Mapping[str, object]) -> list[str]:
    """Sentences, those that matter most first; none where nothing can slip and there are no bolts, or the run has not converged."""
    if not summary.get("converged"):
        return []
    return [*_slipping(summary), *_bearing(summary), *_bolts(summary)]


def _slipping(summary: Mapping[str, object]) -> Iterator[str]:
    """The faces that slip, the first ones first; else the one that is nearest to it."""
    faces = [face for face in summary.get("contact_faces") or ()
             if max(face["capacity"], default=0.0) > 0 and face["kind"] not in ("bore", "face")]
    slips = sorted((face for face in faces if face["slips"]), key=lambda face: face["slips"]["step"])
    for face in slips[:MOST]:
        step = face["slips"]["step"]
        used = round(100 * face["used"][step - 1])  # below 100 all of it has slipped, and yet it could hold more
        rest = f", with {used}% of what friction can hold" if used < 100 else ""
        yield f"{face['name']} slips from load step {step}{_load(face['slips'], units_of(summary)[face['slips'].get('of') or 'force'])}{rest}"
    if len(slips) > MOST:
        yield f"… and {len(slips) - MOST} more faces slip"
    if faces and not slips:
        face = max(faces, key=lambda face: max(face["used"]))
        most = max(face["used"])
        yield (f"nothing slips: of what friction can hold at most {most:.0%} is used, by {face['name']} at load step "
               f"{face['used'].index(most) + 1}")


def _load(slips: Mapping[str, object], unit: str) -> str:
    """The load at which a face slips."""
    if slips["load"] is None:
        return ""
    about = "" if slips["at"] is None else f"at about {_rounded(slips['at'])}{unit} "
    return f", {about}on {slips['on']}, between {_rounded(slips['before'])} and {_rounded(slips['load'])}{unit}"


def _rounded(number: float) -> str:
    """Four digits, without an exponent where that is shorter."""
    return f"{float(f'{number:.4g}'):,.10g}"


def _bearing(summary: Mapping[str, object]) -> Iterator[str]:
    """Shanks that have come to bear in holes with room; what is within the run's tolerance of the largest normal force is nothing."""
    faces = summary.get("contact_faces") or ()
    bores = [face for face in faces if face["kind"] == "bore"]
    least = (summary.get("tolerance") or 0.0) * max((max(face["normal"]) for face in faces), default=0.0)
    bearing = [face for face in bores if max(face["bears"], default=0.0) > least]
    for face in bearing[:MOST]:
        first = next(step for step, force in enumerate(face["bears"], 1) if force > least)
        yield f"{face['name']} bears from load step {first}, with up to {_rounded(max(face['bears']))}{units_of(summary)['force']}"
    if len(bearing) > MOST:
        yield f"… and {len(bearing) - MOST} more shanks bear"
    if bores and not bearing:
        yield "no shank bears in its hole"


def _bolts(summary: Mapping[str, object]) -> Iterator[str]:
    """The bolt that loses most of the force that it was tightened with last."""
    lost = []
    for bolt in summary.get("bolts") or ():
        tightened = [step for step, state in enumerate(bolt["state"]) if state == "tightened"]
        if tightened and tightened[-1] + 1 < len(bolt["force"]):
            given, left = bolt["force"][tightened[-1]], min(bolt["force"][tightened[-1] + 1:])
            lost.append((1 - left / given, bolt["name"], given, left))
    if lost and max(lost)[0] > LOST:
        share, name, given, left = max(lost)
        unit = units_of(summary)["force"]
        yield f"{name} loses most of its pretension, {share:.1%}: {_rounded(left)} of {_rounded(given)}{unit}"

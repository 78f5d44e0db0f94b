"""The verdict on a bolted or clamped structure: what slips and from which load on, what bears, what
bolts lose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from orchestrator.errors import LITTLE, SHOWN
from orchestrator.results.summary.summary import View

Face = Mapping[str, object]

# kinds of faces, in the order in which they are told, and what several are called
KINDS = {"plane": "plane faces", "round": "round faces", "head": "heads"}


def verdict(s: View) -> list[str]:
    """Return sentences, those that matter most first; none where nothing can slip and there are no
    bolts, or the run has not converged.
    """
    if not s.converged:
        return []
    faces, force = s.contact_faces, s.unit["force"]
    return [*_joints(faces, s.unit), *_bearing(faces, force, s.tolerance or 0.0),
            *_loosened(s.bolts, force)]


def _joints(faces: Sequence[Face], units: Mapping[str, str]) -> list[str]:
    """Return what joints do, plates before heads: of each kind the faces that move, the first ones
    first, then of those that hold the one that is pressed most, and the one nearest to slipping.
    """
    told: list[str] = []
    for kind, many in KINDS.items():
        own = [face | {"parts": _parts(face)} for face in faces
               if face["kind"] == kind and max(face["capacity"], default=0.0) > 0]
        moves = [face for face in own if face["slips"] or face["parts"]]
        moves.sort(key=lambda face: face["slips"]["step"] if face["slips"] else face["parts"])
        told += _first(moves, lambda face: _moves(face, units), f"{many} slip or part")
        held = sorted((face for face in own if not face["slips"] and not face["parts"]),
                      key=lambda face: -max(face["normal"]))
        told += [f"{face['name']} holds, {_used(face, units['force'])[1]}" for face in held[:1]]
        if others := held[1:]:
            nearest = max(others, key=lambda face: _used(face, "")[0])
            told.append(f"{len(others)} more {many} hold; nearest to slipping is "
                        f"{nearest['name']}, {_used(nearest, units['force'])[1]}")
    return told


def _moves(face: Face, units: Mapping[str, str]) -> str:
    """Return how a face slips, and from which load step on it ``parts``; 0: it does not."""
    gone = f"parts at load step {face['parts']}, when nothing presses it any more"
    if face["slips"]:
        return _slips(face, units) + f"; it {gone}" * bool(face["parts"])
    return f"{face['name']} {gone}; until then it holds, {_used(face, units['force'])[1]}"


def _pressed(face: Face) -> list[bool]:
    return [force > LITTLE * max(face["normal"]) for force in face["normal"]]


def _parts(face: Face) -> int:
    """Return the load step from which on nothing presses a face that was pressed; 0: none."""
    pressed = _pressed(face)
    return next((step for step in range(2, len(pressed) + 1)
                 if any(pressed[:step]) and not pressed[step - 1]), 0)


def _used(face: Face, unit: str) -> tuple[float, str]:
    """Return the largest share used of what friction can hold, and that in words."""
    most, step = max((used, step) for step, (used, pressed)
                     in enumerate(zip(face["used"], _pressed(face))) if pressed)
    carried, capacity = (face[key][step] for key in ("carried", "capacity"))
    share = "less than 1%" if most < 0.01 else f"at most {most:.0%}"
    told = f"{_rounded(carried)} of {_rounded(capacity)}{unit}, "
    if carried < 0.9 * most * capacity:
        told = "turning included, "
    return most, f"with {share} of its friction used ({told}load step {step + 1})"


def _bearing(faces: Sequence[Face], unit: str, tolerance: float) -> list[str]:
    """Shanks that have come to bear; what is within the tolerance of the largest force is
    nothing.
    """
    bores = [face for face in faces if face["kind"] == "bore"]
    least = tolerance * max((max(face["normal"]) for face in faces), default=0.0)

    def bears(face: Face) -> str:
        first = next(step for step, force in enumerate(face["bears"], 1) if force > least)
        most = _rounded(max(face["bears"]))
        return f"{face['name']} bears from load step {first}, with up to {most}{unit}"

    bearing = [face for face in bores if max(face["bears"], default=0.0) > least]
    return _first(bearing, bears, "shanks bear") or ["no shank bears in its hole"] * bool(bores)


def _loosened(bolts: Sequence[Mapping[str, object]], unit: str) -> list[str]:
    """The bolt that loses most of the force that it was tightened with last."""
    lost = [(0.0, "", 0.0, 0.0)]
    for bolt in bolts:
        force, tightened = bolt["force"], [k for k, x in enumerate(bolt["state"])
                                           if x == "tightened"]
        if tightened and (after := force[tightened[-1] + 1:]):
            given = force[tightened[-1]]
            lost.append((1 - min(after) / given, bolt["name"], given, min(after)))
    share, name, given, left = max(lost)
    return [f"largest loss of pretension: {name}, {share:.1%} ({_rounded(left)} of "
            f"{_rounded(given)}{unit})"] * (share > LITTLE)


def _slips(face: Face, units: Mapping[str, str]) -> str:
    """From which load on a face slips, and what it could hold beyond: all of it has slipped
    then.
    """
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
    return [
        *map(sentence, found[:SHOWN]),
        *[f"… and {len(found) - SHOWN} more {more}"] * (len(found) > SHOWN),
    ]


def _rounded(number: float) -> str:
    """Four digits, without an exponent where that is shorter."""
    return f"{float(f'{number:.4g}'):,.10g}"

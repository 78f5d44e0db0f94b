"""Faces in contact in the summary, and from which load on they slip.

That load is between those of two steps; where two steps before it tell how much of friction is used
as the load grows, a straight line through them tells where, see ``delivery.faces``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.method.delivery.faces import Face
from orchestrator.results.summary.verdict import PRESSED
from orchestrator.scene.model import Scene

CHANGED = 1e-9  # a load has changed by more than this share of its largest


def contact_faces(
    scene: Scene, faces: Sequence[Face], names: Sequence[str], reactions: np.ndarray
) -> list[dict[str, Any]]:
    """For each face its names, lists over the load steps, and where it slips, see ``slip_load``.

    names, reactions : (E,), (E, T, 6) of the entries of ``boundary``, forces and moments about the
        origin
    """
    opening = scene.opening
    pressed = [
        np.logical_or.accumulate(n > PRESSED * n.max())
        for n in (face.carries["normal"] for face in faces)
    ]
    return [
        {
            "name": face.name,
            "bodies": list(face.bodies),
            "kind": face.kind,
            "interfaces": [opening[k].name for k in face.pieces],
            "friction": face.friction,
            **{key: values.tolist() for key, values in face.carries.items()},
            "slips": slip_load(
                scene,
                slips,
                np.where(known, face.carries["used"], np.nan),
                face.flat * face.axis,
                names,
                reactions,
            )
            if (slips := face.carries["slipping"] & known).any()
            else None,
        }
        for face, known in zip(faces, pressed)
    ]


def slip_load(
    scene: Scene,
    slipping: np.ndarray,
    used: np.ndarray,
    normal: np.ndarray,
    names: Sequence[str],
    reactions: np.ndarray,
) -> dict[str, Any]:
    """Load step (from 1) from which on a face slips; the load at that step and the one before, and
    where between, if known.

    The load is the resultant of the entries of ``boundary`` that change then (of supports that
    move, if no load does): the force in the direction in which it changes along the face or, where
    it is a couple alone, the moment about the face's normal (``of``: force or moment). It is null
    where none changes, ``at`` also where no two steps before that one tell how ``used`` grows.

    slipping, used : (T,) of the face, nan where it is not pressed yet; normal : (3,) of its plane,
        0 where it is none; names, reactions : as for ``contact_faces``
    """
    step = int(np.argmax(slipping))
    result = {"step": step + 1, "on": None, "of": "force", "before": None, "load": None, "at": None}
    if step == 0:
        return result
    low, high = scene.mesh.box
    size = float(np.linalg.norm(high - low))
    force, moment = np.split(np.asarray(reactions), 2, axis=2)
    wrench = np.stack(
        [force * size, moment - np.cross(0.5 * (low + high), force)], axis=2
    )  # about the middle, (E, T, 2, 3)
    change = np.linalg.norm(wrench[:, step] - wrench[:, step - 1], axis=(1, 2)) > CHANGED * np.abs(
        wrench
    ).max(initial=0.0)
    loads = change & np.array([bool(entry.forces) for entry in scene.boundary])
    moved = change & np.array(
        [
            entry.prescribed is not None and bool(np.ptp(entry.prescribed.amounts))
            for entry in scene.boundary
        ]
    )
    chosen = np.flatnonzero(loads if loads.any() else moved)
    if not len(chosen):
        return result
    whole = wrench[chosen].sum(axis=0)
    pushes, turns = np.linalg.norm(whole[step] - whole[step - 1], axis=1)
    if max(pushes, turns) <= CHANGED * np.abs(wrench).max():  # they change, and not their resultant
        return result
    couple = bool(turns > pushes)  # no force within the box has a moment of more than half of that
    whole = whole[:, 1] if couple else whole[:, 0] / size
    way = whole[step] - whole[step - 1]
    upright = (way @ normal) * normal
    along = (
        upright if couple else way - upright
    )  # what only presses the face, or tips it, does not slide it
    way = along if np.linalg.norm(along) > CHANGED * np.linalg.norm(way) else way
    load = whole @ (way / np.linalg.norm(way))
    result |= {
        "on": " and ".join(names[e] for e in chosen),
        "of": "moment" if couple else "force",
        "before": float(load[step - 1]),
        "load": float(load[step]),
    }
    growth = (
        (used[step - 1] - used[step - 2]) / (load[step - 1] - load[step - 2])
        if step > 1 and load[step - 1] != load[step - 2]
        else 0.0
    )
    if growth > 0:
        at = load[step - 1] + (1 - used[step - 1]) / growth
        result["at"] = float(np.clip(at, *sorted((load[step - 1], load[step]))))
    return result

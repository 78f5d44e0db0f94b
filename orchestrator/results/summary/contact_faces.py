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


def contact_faces(scene: Scene, faces: Sequence[Face], names: Sequence[str],
                  reactions: np.ndarray) -> list[dict[str, Any]]:
    """For each face its names, lists over the load steps, and where it slips, see ``slip_load``.

    names, reactions : (E,), (E, T, 6) of the entries of ``boundary``, forces and moments about the
        origin
    """
    found = []
    for face in faces:
        normal, slips = face.carries["normal"], None
        pressed = np.logical_or.accumulate(normal > PRESSED * normal.max())
        if (slipping := face.carries["slipping"] & pressed).any():
            used = np.where(pressed, face.carries["used"], np.nan)
            slips = slip_load(scene, int(slipping.argmax()), used, face.flat * face.axis, names,
                              reactions)
        found.append({"name": face.name, "bodies": face.bodies, "kind": face.kind,
                      "interfaces": [scene.opening[k].name for k in face.pieces],
                      "friction": face.friction, **face.carries, "slips": slips})
    return found


def slip_load(scene: Scene, step: int, used: np.ndarray, normal: np.ndarray,
              names: Sequence[str], reactions: np.ndarray) -> dict[str, Any]:
    """Load step (from 1) from which on a face slips; the load at that step and the one before, and
    where between, if known.

    The load is the resultant of the entries of ``boundary`` that change then (of supports that
    move, if no load does): the force in the direction in which it changes along the face or, where
    it is a couple alone, the moment about the face's normal (``of``: force or moment). It is null
    where none changes, ``at`` also where no two steps before that one tell how ``used`` grows.

    step : from 0; used : (T,) of the face, nan where it is not pressed yet; normal : (3,) of its
        plane, 0 where it is none; names, reactions : as for ``contact_faces``
    """
    result = {"step": step + 1, "on": None, "of": "force", "before": None, "load": None, "at": None}
    if step == 0:
        return result
    low, high = scene.mesh.box
    size = float(np.linalg.norm(high - low))
    force, moment = np.split(np.asarray(reactions), 2, axis=2)
    # about the middle, (E, T, 2, 3)
    wrench = np.stack([force * size, moment - np.cross(0.5 * (low + high), force)], axis=2)
    least, changed = (
        CHANGED * np.abs(wrench).max(initial=0.0), wrench[:, step] - wrench[:, step - 1])
    change = np.linalg.norm(changed, axis=(1, 2)) > least
    loads = change & [bool(entry.forces) for entry in scene.boundary]
    moved = change & [entry.prescribed is not None and bool(np.ptp(entry.prescribed.amounts))
                      for entry in scene.boundary]
    chosen = np.flatnonzero(loads if loads.any() else moved)
    pushes, turns = np.linalg.norm(changed[chosen].sum(axis=0), axis=1)
    if max(pushes, turns) <= least:  # none changes, or not their resultant
        return result
    couple = bool(turns > pushes)  # no force within the box has a moment of more than half of that
    whole = wrench[chosen].sum(axis=0)[:, int(couple)] / (1.0 if couple else size)
    way = whole[step] - whole[step - 1]
    upright = (way @ normal) * normal
    # what only presses the face, or tips it, does not slide it
    along = upright if couple else way - upright
    way = along if np.linalg.norm(along) > CHANGED * np.linalg.norm(way) else way
    load = whole @ (way / np.linalg.norm(way))
    before, now, growth = float(load[step - 1]), float(load[step]), 0.0
    if step > 1 and before != load[step - 2]:
        growth = (used[step - 1] - used[step - 2]) / (before - load[step - 2])
    at = before + (1 - used[step - 1]) / growth if growth > 0 else None
    return result | {"on": " and ".join(names[e] for e in chosen),
                     "of": "moment" if couple else "force", "before": before, "load": now,
                     "at": None if at is None else float(np.clip(at, *sorted((before, now))))}

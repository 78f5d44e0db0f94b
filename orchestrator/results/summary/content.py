"""Content of summary.json for a finished run.

The load from which on a face in contact slips is between those of two steps; where two steps before
it tell how much of friction is used as the load grows, a straight line through them tells where,
see ``delivery.faces``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import islice
from typing import Any

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import LISTED, LITTLE, some
from orchestrator.method.acceleration import algorithm
from orchestrator.method.delivery.deliver import Delivered
from orchestrator.method.delivery.faces import Face
from orchestrator.method.delivery.lawful import Shares
from orchestrator.method.delivery.reference import Reference
from orchestrator.method.halving import path_sentence
from orchestrator.method.interface.stabilisation import cautions as stabilisation_cautions
from orchestrator.method.monitors.far_bodies import sentences
from orchestrator.method.stopping.backward import Backward
from orchestrator.processes import memory_peak_mb
from orchestrator.results.summary.advice import advice, Stopped
from orchestrator.results.summary.cautions import cautions, of_unheld, tool_cautions
from orchestrator.results.summary.summary import place_text
from orchestrator.results.summary.workload import Spent, total
from orchestrator.linalg import PLACED
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


# What is right only where answers are linear in the forces; the elastic problems that correct
# iterations still use the rest.
OFF = ["error bound", "superposition", "batches of load steps", "GMRES", "strain energy"]
RESIDUALS = ("displacement_jump", "force_imbalance", "residual", "macro_imbalance")


def summarise(config: Config, scene: Scene, delivered: Delivered, setup_sweeps: float,
              exact: Reference | None,
              ranks: Sequence[Spent], watch: Stopwatch) -> dict[str, object]:
    """The content of summary.json, where numbers may be numpy's, nan and infinite.

    setup_sweeps : back-substitutions per subdomain and load step before the first iteration
    exact : the undecomposed solution, if asked for
    ranks : what each rank has spent
    """
    iterated, estimated, met = delivered.iterated, delivered.discretisation, delivered.contact
    last, found, bound = iterated.last, iterated.found, iterated.bound
    names = [*(place_text(entry.model_dump(exclude_none=True)["on"], entry.part)
               for entry in config.boundary), *config.tools]
    contact, spent = _contact(scene, delivered, names), total(ranks, scene)
    own = dict.fromkeys(str(entry["code"]) for entry in spent["codes"] if entry["own_matter"])
    off = None if own else estimated and estimated.relative
    loose = sorted({name for key in ("detached", "weakly_held") for step in contact.get(key, ())
                    for name in step})
    # each was asked once an iteration, and at each load step's end once more
    flowing = [s.name for s in scene.subdomains if s.remembers]
    answers = len(flowing) * (iterated.iterations + scene.steps)
    summary = {
        "name": config.name, "converged": iterated.converged, "stop_reason": iterated.stop_reason,
        "advice": advice(Stopped(scene, config.method, iterated, loose,
                                 [code.code for code in config.codes], met and met.stabilised)),
        "iterations": iterated.iterations,
        "acceleration": algorithm(config.method.acceleration, scene.bonded and not flowing).title,
        "sweeps": {"setup": setup_sweeps, "iterations": iterated.sweeps,
                   "total": setup_sweeps + iterated.sweeps},
        "newton_steps": last.newton_steps, "coarse_ends": last.coarse_ends or None,
        "sole_scale": met and met.sole_scale,
        "indicator": last.indicator, "error_bound": bound.relative, "error_kind": bound.word,
        # by which friction has multiplied it
        "error_factor": bound.factor if bound.word and bound.factor > 1 else None,
        "error_shares": _shares(met and met.shares), "backward": _backward(met and met.backward),
        "true_error": exact and exact.relative_error(delivered.displacement),
        "discretisation_error": off, "tolerance": last.tolerance,
        "residuals": {name: getattr(last, name) for name in RESIDUALS}
        | (met.laws.named if met else {}),
        "stabilised": met and met.stabilised, "places": met and met.places,
        "element": scene.element and str(scene.element), **problem_size(scene),
        # pseudo-loads work on the elastic stiffness: no energy of what flows
        "energy": [math.nan] * scene.steps if flowing else delivered.energy,
        "reaction_names": names, **_reactions(scene, delivered, config.output.moments_about),
        **contact,
        "tools": [{"name": one.tool.name, "about": one.tool.driven.about,
                   "displacement": one.moved[:, :3], "rotation": np.degrees(one.moved[:, 3:])}
                  for one in delivered.tools],
        "load_path": [one | {"sentence": path_sentence(one)} for one in found.get("path", [])],
        **{key: [asdict(one) | {"sentence": str(one)} for one in found.get(key, [])]
           for key in ("limit_load", "far_bodies")},
        "warnings": [*stabilisation_cautions(config.method), *_of_matter(list(own)),
                     *sentences(found.get("far_bodies", [])),
                     *cautions(scene, delivered.sides or delivered.parts, delivered.met,
                               contact.get("detached", ()), off),
                     *tool_cautions(delivered.tools),
                     *of_unheld(scene, contact.get("detached", ()))],
        **spent, "config": config.complete()}
    if flowing:
        summary["nonlinear"] = {"subdomains": flowing, "answers": answers, "off": OFF}
    note_time(summary, watch)
    return summary


def _of_matter(own: list[str]) -> list[str]:
    """Return what is said of codes whose matter is their own."""
    return [
        "stresses and the estimated error of the mesh are those of the YAML's moduli; the matter "
        f"of {some(own)} is its own: there they are not to be believed, displacements and forces "
        "are, if that matter, its units included, is the one that is meant: nothing shows that it "
        "is"] * bool(own)


def _reactions(scene: Scene, delivered: Delivered, point: Sequence[float]) -> dict[str, object]:
    """Return forces of all entries of boundary, and moments about a point (3,)."""
    about = np.array(point, dtype=float)
    forces, moments = np.split(delivered.reactions, 2, axis=2)
    return {"reactions": forces,
            "reaction_kinds": ["load" if entry.forces else "support" for entry in scene.boundary],
            "reaction_moments": {"about": about, "moments": moments - np.cross(about, forces),
                                 "middle": scene.mesh.box.mean(axis=0),
                                 "size": float(np.linalg.norm(np.ptp(scene.mesh.box, axis=0)))}}


def problem_size(scene: Scene) -> dict[str, int]:
    """Return the part of the summary that says how large the problem is."""
    copies = sum(len(s.nodes) for s in scene.subdomains)
    shared = sum(len(i.global_nodes) for i in scene.interfaces)
    return {"dofs": 3 * len(scene.mesh.nodes), "dofs_decomposed": 3 * copies,
            "subdomains": len(scene.subdomains), "interfaces": len(scene.interfaces),
            "interface_nodes": shared, "load_steps": scene.steps}


def note_time(summary: dict[str, object], watch: Stopwatch) -> None:
    """Note the seconds of all stages so far, and this rank's memory; to be noted again when more
    has been done.
    """
    summary["timing"] = {"total": watch.total, **watch.seconds,
                         "blackbox": summary["timing"].get("blackbox", {})}
    if summary.get("rank_memory_peak_mb"):
        summary["rank_memory_peak_mb"][0] = memory_peak_mb()
    # what is left when no code is at work; the reference is neither's
    summary["orchestrator_seconds"] = watch.total - summary["asking_seconds"] - watch.seconds.get(
        "reference", 0.0)


def _shares(found: Shares | None) -> dict[str, object] | None:
    """The largest shares of the error, and every body's own beside its own energy."""
    return found and {"load_step": found.step + 1,
                      **{key: dict(islice(getattr(found, key).items(), LISTED))
                         for key in ("bodies", "interfaces")}, "own": found.own}


def _backward(found: Backward | None) -> dict[str, object] | None:
    """Largest shift of surfaces for which the result would be exact, in all load steps and in each;
    None where that is not known.
    """
    each = found and {"normal": found.normal.tolist(), "tangential": found.tangential.tolist()}
    return each and {name: max(steps) for name, steps in each.items()} | {"load_steps": each}


def _contact(scene: Scene, delivered: Delivered, names: Sequence[str]) -> dict[str, object]:
    """State of interfaces that are not perfect; empty where all are; ``names``: of the entries of
    ``boundary``.
    """
    if (met := delivered.met) is None:
        return {}
    bound, found = delivered.iterated.bound, {
        "status_counts": met.counts,
        "interface_resultants": [
            {"name": i.name, "subdomains": [scene.subdomains[e].name for e in i.subdomains],
             "law": i.law.name, "resultant": force}
            for i, force in zip(scene.opening, met.resultant)],
        "detached": met.detached, "weakly_held": met.weakly_held,
        "contact_faces": contact_faces(scene, met.faces, names, delivered.reactions)}
    # else it is not known which no forces hold that the laws allow
    if bound.pair is not None:
        found["unbalanced"] = [[s.name for s, loose in zip(scene.subdomains, step) if loose]
                               for step in bound.pair.unbalanced]
    return found | ({"bolts": met.bolts} if scene.bolts else {})


def contact_faces(scene: Scene, faces: Sequence[Face], names: Sequence[str],
                  reactions: np.ndarray) -> list[dict[str, Any]]:
    """For each face its names, lists over the load steps, and where it slips, see ``slip_load``.

    names, reactions : (E,), (E, T, 6) of the entries of ``boundary``, forces and moments about the
        origin
    """
    found = []
    for face in faces:
        normal, slips = face.carries["normal"], None
        pressed = np.logical_or.accumulate(normal > LITTLE * normal.max())
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
        PLACED * np.abs(wrench).max(initial=0.0), wrench[:, step] - wrench[:, step - 1])
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
    way = along if np.linalg.norm(along) > PLACED * np.linalg.norm(way) else way
    load = whole @ (way / np.linalg.norm(way))
    before, now, growth = float(load[step - 1]), float(load[step]), 0.0
    if step > 1 and before != load[step - 2]:
        growth = (used[step - 1] - used[step - 2]) / (before - load[step - 2])
    at = before + (1 - used[step - 1]) / growth if growth > 0 else None
    return result | {"on": " and ".join(names[e] for e in chosen),
                     "of": "moment" if couple else "force", "before": before, "load": now,
                     "at": None if at is None else float(np.clip(at, *sorted((before, now))))}

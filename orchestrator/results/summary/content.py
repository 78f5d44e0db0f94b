"""Content of summary.json for a finished run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import islice

import numpy as np

from orchestrator.config.model import Config
from orchestrator.config.probes import PointProbe, SectionProbe, SurfaceProbe
from orchestrator.errors import some
from orchestrator.method.acceleration import algorithm
from orchestrator.method.delivery.deliver import Delivered
from orchestrator.method.delivery.reference import Reference
from orchestrator.method.delivery.shares import Shares
from orchestrator.method.halving import path_sentence
from orchestrator.method.interface.stabilisation import cautions as stabilisation_cautions
from orchestrator.method.monitors.far_bodies import sentences
from orchestrator.method.stopping.backward import Backward
from orchestrator.method.stopping.certificate import Certified
from orchestrator.processes import memory_peak_mb
from orchestrator.results.answers import reaction_names
from orchestrator.results.extremes import DISPLACEMENT, RESULTANT, STRESS
from orchestrator.results.summary.advice import Stopped, advice
from orchestrator.results.summary.cautions import cautions, tool_cautions
from orchestrator.results.summary.contact_faces import contact_faces
from orchestrator.results.summary.workload import Spent, total
from orchestrator.scene.conditions.probes import Section
from orchestrator.scene.elasticity import von_mises
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch

# What is right only where answers are linear in the forces; the elastic problems that correct iterations still use the rest.
OFF = ["error bound", "superposition", "batches of load steps", "GMRES", "strain energy"]
MOST_SHARES = 20  # bodies, and interfaces, of which a share of the error is told
UNKNOWN = "no energy error is known, so that no interval is"
NOT_CARRIED = "no forces that the laws allow carry a load there in some direction, which has no end then"
NOT_PARTED = "it meets others in an edge, and what each carries there is not determined: no interval"


def summarise(config: Config, scene: Scene, delivered: Delivered, setup_sweeps: float, exact: Reference | None,
              ranks: Sequence[Spent], watch: Stopwatch) -> dict[str, object]:
    """The content of summary.json, where numbers may be numpy's, nan and infinite.

    setup_sweeps : back-substitutions per subdomain and load step before the first iteration
    exact : the undecomposed solution, if asked for
    ranks : what each rank has spent
    """
    iterated, estimated = delivered.iterated, delivered.discretisation
    last, contact, met = iterated.last, _contact(scene, delivered, reaction_names(config)), delivered.contact
    spent = total(ranks, scene)
    own, foreign = list(dict.fromkeys(str(entry["code"]) for entry in spent["codes"] if entry["own_matter"])), []
    if own:
        foreign, estimated = [f"stresses and the estimated error of the mesh are those of the YAML's moduli; the matter of {some(own)} is its "
            "own: there they are not to be believed, displacements and forces are, if that matter, its units included, is the one that is "
            "meant: nothing shows that it is"], None
    loose = sorted({name for key in ("detached", "weakly_held") for names in contact.get(key, ()) for name in names})
    flowing = [s.name for s in scene.subdomains if s.remembers]  # each was asked once an iteration, and at each load step's end once more
    nonlinear: dict[str, object] = {"nonlinear": {
        "subdomains": flowing, "answers": len(flowing) * (iterated.iterations + scene.steps), "off": OFF}} if flowing else {}
    factor, kind = getattr(iterated.bound, "factor", 1.0), None
    if math.isfinite(iterated.bound.relative):
        kind = "guaranteed" if getattr(iterated.bound, "guaranteed", True) else "estimated"
    summary = {"name": config.name, "converged": iterated.converged, "stop_reason": iterated.stop_reason,
        "advice": advice(Stopped(scene, config.method, iterated, loose, [code.code for code in config.codes], met and met.stabilised)),
        "iterations": iterated.iterations, "acceleration": algorithm(config.method.acceleration, scene.bonded and not nonlinear).title,
        "sweeps": {"setup": setup_sweeps, "iterations": iterated.sweeps, "total": setup_sweeps + iterated.sweeps},
        "newton_steps": last.newton_steps, "coarse_ends": last.coarse_ends or None, "sole_scale": met and met.sole_scale,
        "indicator": last.indicator, "error_bound": iterated.bound.relative, "error_kind": kind,
        "error_factor": factor if kind == "guaranteed" and factor > 1 else None,  # by which friction has multiplied it
        "error_shares": _shares(met and met.shares), "backward": _backward(met and met.backward),
        "true_error": exact.relative_error(delivered.displacement) if exact else None,
        "discretisation_error": estimated and estimated.relative,
        "tolerance": last.tolerance,
        "residuals": {name: getattr(last, name) for name in ("displacement_jump", "force_imbalance", "residual", "macro_imbalance")}
        | (met.laws.named if met else {}), "stabilised": asdict(met.stabilised) if met and met.stabilised else None,
        "places": asdict(met.places) if met and met.places else None,
        **nonlinear, "element": scene.element and str(scene.element), **problem_size(scene),
        # pseudo-loads work on the elastic stiffness: no energy of what flows
        "energy": [math.nan] * scene.steps if nonlinear else delivered.energy,
        "reactions": delivered.reactions[:, :, :3].tolist(), "intervals": _intervals(config, scene, delivered, reaction_names(config)),
        **contact,
        "tools": [{"name": one.tool.name, "about": one.tool.driven.about.tolist(), "displacement": one.moved[:, :3].tolist(),
                   "rotation": np.degrees(one.moved[:, 3:]).tolist()} for one in delivered.tools],
        "load_path": [found | {"sentence": path_sentence(found)} for found in iterated.found.get("path", [])],
        "limit_load": [asdict(found) | {"sentence": str(found)} for found in iterated.found.get("limit_load", [])],
        "far_bodies": [asdict(body) | {"sentence": str(body)} for body in iterated.found.get("far_bodies", [])],
        "warnings": stabilisation_cautions(config.method) + foreign + sentences(iterated.found.get("far_bodies", []))
        + cautions(scene, delivered.sides or delivered.parts, delivered.met, contact.get("detached", ()),
                   estimated and estimated.relative, delivered.moved, delivered.passed) + [*tool_cautions(delivered.tools)],
        **spent, "config": config.complete()}
    note_time(summary, watch)
    return summary


def _intervals(config: Config, scene: Scene, delivered: Delivered, names: Sequence[str]) -> dict[str, object] | None:
    """Least and greatest values; None where nothing is to be certified; ``names``: of the entries of ``boundary``."""
    probes = {name: probe for name, probe in config.output.named_probes.items() if probe.certified}
    if not (probes or config.output.certified):
        return None
    if (found := delivered.intervals) is None:
        return {"kind": None, "why": UNKNOWN}
    told: dict[str, object] = {"kind": "guaranteed" if found.guaranteed else "estimated"}
    normals = {probe.name: probe.normal for probe in scene.probes if isinstance(probe, Section)}
    told["probes"] = [{"name": name, "of": _what(probe), **_components(_what(probe), found.probes[name], normals.get(name))}
                      for name, probe in probes.items()]
    if found.reactions is not None:
        about = config.output.moments_about
        told["reactions"] = [{"name": name, **_with_moment(own, about)} for name, own in zip(names, found.reactions)]
    for key, perfect in (("sections", True), ("resultants", False)):
        if key in config.output.certified:
            told[key] = [{"name": i.name, **_with_moment(found.interfaces[i.index], found.centre[i.index].tolist(), NOT_PARTED)}
                         for i in scene.interfaces if i.law.perfect == perfect]
    if "bolts" in config.output.certified:
        told["bolts"] = [{"name": name, **_ends(own, NOT_PARTED)} for name, own in found.bolts.items()]
    return told


def _ends(interval: np.ndarray, why: str = "") -> dict[str, object]:
    """Least and greatest values (T, …) of (T, …, 2)."""
    ends = {"low": interval[..., 0].tolist(), "high": interval[..., 1].tolist()}
    return ends if np.isfinite(interval).all() else ends | {"why": why}


def _with_moment(interval: np.ndarray, about: Sequence[float], why: str = "") -> dict[str, object]:
    """Ends of a force, and of its moment about a point, (T, 6, 2) together."""
    return {**_ends(interval[:, :3], why), "moment": {**_ends(interval[:, 3:], why), "about": list(about)}}


def _what(probe: PointProbe | SurfaceProbe | SectionProbe) -> str:
    """Quantity that a probe's interval is of: no energy bounds the stress at a point."""
    if isinstance(probe, PointProbe):
        return "stress, mean over the tet at the point" if probe.quantity == "stress" else "displacement"
    if isinstance(probe, SectionProbe) or probe.quantity == "resultant":
        return "force"
    return "stress, mean over the tets behind the faces" if probe.of == "stress" else "displacement"


def _components(kind: str, interval: np.ndarray, normal: np.ndarray | None) -> dict[str, object]:
    """Components of a displacement (T, 3, 2), and of its magnitude; of a stress (T, 6, 2), and von Mises' of it; of force and moment (T, 6, 2).

    normal : of a section, (T, 7, 2) with the force along it, and what is across
    """
    if kind == "force":
        names, ends = (*RESULTANT, "normal", "shear"), np.zeros((2, len(interval), 0))
        if normal is not None:  # across is at most as far from the middle's as the whole vector
            middle, half = interval[:, :3].mean(axis=-1), 0.5 * np.ptp(interval[:, :3], axis=-1)
            across, far = np.linalg.norm(middle - np.outer(middle @ normal, normal), axis=1), np.linalg.norm(half, axis=1)
            ends = np.maximum(across - far, 0.0)[:, None], (across + far)[:, None]
    elif kind == "displacement":
        near = np.where((interval[..., 0] > 0) | (interval[..., 1] < 0), np.abs(interval).min(axis=-1), 0.0)
        most = np.abs(interval).max(axis=-1)
        names, ends = DISPLACEMENT, (np.linalg.norm(near, axis=-1)[:, None], np.linalg.norm(most, axis=-1)[:, None])
    else:  # at most as far from the middle's as that of the half widths, of which differences are at most the sums
        known = np.isfinite(interval).all(axis=(1, 2))
        low, high = np.moveaxis(np.where(known[:, None, None], interval, 0.0), -1, 0)
        middle, half = von_mises(0.5 * (low + high)), 0.5 * (high - low)
        far = np.sqrt(von_mises(half) ** 2 + 2 * (half[:, :3] * np.roll(half[:, :3], -1, axis=1)).sum(axis=1))
        names, ends = STRESS[:7], (np.maximum(middle - far, 0.0)[:, None], np.where(known, middle + far, np.inf)[:, None])
    whole = np.concatenate([interval, np.stack(ends, axis=-1)], axis=1)
    told = {name: {"low": whole[:, k, 0].tolist(), "high": whole[:, k, 1].tolist()} for k, name in enumerate(names[: whole.shape[1]])}
    return {"values": told} | ({} if np.isfinite(interval).all() else {"why": NOT_CARRIED})


def problem_size(scene: Scene) -> dict[str, int]:
    """The part of the summary that says how large the problem is."""
    known = scene.overview
    nodes = len(scene.mesh.nodes) if known is None else known.mesh_nodes
    copies = sum(len(s.nodes) for s in scene.subdomains) if known is None else int(known.nodes.sum())
    met = sum(len(i.global_nodes) for i in scene.interfaces) if known is None else int(known.met.sum())
    return {"dofs": 3 * nodes, "dofs_decomposed": 3 * copies, "subdomains": len(scene.subdomains), "interfaces": len(scene.interfaces),
            "interface_nodes": met, "load_steps": scene.steps}


def note_time(summary: dict[str, object], watch: Stopwatch) -> None:
    """Seconds of all stages so far, and this rank's memory; to be noted again when more has been done."""
    summary["timing"] = {"total": watch.total, **watch.seconds, "blackbox": summary["timing"].get("blackbox", {})}
    if summary.get("rank_memory_peak_mb"):
        summary["rank_memory_peak_mb"][0] = memory_peak_mb()
    # what is left when no code is at work; the reference is neither's
    summary["orchestrator_seconds"] = watch.total - summary["asking_seconds"] - watch.seconds.get("reference", 0.0)


def _shares(found: Shares | None) -> dict[str, object] | None:
    """The largest shares of the error, and every body's own beside its own energy."""
    first = found and {key: dict(islice(getattr(found, key).items(), MOST_SHARES)) for key in ("bodies", "interfaces")}
    return first and {"load_step": found.step + 1, **first, "own": found.own}


def _backward(found: Backward | None) -> dict[str, object] | None:
    """Largest shift of surfaces for which the result would be exact, in all load steps and in each; None where that is not known."""
    each = found and {"normal": found.normal.tolist(), "tangential": found.tangential.tolist()}
    return each and {name: max(steps) for name, steps in each.items()} | {"load_steps": each}


def _contact(scene: Scene, delivered: Delivered, names: Sequence[str]) -> dict[str, object]:
    """State of interfaces that are not perfect; empty where all are; ``names``: of the entries of ``boundary``."""
    if (met := delivered.met) is None:
        return {}
    bound, unbalanced = delivered.iterated.bound, {}
    if isinstance(bound, Certified):  # else it is not known which no forces hold that the laws allow
        unbalanced["unbalanced"] = [[s.name for s, loose in zip(scene.subdomains, step) if loose] for step in bound.pair.unbalanced]
    return {"status_counts": met.counts, "interface_resultants": [
            {"name": i.name, "subdomains": [scene.subdomains[e].name for e in i.subdomains], "law": i.law.name, "resultant": force}
            for i, force in zip(scene.opening, met.resultant.tolist())],
        "detached": met.detached, "weakly_held": met.weakly_held, **unbalanced,
        "contact_faces": contact_faces(scene, met.faces, names, delivered.reactions), **({"bolts": met.bolts} if scene.bolts else {})}

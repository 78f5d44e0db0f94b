"""Sections of a report, from the summary and the tables beside it: the answer, then the rest; what was asked is in ``question``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from orchestrator.method.stopping.law_residuals import FIXED_POINT, OF_BODIES, STABILISATION
from orchestrator.registry import LAWS
from orchestrator.results.answers import INTERFACES, OF_INTERFACES
from orchestrator.results.extremes import COLUMNS, NAME as EXTREMES
from orchestrator.results.folder import read_table
from orchestrator.results.report.document import Marked, heading, number, plain, section, sentences, table
from orchestrator.results.summary.bodies import hold_sentences, own_errors, place_sentences, stabilised_sentences
from orchestrator.results.summary.summary import jsonable, units_of
from orchestrator.results.summary.words import ROUNDED, quantity_text, shown_statuses, summary_rows
from orchestrator.scene.mesh.geometry import format_point

LARGE = 0.1  # an error that stands out
MOST = 40  # rows of a table; of more, the largest
_SHOWN = (("|u|", "max"), ("von_mises", "max"), ("s1", "max"), ("s3", "min"))
_ANSWER = ("run", "result", "peak stress", "peak displ.", "reactions", "loads", "error bound", "true error", "law residual", "mesh's error")
_OF_BOLTS = ("force", "shear", "bending", "torsion", "shortening")
# quantity, its formula, what it tells; measures of the laws follow
_QUANTITIES = [
    ("error_bound", "√(a² + b² − 2 δᵀNᵀδf + 2 Σγ), relative to the energy norm of the solution; "
                    "a = ‖u_D − u₂‖_K, b = ‖K⁺Nᵀδf‖_K (Prager–Synge), γ what laws miss",
     "guaranteed upper bound, mostly an estimate with Coulomb's friction, of ‖u_D − u_exact‖_K / ‖u_exact‖_K"),
    ("discretisation_error", "η_h = (Σ_cells η_T²)^½ / ‖u_exact‖, the latter's square ‖u_D‖² + η_h² under loads, ‖u_D‖² − η_h² where "
                             "displacements are prescribed; η_T² = ∫ (σ* − σ) : C⁻¹ (σ* − σ) with recovered stresses σ* on four-node "
                             "tets, ∫ ε(e) : C ε(e) of a small problem in each on ten-node ones",
     "estimate of what the mesh is to blame for; fields/ has its cells"),
    ("true_error", "‖u_D − u_ref‖_K / ‖u_ref‖_K", "against the undecomposed solution"),
    ("indicator", "η = (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹) / (‖w‖²_k + ‖f‖²_k⁻¹ + ‖ŵ‖²_k + ‖f̂‖²_k⁻¹)",
     "eq. 16: distance of the linear from the local stage; a squared ratio, no measure of accuracy"),
    ("displacement_jump", "‖B w‖ / ‖w‖, weighted by the diagonal of k", "gap between the sides of the interfaces"),
    ("force_imbalance", "‖A f‖ / ‖f‖, weighted by the inverse diagonal of k", "forces the sides do not balance"),
    ("residual", "‖s_new − s‖ / ‖s_new‖, weighted by the inverse diagonal of k", "change of the state in one iteration"),
    ("law_residual", "the largest of those below", "what `tolerance: {law: …}` is compared with"),
    ("interface_residual", "‖f − f̂‖ / ‖f‖, weighted by the inverse search direction",
     "forces in equilibrium against forces that obey the laws"),
    (STABILISATION, "max |f̂ − law(F)| / A / max |f| / A", "what springs carry that hold loose bodies in place"),
    (OF_BODIES, "max ‖f − f̂‖ / ‖f‖ of a body's interfaces, in the same norm", "the body where it is largest, by its own forces"),
    (FIXED_POINT, "‖F(s) − s‖ / ‖F(s)‖, in the same norm", "what nonlinear parts truly do against what is extrapolated"),
    ("imbalance", "‖f₁ + f₂‖ / ‖f‖, in the same norm", "forces the sides do not balance")]


def answer(summary: Mapping[str, object]) -> list[str]:
    """The three numbers, how good they are, and errors above a tenth, where they cannot be overlooked."""
    known, told = dict(summary_rows(summary)), []
    for key, what in (("discretisation_error", "The mesh's own error"), ("true_error", "The true error"),
                      ("error_bound", "The bound on the iterations' error")):
        if (value := summary.get(key)) is not None and value > LARGE:
            told.append(f"{what} is {value:.0%} (relative, energy norm): stresses may be off by as much or more.")
    if not summary.get("converged"):
        told.append("The run has not converged: these numbers are of its last state.")
    return [heading("The answer"), table(("", ""), [(label, known[label]) for label in _ANSWER if label in known]), *map(Marked.of, told)]


def meshes(summary: Mapping[str, object]) -> list[str]:
    """Table of what was found on each mesh, where an accuracy was asked for."""
    if not (found := summary.get("accuracy")):
        return []
    rows = [(str(k), f"{one['elements']:,}", f"{one['mesh_error']:.2%}",
             "not known" if one["iterations_error"] is None else f"{one['iterations_error']:.1e}", f"{one['error']:.2%}",
             f"{one['seconds']:.1f}", *map("{:.4g}".format, one["peak"] or (math.nan, math.nan)), ", ".join(one["refined"]) or "–")
            for k, one in enumerate(found["meshes"], 1)]
    head = ("mesh", "elements", "its error", "iterations'", "together", "seconds", "peak stress", "size there", "meshed anew")
    told = (f"Asked for: {found['asked']:.2%}, " if found["asked"] else "") + f"reached: {found['reached']:.2%}, energy norm, estimated."
    names = found["meshes"][-1]["quantities"]
    each = [(str(k), *(quantity_text(name, one["quantities"][name]) for name in names)) for k, one in enumerate(found["meshes"], 1)]
    return [heading("Meshes"), told, table(head, rows, numeric=True), *([table(("mesh", *("" for _ in names)), each)] if names else [])]


def reactions(summary: Mapping[str, object]) -> list[str]:
    """Force and moment on every entry of ``boundary``."""
    if not (forces := summary.get("reactions")):
        return []
    units, moments = units_of(summary), summary.get("reaction_moments") or {}
    names = summary.get("reaction_names") or [f"boundary[{k}]" for k in range(len(forces))]
    about = moments.get("about")
    per_entry = moments.get("moments") or [[()] * len(steps or ()) for steps in forces]
    if kinds := summary.get("reaction_kinds"):
        names = [f"{name} ({kind})" for name, kind in zip(names, kinds)]
    most, turning = largest(forces), largest(per_entry)
    rows = [(name, str(step), *rounded(force, most), *rounded(moment, turning)) for name, steps, turned in zip(names, forces, per_entry)
            for step, (force, moment) in enumerate(zip(steps or (), turned), 1)]
    head = ["on", "load step", *(f"F{axis}{units['force']}" for axis in "xyz")]
    head += [f"M{axis}{units['moment']}" for axis in "xyz"] if about else []
    told = [f"Moments about ({', '.join(f'{x:g}' for x in about)}). Of loads, what they add up to."] if about else []
    return [heading("Reactions"), table(head, rows, numeric=True), *told]


def rounded(values: Sequence[float | None], most: float) -> list[str]:
    """Numbers; what rounding leaves of zeros beside ``most`` is zero."""
    return [number(0.0 if x is not None and abs(x) <= ROUNDED * most else x) for x in values]


def largest(values: object) -> float:
    """Magnitude of the largest of numbers in lists of lists."""
    if isinstance(values, (list, tuple)):
        return max(map(largest, values), default=0.0)
    return 0.0 if values is None else abs(float(values))


def probes(summary: Mapping[str, object]) -> list[str]:
    """A table for every probe: components over load steps."""
    parts = []
    for probe in summary.get("probes") or ():
        where = probe.get("at")
        place = f" at {format_point(where)}" if isinstance(where, list) else ""
        kind = "" if probe["quantity"] == "point" else f"{probe['quantity']} of "
        parts.append(plain(f"{probe['name']}: {kind}{probe['of']}{place}"))
        parts.append(Marked.of(f"{probe['why']}.") if probe.get("why") else
                     table(("load step", *probe["values"]), by_step(*probe["values"].values()), numeric=True))
    return section("Probes", *parts)


def extremes(folder: Path, summary: Mapping[str, object]) -> list[str]:
    """Per part the largest displacement and stresses, with their places."""
    rows = [row for row in read_table(folder / EXTREMES, COLUMNS) if (row["quantity"], row["extreme"]) in _SHOWN]
    units, size = units_of(summary), dict.fromkeys((row["part"] for row in rows), 0.0)
    size |= {row["part"]: float(row["value"]) for row in rows if row["quantity"] == "von_mises"}
    kept = sorted(size, key=size.get, reverse=True)[:MOST]
    lines = [(part, row["quantity"], row["extreme"], number(float(row["value"])), *rounded(at := [float(row[x]) for x in "xyz"], largest(at)),
              row["load_step"]) for part in kept for row in rows if row["part"] == part]
    text = "The largest displacement and von Mises stress of every part, its largest tension (s1) and compression (s3)."
    text += f" The {MOST} parts with the largest stress of {len(size)}; {EXTREMES} has all." * (len(kept) < len(size))
    text += f" Displacements in{units['length']}, stresses in{units['stress']}." * bool(units["length"])
    head = ("part", "quantity", "", "value", "x", "y", "z", "load step")
    return [heading("Extremes"), text, table(head, lines, numeric=True)] if rows else []


def carried(folder: Path) -> list[str]:
    """Force, moment and centre of pressure of every interface."""
    rows, size = read_table(folder / INTERFACES, OF_INTERFACES), {}
    for row in rows:
        size[row["interface"]] = max([size.get(row["interface"], 0.0), *(abs(float(row[key])) for key in ("fx", "fy", "fz"))])
    kept = sorted(size, key=size.get, reverse=True)[:MOST]
    columns = ("fx", "fy", "fz", "mx", "my", "mz", "pressure_x", "pressure_y", "pressure_z")
    columns += ("pressure_max",) * any(row.get("pressure_max") for row in rows)
    columns += ("work", "dissipation") * any(float(row["work"] or 0) or float(row["dissipation"] or 0) for row in rows)
    kinds = [columns[0:3], columns[3:6], columns[6:9], *zip(columns[9:])]
    lines = [(row["interface"], row["load_step"], *(text for kind in kinds for text in _alike(row, kind)))
             for row in rows if row["interface"] in kept]
    text = ("Force of the second body on the first, its moment about the interface's centre, the centre of pressure, the "
            "largest pressure at a node; prescribed nodes on the interface are not counted.")
    text += f" The {MOST} interfaces with the largest forces of {len(size)}; {INTERFACES} has all." * (len(kept) < len(size))
    return [heading("Interface resultants"), text, table(("interface", "load step", *columns), lines, numeric=True)] if rows else []


def _alike(row: Mapping[str, str], columns: Sequence[str]) -> list[str]:
    """Numbers of one kind, forces or moments or places; a dash where there is none."""
    values = [float(row[key]) if row.get(key) else None for key in columns]
    return rounded(values, largest(values))


def by_step(*columns: Sequence[float | None]) -> list[tuple[str, ...]]:
    """Rows for a table: the load step, from 1, and the number of each column, components of one thing."""
    most = largest(list(map(list, columns)))
    return [(str(step), *rounded(row, most)) for step, row in enumerate(zip(*columns), 1)]


def interface_section(summary: Mapping[str, object]) -> list[str]:
    """Laws, status, bodies that nothing holds, resultants; what is not known is left out."""
    resultants, counts, bolts = summary.get("interface_resultants") or [], summary.get("status_counts"), summary.get("bolts") or []
    laws = [(law, str(sum(entry["law"] == law for entry in resultants)),
             *((LAWS[law].formula, LAWS[law].meaning) if law in LAWS else ("", "")))
            for law in sorted({entry["law"] for entry in resultants})]  # some of another's may not be registered here
    names = shown_statuses(counts)
    tightened = [(bolt["name"], str(step), *rounded(carried[:2], largest(bolt["force"])), *map(number, carried[2:]), state)
                 for bolt in bolts for step, (*carried, state) in enumerate(
                     zip(*(bolt.get(key) or [0.0] * len(bolt["force"]) for key in _OF_BOLTS), bolt["state"]), 1)]
    return [*section("Warnings", *sentences(summary.get("warnings") or ())),
        *section("Interface laws", table(("law", "interfaces", "formula", "meaning"), laws),
                 "d: displacement of side 2 relative to side 1; n: normal from side 1 to side 2; f: force on side 1; A: a node's share "
                 "of the area; p: pressure; μ: friction; g₀: initial gap." * bool(laws)),
        *section("Bolts", "Force along the bolt, positive where it is pulled; shear, and moments of bending and torsion, at its cut; what "
                 "tightening has taken off its length." * bool(bolts),
                 table(("bolt", "load step", *_OF_BOLTS, "state"), tightened, numeric=True)),
        *section("Faces in contact", *_faces(summary)),
        *section("Interface status", table(("load step", *names), [
            (str(step), *map(str, row)) for step, row in enumerate(zip(*(counts[name] for name in names)), 1)], numeric=True)),
        *section("Stabilisation", *sentences(stabilised_sentences(summary))),
        *section("Where the error comes from", *_shares(summary)),
        *section("Places of loose bodies", *sentences(place_sentences(summary))),
        *section("Bodies that are not held", *sentences(hold_sentences(summary)))]


def _shares(summary: Mapping[str, object]) -> list[str]:
    """Shares of bodies and interfaces, the largest first."""
    if not (found := summary.get("error_shares")):
        return []
    own = {name: "all of it" if value is None else f"{value:.1e}" for name, value in found["own"].items()}
    rows = [(name, f"{found['bodies'].get(name, 0.0):.1%}", own.get(name, "")) for name in {**found["bodies"], **own}][:MOST]
    return [f"Shares of the error's square at load step {found['load_step']}, where it is largest; and what is a body's own, beside its own "
            "energy.", *sentences([text] if (text := own_errors(summary)) else ()),
            table(("body", "share", "own error"), rows, numeric=True),
            table(("interface", "share"), [(name, f"{share:.1%}") for name, share in found["interfaces"].items()], numeric=True)]


def _faces(summary: Mapping[str, object]) -> list[str]:
    """Table of what every face that touches carries, and how near it is to slipping, over the load steps."""
    faces = [face for face in summary.get("contact_faces") or () if max(face["capacity"], default=0.0) > 0]
    kept = sorted(faces, key=lambda face: -max(face["capacity"]))[:MOST]
    lines = [(face["name"], str(step), number(normal), number(carried), number(capacity), f"{used:.0%}",
              "open" if not capacity else "bears" if face["kind"] == "bore" else "slips" if slips else "holds")
             for face in faces if face in kept for step, (normal, carried, capacity, used, slips) in enumerate(
                 zip(*(face[key] for key in ("normal", "carried", "capacity", "used", "slipping"))), 1)]
    text = ("Normal force, the friction that the face carries as a whole, what friction can hold of it, and the share that is used, "
            "twisting included; a shank in a hole with room bears or not.")
    text += f" The {MOST} faces that hold most of {len(faces)}." * (len(kept) < len(faces))
    return [text, table(("face", "load step", "normal", "friction", "can hold", "used", "state"), lines, numeric=True)] if lines else []


def last_values(summary: Mapping[str, object], history: Mapping[str, Sequence[float]]) -> str:
    """A table of what the iterations were judged by, with formulas."""
    measures = [(measure.name, measure.formula, measure.meaning) for law in LAWS.values() for measure in law.measures]
    residuals = summary.get("residuals") or {}
    known = {name: column[-1] for name, column in history.items() if len(column)} | residuals | {
        key: value for key, value in summary.items() if value is not None}
    told = {name: rest for name, *rest in [*_QUANTITIES, *measures] if jsonable(known.get(name)) is not None}
    told |= {name: ("", "") for name, value in residuals.items() if name not in told and isinstance(value, (int, float))}
    return table(("quantity", "last value", "formula", "meaning"),
                 [(name.replace("_", " "), f"{known[name]:.2e}", *rest) for name, rest in told.items()])

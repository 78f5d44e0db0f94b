"""Tables of a report, from summary.json, extremes.csv and the history: what each number is of, load
step by load step.

A table is a heading, a note, the heads of its columns and rows of cells. Cells may be numbers and
lists of the components of a vector.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchestrator.method.stopping.law_residuals import FIXED_POINT, OF_BODIES, STABILISATION
from orchestrator.registry import LAWS
from orchestrator.results.extremes import COLUMNS, NAME as EXTREMES
from orchestrator.results.folder import read_table
from orchestrator.results.report.document import plain, section, table
from orchestrator.results.summary.sentences import largest, ROUNDED, shown_statuses, vector
from orchestrator.results.summary.summary import (
    BLACKBOX_STAGES, blackbox_seconds, code_label, jsonable, stage_seconds, STAGES, units_of)
from orchestrator.results.summary.workload import PERIODS

MOST = 40  # rows of a kind; of more, the largest
EXTREME = (("|u|", "max"), ("von_mises", "max"), ("s1", "max"), ("s3", "min"))
OF_BOLTS = ("force", "shear", "bending", "torsion", "shortening")
# quantity, its formula, what it tells; measures of the laws follow
QUANTITIES = [
    ("error_bound", "√(a² + b² − 2 δᵀNᵀδf + 2 Σγ), relative to the energy norm of the solution; a "
     "= ‖u_D − u₂‖_K, b = ‖K⁺Nᵀδf‖_K (Prager–Synge), γ what laws miss",
     "guaranteed upper bound, mostly an estimate with Coulomb's friction, of ‖u_D − u_exact‖_K / "
     "‖u_exact‖_K"),
    ("discretisation_error",
     "η_h = (Σ_cells η_T²)^½ / ‖u_exact‖, the latter's square ‖u_D‖² + η_h² under loads, ‖u_D‖² − "
     "η_h² where displacements are prescribed; η_T² = ∫ (σ* − σ) : C⁻¹ (σ* − σ) with recovered "
     "stresses σ* on four-node tets, ∫ ε(e) : C ε(e) of a small problem in each on ten-node ones",
     "estimate of what the mesh is to blame for; fields/ has its cells"),
    ("true_error", "‖u_D − u_ref‖_K / ‖u_ref‖_K", "against the undecomposed solution"),
    ("indicator", "η = (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹) / (‖w‖²_k + ‖f‖²_k⁻¹ + ‖ŵ‖²_k + ‖f̂‖²_k⁻¹)",
     "eq. 16: distance of the linear from the local stage; a squared ratio, no measure of accuracy"),
    ("displacement_jump", "‖B w‖ / ‖w‖, weighted by the diagonal of k",
     "gap between the sides of the interfaces"),
    ("force_imbalance", "‖A f‖ / ‖f‖, weighted by the inverse diagonal of k",
     "forces the sides do not balance"),
    ("residual", "‖s_new − s‖ / ‖s_new‖, weighted by the inverse diagonal of k",
     "change of the state in one iteration"),
    ("law_residual", "the largest of those below", "what `tolerance: {law: …}` is compared with"),
    ("interface_residual", "‖f − f̂‖ / ‖f‖, weighted by the inverse search direction",
     "forces in equilibrium against forces that obey the laws"),
    (STABILISATION, "max |f̂ − law(F)| / A / max |f| / A",
     "what springs carry that hold loose bodies in place"),
    (OF_BODIES, "max ‖f − f̂‖ / ‖f‖ of a body's interfaces, in the same norm",
     "the body where it is largest, by its own forces"),
    (FIXED_POINT, "‖F(s) − s‖ / ‖F(s)‖, in the same norm",
     "what nonlinear parts truly do against what is extrapolated"),
    ("imbalance", "‖f₁ + f₂‖ / ‖f‖, in the same norm", "forces the sides do not balance")]
# column → format of a row of the record; times in seconds, shares of the period
STAGE = {"stage": "{name}", "rank": "{rank}", "calls": "{calls}", "seconds": "{seconds:.2f}",
         "waiting for other ranks": "{waiting:.2f}",
         "share": "{share:.1%}"}
WORKER = {"rank": "{rank}", "worker": "{worker}", "subdomains": "{models}", "dofs": "{dofs:,}",
          "calls": "{calls}", "start": "{start:.2f}",
          "assemble": "{assemble:.2f}", "factorise": "{factorise:.2f}", "solve": "{solve:.2f}",
          "messages": "{messages:.2f}",
          "waiting": "{waiting:.2f}", "idle": "{idle:.2f}", "idle share": "{idle_share:.1%}"}
RANK = {"rank": "{rank}", "seconds": "{seconds:.2f}", "waiting for other ranks": "{waiting:.2f}",
        "idle share": "{idle_share:.1%}",
        "messages": "{messages:,}", "of them sums": "{reductions:,}", "bytes sent": "{bytes:,}",
        "peak memory MB": "{memory_peak_mb:,.0f}"}
LEAST = 5e-3  # share of a period from which a stage is worth a row


@dataclass(frozen=True)
class Table:
    """A table of a report: nothing of it is shown where it has no rows."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""

    @property
    def markdown(self) -> list[str]:
        """The heading, the note, and the table, what rounding leaves beside the largest of a column
        as zero.
        """
        most = [largest([cell for cell in column if isinstance(cell, (list, tuple, float))])
                for column in zip(*self.rows)]
        texts = [[_cell(cell, size) for cell, size in zip(row, most)] for row in self.rows]
        return section(self.title, *([plain(self.note)] if self.note else []),
                       table(self.head, texts, numeric=True)) if texts else []


def _cell(cell: object, most: float) -> str:
    if isinstance(cell, (list, tuple)):
        return vector(cell, most)
    if isinstance(cell, float):
        return f"{cell if abs(cell) > ROUNDED * most else 0.0:.5g}"
    return "–" if cell is None else str(cell)


def tables(summary: Mapping[str, object], history: Mapping[str, Sequence[float]],
           folder: Path) -> list[Table]:
    """Return all tables of a results folder, in the order of the report; those without rows too."""
    summary = jsonable(summary)
    return [*_answers(summary, folder), *_contact(summary), *_errors(summary, history),
            *_time(summary)]


def _answers(summary: Mapping[str, object], folder: Path) -> Iterator[Table]:
    """Reactions, probes, extremes of the parts, energy."""
    units, forces, moments = units_of(summary), summary.get("reactions") or [], summary.get(
        "reaction_moments") or {}
    names = summary.get("reaction_names") or [f"boundary[{k}]" for k in range(len(forces))]
    kinds, about = summary.get("reaction_kinds") or [""] * len(names), moments.get("about")
    turning = moments.get("moments") or [[None] * len(steps or ()) for steps in forces]
    yield Table("Reactions",
                ("on", "", "load step", f"force{units['force']}", f"moment{units['moment']}"),
                [(name, kind, step, *both)
                 for name, kind, pushed, turned in zip(names, kinds, forces, turning)
                 for step, both in enumerate(zip(pushed or (), turned), 1)],
                f"Moments about {vector(about)}. Of loads, what they add up to." if about else "")
    for probe in summary.get("probes") or ():
        columns = {name: column for name, column in probe["values"].items() if column is not None}
        least = ROUNDED * largest(list(columns.values()))
        yield Table(f"Probe {probe['name']}: {probe['quantity']} of {probe['of']}",
                    ("load step", *columns),
                    [(step, *(float(x) if abs(x) > least else 0.0 for x in row))
                     for step, row in enumerate(zip(*columns.values()), 1)]
                    or [(probe["why"],)])
    rows = [row for row in read_table(folder / EXTREMES, COLUMNS)
            if (row["quantity"], row["extreme"]) in EXTREME]
    part = {row["part"]: float(row["value"]) for row in rows if row["quantity"] == "von_mises"}
    kept = sorted(dict.fromkeys(row["part"] for row in rows),
                  key=lambda name: -part.get(name, 0.0))[:MOST]
    yield Table("Extremes", ("part", "quantity", "extreme", "value", "at", "load step"),
                [(name, row["quantity"], row["extreme"], f"{float(row['value']):.5g}",
                  [float(row[x]) for x in "xyz"], row["load_step"])
                 for name in kept for row in rows if row["part"] == name],
                f"Of {len(kept)} part(s), those with the largest stress; {EXTREMES} has all "
                "quantities of all parts, interfaces.csv what every interface carries.")
    yield Table("Energy", ("load step", f"strain energy{units['energy']}"),
                list(enumerate(summary.get("energy") or (), 1)))


def _contact(summary: Mapping[str, object]) -> Iterator[Table]:
    """Bolts, faces in contact, how many node pairs are open, stick, slip."""
    yield Table("Cuts of bolts", ("bolt", "cut at", "across"),
                [(bolt["name"], bolt["cut"], bolt["axis"]) for bolt in summary.get("bolts") or ()
                 if bolt.get("cut")])
    yield Table("Bolts", ("bolt", "load step", *OF_BOLTS, "state"), [
        (bolt["name"], step, *carried) for bolt in summary.get("bolts") or ()
        for step, carried in enumerate(
            zip(*(bolt.get(key) or [None] * len(bolt["force"]) for key in (*OF_BOLTS, "state"))),
            1)],
        "Force along the bolt, positive where it is pulled; shear, and moments of bending and "
        "torsion, at its cut; what tightening has taken off its length.")
    laws = [entry["law"] for entry in summary.get("interface_resultants") or ()]
    # one of another's may not be registered here
    yield Table("Interface laws", ("law", "interfaces", "formula", "meaning"), [
        (law, laws.count(law),
         *((LAWS[law].formula, LAWS[law].meaning) if law in LAWS else ("", "")))
        for law in sorted(set(laws))],
        "d: displacement of side 2 relative to side 1; n: normal from side 1 to side 2; f: force "
        "on side 1; A: a node's share of the area; p: pressure; μ: friction; g₀: initial gap.")
    faces = [face for face in summary.get("contact_faces") or ()
             if max(face["capacity"], default=0.0) > 0]
    kept = sorted(faces, key=lambda face: -max(face["capacity"]))[:MOST]
    yield Table("Faces in contact",
                ("face", "load step", "normal", "friction", "can hold", "used", "state"), [
        (face["name"], step, normal, carried, capacity, f"{used:.0%}",
         "open" if not capacity else "bears" if face["kind"] == "bore" else "slips" if slips
         else "holds")
        for face in faces if face in kept
        for step, (normal, carried, capacity, used, slips) in enumerate(
            zip(*(face[key] for key in ("normal", "carried", "capacity", "used", "slipping"))), 1)],
        "Normal force, the friction that the face carries as a whole, what friction can hold of "
        "it, and the share that is used, twisting included; a shank in a hole with room bears or "
                f"not. {len(kept)} of {len(faces)} faces.")
    counts = summary.get("status_counts")
    names = shown_statuses(counts)
    yield Table("Interface status", ("load step", *names),
                [(step, *row) for step, row in enumerate(zip(*(counts[name] for name in names)), 1)]
                if names else [], "Node pairs.")


def _errors(summary: Mapping[str, object],
            history: Mapping[str, Sequence[float]]) -> Iterator[Table]:
    """Return what each mesh has left, where the error comes from, and what the iterations were
    judged by,
    with formulas.
    """
    found = (summary.get("accuracy") or {}).get("meshes") or ()
    yield Table("Meshes",
                ("mesh", "elements", "its error", "iterations'", "together", "seconds",
                 "peak stress, size there", "meshed anew"), [
        (k, f"{one['elements']:,}", f"{one['mesh_error']:.2%}",
         "not known" if one["iterations_error"] is None else f"{one['iterations_error']:.1e}",
         f"{one['error']:.2%}", float(one["seconds"]),
         one["peak"], ", ".join(one["refined"]) or "–") for k, one in enumerate(found, 1)])
    shares = summary.get("error_shares") or {"own": {}, "bodies": {}, "interfaces": {},
                                             "load_step": None}
    own = {name: "all of it" if value is None else f"{value:.1e}"
           for name, value in shares["own"].items()}
    parts = {**shares["bodies"], **dict.fromkeys(own.keys() - shares["bodies"], 0.0),
             **shares["interfaces"]}
    yield Table("Where the error comes from", ("body or interface", "share", "own error"),
                [(name, f"{share:.1%}", own.get(name, "")) for name, share in parts.items()],
                f"Shares of the error's square at load step {shares['load_step']}, where it is "
                "largest; and what is a body's own, beside its own energy.")
    measures = [(measure.name, measure.formula, measure.meaning) for law in LAWS.values()
                for measure in law.measures]
    residuals = summary.get("residuals") or {}
    known = {name: column[-1] for name, column in history.items() if len(column)} | residuals | {
        key: value for key, value in summary.items() if value is not None}
    told = {name: rest for name, *rest in [*QUANTITIES, *measures]
            if jsonable(known.get(name)) is not None}
    told |= {name: ("", "") for name, value in residuals.items() if name not in told
             and isinstance(value, (int, float))}
    yield Table("Measures", ("quantity", "last value", "formula", "meaning"),
                [(name.replace("_", " "), f"{known[name]:.2e}", *rest)
                 for name, rest in told.items()])


def _time(summary: Mapping[str, object]) -> Iterator[Table]:
    """Stages, codes, and who did what."""
    timing = summary.get("timing") or {}
    total, own = timing.get("total") or 0.0, timing.get("blackbox") or {}
    rows = [(label, f"{s:.2f}", f"{s / total:.0%}")
            for label, s in stage_seconds(timing)] if total else []
    rows += [(f"black box: {stage}", f"{own[stage]:.2f}", "") for stage in BLACKBOX_STAGES
             if own.get(stage) is not None]
    if seconds := blackbox_seconds(timing):
        rows.append(("black box: all, on its own clock, summed over its workers", f"{seconds:.2f}",
                     ""))
    yield Table("Time", ("stage", "seconds", "share"), rows)
    kinds = ("start", "assemble", "factorise", "solve", "total")
    yield Table("Codes", ("code", "subdomains", *kinds, "unit loads"), [
        (code_label(entry), len(entry["subdomains"]),
         *(f"{entry['seconds'][kind]:.2f}" for kind in kinds),
         f"{sum(note['unit_loads'] for note in entry['compliances']):,}")
        for entry in summary.get("codes") or ()], "Seconds of CPU.")
    for key, period in (summary.get("workload") or {}).items():
        stages = sorted((row for row in period["stages"] if row["share"] >= LEAST),
                        key=lambda row: (row["rank"], -row["seconds"]))
        ranks = period.get("ranks") or ()
        for what, columns, of in (("stages", STAGE,
                                   [row | {"name": STAGES.get(row["stage"], row["stage"])}
                                    for row in stages]),
                                  ("workers", WORKER, period["workers"]),
                                  ("ranks", RANK, ranks if len(ranks) > 1 else [])):
            yield Table(f"Who did what: {PERIODS[key]}, {period['seconds']:.2f} s, {what}",
                        list(columns),
                        [[form.format_map(row) for form in columns.values()] for row in of])

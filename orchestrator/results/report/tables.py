"""Tables of a report: what each number is of, load step by load step.

A table is a heading, columns and entries: one row an entry. A column is a head and what stands
below it, the name of a field (a number, or the components of a vector) or a text with fields in
braces, as in ``summary.lines``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from inspect import getdoc

from orchestrator.errors import LISTED
from orchestrator.linalg import PLACED
from orchestrator.method.stopping.law_residuals import FIXED_POINT, OF_BODIES, STABILISATION
from orchestrator.registry import LAWS
from orchestrator.results.extremes import NAME as EXTREMES
from orchestrator.results.report.document import plain, section, table
from orchestrator.results.solution import Solution
from orchestrator.results.summary.lines import filled
from orchestrator.results.summary.sentences import largest, shown_statuses, vector
from orchestrator.results.summary.summary import jsonable, View

Entry = Mapping[str, object]

EXTREME = (("|u|", "max"), ("von_mises", "max"), ("s1", "max"), ("s3", "min"))
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
     "eq. 16: distance of the linear from the local stage; a squared ratio, no measure of "
     "accuracy"),
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


@dataclass(frozen=True)
class Table:
    """A table of a report: nothing of it is shown where it has no rows.

    columns : head → field, or text with fields in braces
    """

    title: str
    columns: Mapping[str, str]
    entries: Iterable[Entry]
    note: str = ""

    @property
    def markdown(self) -> list[str]:
        """The heading, the note, and the table, what rounding leaves beside the largest of a column
        as zero.
        """
        rows = [[filled(told, entry) if "{" in told else entry.get(told)
                 for told in self.columns.values()] for entry in self.entries]
        most = [largest([cell for cell in column if isinstance(cell, (list, float))])
                for column in zip(*rows)]
        texts = [[_cell(cell, size) for cell, size in zip(row, most)] for row in rows]
        return section(self.title, *([plain(self.note)] if self.note else []),
                       table(list(self.columns), texts, numeric=True)) if texts else []


def _cell(cell: object, most: float) -> str:
    if isinstance(cell, float):
        return f"{cell if abs(cell) > PLACED * most else 0.0:.5g}"
    return vector(cell, most) if isinstance(cell, list) and cell else "–" if cell in (None, []) \
        else str(cell)


def by_step(entry: Entry, *keys: str) -> list[Entry]:
    """Return an entry for each load step, from one with lists over them under ``keys``."""
    known = {key: entry[key] for key in keys if entry.get(key)}
    return [{**entry, **dict(zip(known, row)), "step": step}
            for step, row in enumerate(zip(*known.values()), 1)]


def _columns(names: Iterable[str], **first: str) -> dict[str, str]:
    return {name.replace("_", " "): key for name, key in first.items()} | {x: x for x in names}


def tables(solution: Solution) -> list[Table]:
    """Return all tables, in the order of the report; those without rows too."""
    s = View(solution.summary)
    return [*_answers(s, solution.tables.get(EXTREMES) or [[]]), *_contact(s),
            *_errors(s, solution.history), *_time(s)]


def _answers(s: View, extremes: Sequence[Sequence[str]]) -> Iterator[Table]:
    """Reactions, probes, extremes of the parts, energy."""
    about, none = s.reaction_moments.get("about"), [None] * len(s.reactions)
    reactions = zip(s.reaction_names or none, s.reaction_kinds or none, s.reactions,
                    s.reaction_moments.get("moments") or none)
    yield Table("Reactions", {
        "on": "name", "": "kind", "load step": "step", f"force{s.unit['force']}": "force",
        f"moment{s.unit['moment']}": "moment"},
        [row for name, kind, force, moment in reactions for row in by_step(
            {"name": name, "kind": kind, "force": force, "moment": moment}, "force", "moment")],
        f"Moments about {vector(about)}. Of loads, what they add up to." if about else "")
    for probe in s.probes:
        values = {name: column for name, column in probe["values"].items() if column is not None}
        least = PLACED * largest(list(values.values()))
        shown = {name: [x if abs(x) > least else 0.0 for x in column]
                 for name, column in values.items()}
        yield Table(f"Probe {probe['name']}: {probe['quantity']} of {probe['of']}",
                    _columns(values, load_step="step" if values else "why"),
                    by_step(shown, *shown) or [probe])
    rows = [dict(zip(extremes[0], row)) for row in extremes[1:]]
    rows = [row | {"at": [float(row[x]) for x in "xyz"]} for row in rows
            if (row["quantity"], row["extreme"]) in EXTREME]
    stress = {row["part"]: float(row["value"]) for row in rows if row["quantity"] == "von_mises"}
    kept = sorted(dict.fromkeys(row["part"] for row in rows),
                  key=lambda name: -stress.get(name, 0.0))[:LISTED]
    yield Table("Extremes", _columns(("part", "quantity", "extreme", "value", "at"),
                                     ) | {"load step": "load_step"},
                [row | {"value": f"{float(row['value']):.5g}"} for name in kept for row in rows
                 if row["part"] == name],
                f"Of {len(kept)} part(s), those with the largest stress; {EXTREMES} has all "
                "quantities of all parts, interfaces.csv what every interface carries.")
    yield Table("Energy", {"load step": "step", f"strain energy{s.unit['energy']}": "energy"},
                [{"step": step, "energy": x} for step, x in enumerate(s.energy, 1)])


def _contact(s: View) -> Iterator[Table]:
    """Bolts, faces in contact, how many node pairs are open, stick, slip."""
    yield Table("Cuts of bolts", {"bolt": "name", "cut at": "cut", "across": "axis"},
                [bolt for bolt in s.bolts if bolt.get("cut")])
    carried = ("force", "shear", "bending", "torsion", "shortening", "state")
    yield Table("Bolts", _columns(carried, bolt="name", load_step="step"),
                [row for bolt in s.bolts for row in by_step(bolt, *carried)],
        "Force along the bolt, positive where it is pulled; shear, and moments of bending and "
        "torsion, at its cut; what tightening has taken off its length.")
    laws = [entry["law"] for entry in s.interface_resultants]
    # one of another's may not be registered here
    yield Table("Interface laws", _columns(("law", "interfaces", "formula", "meaning")), [
        {"law": law, "interfaces": laws.count(law), "formula": formula, "meaning": meaning}
        for law in sorted(set(laws))
        for meaning, formula, *_ in [
            (getdoc(LAWS[law]) if law in LAWS else "").split("\n\n") + [""]]],
        "d: displacement of side 2 relative to side 1; n: normal from side 1 to side 2; f: force "
        "on side 1; A: a node's share of the area; p: pressure; μ: friction; g₀: initial gap.")
    faces = [face for face in s.contact_faces if max(face["capacity"], default=0.0) > 0]
    kept = sorted(faces, key=lambda face: -max(face["capacity"]))[:LISTED]
    state = {"bore": ("bears", "bears")}
    yield Table("Faces in contact", {
        "face": "name", "load step": "step", "normal": "normal", "friction": "carried",
        "can hold": "capacity", "used": "{used:.0%}", "state": "state"},
        [row | {"state": state.get(row["kind"], ("holds", "slips"))[row["slipping"]]
                if row["capacity"] else "open"} for face in faces if face in kept
         for row in by_step(face, "normal", "carried", "capacity", "used", "slipping")],
        "Normal force, the friction that the face carries as a whole, what friction can hold of "
        "it, and the share that is used, twisting included; a shank in a hole with room bears or "
        f"not. {len(kept)} of {len(faces)} faces.")
    names = shown_statuses(s.status_counts)
    yield Table("Interface status", _columns(names, load_step="step"),
                by_step(s.status_counts, *names), "Node pairs.")


def _errors(s: View, history: Mapping[str, Sequence[float]]) -> Iterator[Table]:
    """Return what each mesh has left, where the error comes from, and what the iterations were
    judged by, with formulas.
    """
    yield Table("Meshes", {
        "mesh": "number", "elements": "{elements:,}", "its error": "{mesh_error:.2%}",
        "iterations'": "iterations", "together": "{error:.2%}", "seconds": "seconds",
        "peak stress, size there": "peak", "meshed anew": "anew"},
        [one | {"number": k, "anew": ", ".join(one["refined"]) or None,
                "iterations": filled("{iterations_error:.1e}", one) or "not known"}
         for k, one in enumerate(s.accuracy.get("meshes", ()), 1)])
    shares = s.error_shares or {"own": {}, "bodies": {}, "interfaces": {}, "load_step": None}
    own = {name: "all of it" if value is None else f"{value:.1e}"
           for name, value in shares["own"].items()}
    parts = {**shares["bodies"], **dict.fromkeys(own.keys() - shares["bodies"], 0.0),
             **shares["interfaces"]}
    yield Table("Where the error comes from",
                {"body or interface": "name", "share": "{share:.1%}", "own error": "own"},
                [{"name": name, "share": share, "own": own.get(name, "")}
                 for name, share in parts.items()],
                f"Shares of the error's square at load step {shares['load_step']}, where it is "
                "largest; and what is a body's own, beside its own energy.")
    values = jsonable({name: column[-1] for name, column in history.items() if len(column)})
    values |= s.residuals | {key: x for key, x in vars(s).items() if x is not None}
    told = {name: rest for name, *rest in [*QUANTITIES, *(
        (measure.name, measure.formula, measure.meaning) for law in LAWS.values()
        for measure in law.measures)] if values.get(name) is not None}
    told |= {name: ("", "") for name, x in s.residuals.items() if name not in told
             and isinstance(x, (int, float))}
    yield Table("Measures", {"quantity": "name", "last value": "{value:.2e}", "formula": "formula",
                             "meaning": "meaning"},
                [{"name": name.replace("_", " "), "value": values[name], "formula": formula,
                  "meaning": meaning} for name, (formula, meaning) in told.items()])


def _time(s: View) -> Iterator[Table]:
    """Stages and codes."""
    total = s.timing.get("total")
    rows = [{"name": label, "seconds": x, "share": x / total} for label, x in s.stages] if total \
        else []
    rows += [{"name": f"black box: {stage}", "seconds": x} for stage, x in s.blackbox.items()]
    rows += [{"name": "black box: all, on its own clock, summed over its workers",
              "seconds": s.blackbox_seconds}] * bool(s.blackbox_seconds)
    yield Table("Time", {"stage": "name", "seconds": "{seconds:.2f}", "share": "{share:.0%}"}, rows)
    kinds = ("start", "assemble", "factorise", "solve", "total")
    yield Table("Codes", {"code": "{code} ({transport})", "subdomains": "count"}
                | {kind: f"{{seconds[{kind}]:.2f}}" for kind in kinds}
                | {"unit loads": "{loads:,}"},
                [entry | {"count": len(entry["subdomains"]), "loads": sum(
                    note["unit_loads"] for note in entry["compliances"])} for entry in s.codes],
                "Seconds of CPU.")

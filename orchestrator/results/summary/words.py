"""A summary in words: a label and a text for each line, for the screen and for the report, and the sentences that these share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from math import hypot

from orchestrator.errors import some
from orchestrator.method.events import COUNTED
from orchestrator.results.summary.bodies import NAMES, balance_sentences, hold_sentences, own_errors, place_sentences, stabilised_sentences
from orchestrator.results.summary.cost import code_sentences, rank_sentence, skipped_sentence, time_sentences, worker_sentence
from orchestrator.results.summary.intervals import sentences as intervals
from orchestrator.results.summary.verdict import verdict
from orchestrator.results.summary.summary import jsonable, units_of

SHOWN = 8  # reactions on screen
SURE = 1e-6  # of the largest number of its kind: an error that is not told
ROUNDED = 1e-10  # of the largest of them: shown as zero


def summary_rows(summary: Mapping[str, object]) -> list[tuple[str, str]]:
    """Label and text of each line of the short summary; what is not known is left out."""
    found = {key: jsonable(value) for key, value in summary.items() if key != "config"} | {"config": summary.get("config") or {}}
    rows = [(label, told(found) or "" if callable(told) else _numbers(found, *told)) for label, told in _LINES]
    return [(label, text) for label, told in rows if (text := told if isinstance(told, str) else "\n".join(told))]


def _numbers(summary: Mapping[str, object], key: str, form: str) -> str:
    """A format of the entry ``key``, which may be within another one: ``sweeps.total``."""
    value: object = summary
    for name in key.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return "" if value is None else form.format(value)


def _result(summary: Mapping[str, object]) -> str:
    reason = str(summary.get("stop_reason") or "")
    return ("converged" if summary.get("converged") else "NOT converged") + (f" ({reason})" if reason not in ("", "converged") else "")


def _iterations(summary: Mapping[str, object]) -> str:
    return _numbers(summary, "iterations", "{:,}") and _numbers(summary, "iterations", "{:,}") + _numbers(
        summary, "sweeps.total", ", {:.4g} sweeps (back-substitutions per subdomain and load step)")


def _error(summary: Mapping[str, object]) -> str:
    """Sentence on the distance from the discrete solution."""
    kind = summary.get("error_kind") or "guaranteed"
    kind += _numbers(summary, "error_factor", ", {:.3g} times what it is with limits of friction that are known")
    return _numbers(summary, "error_bound", f"{{:.2e}}  ({kind}, relative, energy norm)")


def _backward(summary: Mapping[str, object]) -> str:
    """Sentence on the surfaces for which the result is exact."""
    if not (found := summary.get("backward")):
        return ""
    normal, tangential = (f"{found[name]:.1e}{units_of(summary)['length']}" for name in ("normal", "tangential"))
    return f"exact for surfaces shifted by at most {normal} along the normal, {tangential} across it"


def _peak(key: str, what: str, unit: str, summary: Mapping[str, object]) -> str:
    """A largest value with its place."""
    if not (found := summary.get(key)):
        return ""
    part = f" of {found['part']}" if found["part"] else ""
    when = f", load step {found['load_step']}" if (summary.get("load_steps") or 1) > 1 else ""
    at = _vector(found["at"], ROUNDED * max(map(abs, found["at"])))
    grows = found.get("grows")
    endless = f"\nsingular: from mesh to mesh it grows as h^-{grows:.2f}, h the size of elements there, without limit" if grows else ""
    return f"{found['value']:.5g}{units_of(summary)[unit]}  ({what}at {at}{part}{when}){endless}"


def _forces(which: str, summary: Mapping[str, object]) -> list[str]:
    """Sentences on the forces of supports, or the sum of loads, at the last load step; ``which``: support, or load."""
    names, reactions = summary.get("reaction_names") or [], summary.get("reactions") or []
    kinds = summary.get("reaction_kinds") or ["support"] * len(names)
    largest = max((abs(x) for steps in reactions for force in steps or () for x in force if x is not None), default=0.0)
    texts = [f"{name}: {_vector(steps[-1], ROUNDED * largest)}{units_of(summary)['force']}"
             for name, steps, kind in zip(names, reactions, kinds) if steps and (kind == "load") == (which == "load")]
    count = summary.get("load_steps") or 1
    if texts and count > 1:
        texts[0] += f"  (load step {count} of {count})"
    return texts[:SHOWN] + [f"… and {len(texts) - SHOWN} more in summary.json"] * (len(texts) > SHOWN)


def _tools(summary: Mapping[str, object]) -> list[str]:
    """Sentences on each tool's place at the last load step."""
    units = units_of(summary)
    return [f"{tool['name']}: {_vector(move := tool['displacement'][-1], ROUNDED * max(map(abs, move)))}{units['length']}"
            + (f", turned by {_vector(turn, ROUNDED * max(map(abs, turn)))}°" if any(turn := tool["rotation"][-1]) else "")
            for tool in summary.get("tools") or ()]


def quantity_text(name: str, told: Mapping[str, object], unit: str = "") -> str:
    """The length of a displacement or force with what mesh and iterations leave of error."""
    if told["error"] is None:
        return f"|{name}| is zero but for rounding"
    beside = "not known" if told["iterations"] is None else f"{told['iterations']:.1e}"
    return (f"|{name}| {told['value']:.6g} ± {told['error'] * told['value']:.1e}{unit} ({told['error']:.2%}: mesh's {told['mesh']:.2%} estimated, "
            f"iterations' {beside})")


def _probes(summary: Mapping[str, object]) -> list[str]:
    """Values of probes at the last load step."""
    units, texts = units_of(summary), []
    for probe in summary.get("probes") or ():
        kind = "" if probe["quantity"] in ("point", "resultant", "section") else f"{probe['quantity']} "
        unit = {"displacement": units["length"], "stress": units["stress"], "force": ""}[probe["of"]]
        least = ROUNDED * max((abs(values[-1]) for values in probe["values"].values() if values), default=0.0)
        texts.append(f"{probe['name']}: " + (probe.get("why") or kind + ", ".join(
            f"{name} {values[-1] if abs(values[-1]) > least else 0.0:.5g}" for name, values in probe["values"].items()) + unit))
        if told := probe.get("accuracy"):
            texts.append(quantity_text(probe["name"], told, unit or units["force"]) + f", asked: {told['asked']:.2%}")
    return texts


def _vector(values: Sequence[float | None], least: float = 0.0) -> str:
    """Components, those below ``least`` as zero: what rounding leaves of the others would be read as a number."""
    return "(" + ", ".join("–" if x is None else f"{x if abs(x) > least else 0.0:.5g}" for x in values) + ")"


def _mesh(summary: Mapping[str, object]) -> str:
    asked = (summary["config"].get("method") or {}).get("tolerance") or {}
    text = _numbers(summary, "discretisation_error", "{:.2e}  (estimated discretisation error, relative, energy norm)")
    return text + (f"; tolerance {summary['tolerance']:.2e}, {asked['fraction']:g} of it" if text and asked.get("error") == "auto" else "")


def _accuracy(summary: Mapping[str, object]) -> str:
    if not (found := summary.get("accuracy")):
        return ""
    last = found["meshes"][-1]
    asked = f", {found['asked']:.2%} asked" if found["asked"] else ""
    checked = "measured against the mesh before" if last["told"] is not None else "an estimate that nothing has checked"
    return (f"{found['reached']:.2%} reached{asked}, energy norm, of mesh and iterations together; {len(found['meshes'])} meshes, "
            f"the last of {last['elements']:,} elements; the mesh's error is {checked}")


def _off(summary: Mapping[str, object]) -> str:
    """What numbers are off by, where an accuracy was asked for; components of a vector together, what is rounding left out."""
    if not (found := (summary.get("accuracy") or {}).get("numbers")):
        return ""
    values, together = summary["accuracy"]["meshes"][-1]["numbers"], {}
    for name, error in found.items():
        head, _, axis = name.rpartition(".")
        together.setdefault(head if axis in ("x", "y", "z") and head.startswith("reaction.") else name, []).append((values[name], error))
    kinds = {name.partition(".")[0]: 0.0 for name in together}
    for name, each in together.items():
        kinds[name.partition(".")[0]] = max(kinds[name.partition(".")[0]], hypot(*(value for value, _ in each)))
    told = [f"{name.replace('_', ' ').replace('reaction.', '')} ± {error:.1e}" for name, each in together.items()
            if (error := hypot(*(error for _, error in each))) > SURE * kinds[name.partition(".")[0]]]
    return "; ".join(told[:SHOWN]) + (f"; … and {len(told) - SHOWN} more in summary.json" if len(told) > SHOWN else "") + (
        "  (estimated, by what the last meshes have changed)" if told else "")


def shown_statuses(counts: Mapping[str, list[int]] | None) -> list[str]:
    """Names of the statuses that say something: open, stick and slip only where there are such."""
    usual = [name for name in COUNTED if (counts or {}).get(name)]
    return (usual if any(any(counts[name]) for name in usual) else []) + [name for name in counts or () if name not in COUNTED]


def _statuses(summary: Mapping[str, object]) -> str:
    """Node pairs that are open, stick, slip … at the last load step."""
    counts = summary.get("status_counts")
    if not (names := shown_statuses(counts)):  # imposed jumps alone
        return ""
    steps = len(counts[names[0]])
    when = f"  (node pairs, load step {steps} of {steps})" if steps > 1 else "  (node pairs)"
    return ", ".join(f"{counts[name][-1]:,} {name}" for name in names if any(counts[name])) + when


def _nonlinear(summary: Mapping[str, object]) -> str:
    found = summary.get("nonlinear")
    return (f"{some(found['subdomains'], NAMES)}: load steps one after the other, {found['answers']:,} answers from the last committed "
            f"one; no error bound is claimed, residuals are; off: {', '.join(found['off'])}") if found else ""


def _bolts(summary: Mapping[str, object]) -> list[str]:
    """Sentences on the bolts' forces at the last load step."""
    return [f"{bolt['name']}: {bolt['force'][-1]:.5g}, {bolt['state'][-1]}, shortened by {bolt['shortening'][-1]:.4g}" + (
        f"; shear {bolt['shear'][-1]:.3g}, bending {bolt['bending'][-1]:.3g}" if bolt.get("shear") else "")
        for bolt in summary.get("bolts") or ()]


def _size(summary: Mapping[str, object]) -> str:
    words = {"dofs": "dof", "subdomains": "subdomain", "interfaces": "interface", "load_steps": "load step"}
    return ", ".join(f"{summary[key]:,} {word}{'s' * (summary[key] != 1)}" for key, word in words.items() if summary.get(key) is not None)


# label → a function of the summary, for a text or several, or a key of it and the format of what is there
_LINES: tuple[tuple[str, object], ...] = (
    ("run", ("name", "{}")), ("result", _result), ("verdict", verdict),
    ("peak stress", partial(_peak, "peak_stress", "von Mises, ", "stress")),
    ("peak displ.", partial(_peak, "peak_displacement", "", "length")), ("reactions", partial(_forces, "support")), ("tools", _tools),
    ("loads", partial(_forces, "load")), ("probes", _probes), ("certified", intervals), ("what to do", lambda summary: summary.get("advice")),
    ("iterations", _iterations), ("load path", lambda summary: [found["sentence"] for found in summary.get("load_path") or ()]),
    ("error bound", _error), ("own errors", own_errors), ("backward", _backward),
    ("true error", ("true_error", "{:.2e}  (against the undecomposed solution)")),
    ("law residual", ("residuals.law_residual", "{:.2e}  (equilibrium and interface laws, the largest relative residual)")),
    ("no balance", balance_sentences), ("mesh's error", _mesh), ("accuracy", _accuracy), ("off by", _off),
    ("interfaces", _statuses), ("nonlinear", _nonlinear), ("bolts", _bolts), ("stabilised", partial(stabilised_sentences, brief=True)),
    ("places", place_sentences), ("not held", partial(hold_sentences, brief=True)), ("warning", lambda summary: summary.get("warnings")),
    ("size", _size), ("element", ("element", "{}")), ("time", time_sentences), ("codes", code_sentences), ("workers", worker_sentence),
    ("ranks", rank_sentence), ("skipped", skipped_sentence), ("memory", ("memory_peak_mb", "{:,.0f} MB at the peak")))
